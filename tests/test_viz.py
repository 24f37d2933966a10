"""Pictures for a notebook: what they show, and what is said when they cannot."""

import base64
import dataclasses
import html
import json
import re
import sys

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh
from phantoms import nested
from scipy.spatial import cKDTree

from ngbrain import viz
from ngbrain.errors import InputError, MissingExtra
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.geometry.sizing import RadialSizeField
from ngbrain.mesh.routes.lattice import lattice

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def head():
    labels = nested((20.0, 14.0, 7.0))
    return labels, lattice(labels, RadialSizeField(5e-3, 5e-3)).elements


def pixels(image):
    from io import BytesIO

    from matplotlib.image import imread

    assert image.data.startswith(PNG)
    return imread(BytesIO(image.data))[..., :3]


def near(picture, colour):
    """How many pixels have about a colour, 0 to 255."""
    return int((np.abs(255 * picture - np.array(colour)).max(axis=2) < 12).sum())


def blue(picture):
    """How many pixels are, in whatever light."""
    return int((picture[..., 2] > picture[..., 0] + 0.25).sum())


def test_slices_show_labels_and_mesh(head):
    labels, made = head
    scan = Volume(
        np.where(labels.volume.data, 50.0 + 40 * labels.volume.data, 0).astype(np.float32), labels.volume.affine
    )
    with_scan, without = pixels(viz.slices(made, labels, scan)), pixels(viz.slices(made, labels))
    black = [near(picture, (0, 0, 0)) for picture in (with_scan, without)]
    assert black[0] > 20 * max(black[1], 1000)  # the scan's background
    centre, aside = (pixels(viz.slices(made, labels, at=at)) for at in ((0, 0, 0), (0, 0, 17e-3)))
    assert centre.shape == aside.shape and np.abs(centre - aside).mean() > 0.01


def test_the_surface_and_the_elements(head):
    _, made = head
    surface, histograms = pixels(viz.surfaces(made)), pixels(viz.quality(made))
    assert blue(surface) > 500  # ventricles, where it is cut open
    assert blue(pixels(viz.surfaces(made, at=(0, 17e-3, 0)))) == 0  # cut in front of them
    assert near(histograms, (0x5A, 0x6B, 0x7A)) > 2000


def drawn(page):
    """What the page gives to its viewer."""
    return json.loads(re.search(r"init\(document.getElementById\('view'\), (.*)\);</script>", page)[1])


def corners(data):
    """Corners of the tetrahedra (n, 4, 3), and the values there (n, 4)."""
    arrays = [np.frombuffer(base64.b64decode(text), np.float32).reshape(-1, 4) for text in data["points3d"][:4]]
    whole = np.stack(arrays, axis=1)
    return whole[..., :3], whole[..., 3]


def test_a_mesh_to_turn_holds_the_mesh(head):
    _, made = head
    view = viz.interactive(made.mesh(), at=(0, 5e-3, 0))
    data = drawn(view.html())
    points, values = corners(data)
    names = list(dict.fromkeys(made.mesh().GetMaterials()))
    numbers = np.array([names.index(name) for name in made.regions])[made.region]
    away, which = cKDTree(made.points).query(points)
    assert away.max() < 1e-8
    wanted, found = np.c_[np.sort(made.tets), numbers], np.c_[np.sort(which), values[:, 0]]
    assert {tuple(row) for row in found} == {tuple(row) for row in wanted} and len(found) == len(wanted)
    assert (values == values[:, :1]).all()  # one colour a tetrahedron
    assert view.caption.endswith(": " + ", ".join(names)) and view.caption in view.html()
    assert data["funcmin"] == 0 and data["funcmax"] == len(names) - 1 and not data["autoscale"]
    assert data["gui_settings"]["Colormap"]["ncolors"] == len(names)
    assert data["clipping_function"] and data["clipping_y"] == 1
    assert data["mesh_center"][1] - data["clipping_dist"] == pytest.approx(5e-3, abs=1e-9)


def test_a_field_to_turn(head):
    _, made = head
    points, values = corners(drawn(viz.interactive(made.mesh(), 3 * ngs.x).html()))
    assert np.allclose(values, 3 * points[..., 0], atol=1e-7) and values.max() > 0.05
    plane = MakeStructured2DMesh(quads=False, nx=2, ny=2)
    data = drawn(viz.interactive(plane, ngs.x + ngs.y).html())
    assert data["funcmax"] == pytest.approx(2) and "clipping" not in data


def test_the_page_needs_no_network(head, tmp_path, monkeypatch):
    _, made = head
    view = dataclasses.replace(viz.interactive(made.mesh()), caption="<b>&")
    page = view.write(tmp_path / "head.html").read_text()
    outside = re.sub(r"<script>.*?</script>", "", page, flags=re.S)
    assert "http" not in outside and "src=" not in page.replace(view.viewer.read_text(), "")
    assert view.viewer.read_text() in page and "<p>&lt;b&gt;&amp;</p>" in page
    frame = view._repr_html_()
    assert html.unescape(re.search(r'srcdoc="([^"]*)"', frame)[1]) == page
    spoilt = dataclasses.replace(view, data={"names": ["</script><script>alert(1)"]}).html()
    assert spoilt.count("</script>") == page.count("</script>") and drawn(spoilt)["names"][0].startswith("</script>")
    monkeypatch.delitem(sys.modules, "ngsolve.webgui")
    with np.errstate(divide="raise"):
        viz.interactive(made.mesh())
        assert np.geterr()["divide"] == "raise"  # which importing the webgui changes


def test_what_cannot_be_shown(head, monkeypatch):
    labels, made = head
    with pytest.raises(InputError, match=r"at is \(1, 2\); wanted: three numbers, m"):
        viz.slices(made, labels, at=(1, 2))
    with pytest.raises(InputError, match="at is "):
        viz.interactive(made.mesh(), at=(0, np.nan, 0))
    monkeypatch.setitem(sys.modules, "IPython.display", None)
    with pytest.raises(MissingExtra, match=r"ngbrain\[viz\]"):
        viz.quality(made)
    monkeypatch.setitem(sys.modules, "webgui_jupyter_widgets", None)
    with pytest.raises(MissingExtra, match=r"webgui_jupyter_widgets is not installed.*ngbrain\[viz\]"):
        viz.interactive(made.mesh())
