"""Interactive panels: what their pages hold, and that they need nothing from a network."""

import base64
import html
import json
import re

import numpy as np
import pytest
from phantoms import nested

from ngbrain.errors import InputError, MissingExtra
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.geometry.sizing import RadialSizeField
from ngbrain.mesh.routes.lattice import lattice
from ngbrain.report.pages import anatomy
from ngbrain.report.pictures import panel as module
from ngbrain.report.pictures.panel import ColourScale, Panel, SurfaceLayer, VolumeLayer, scan_layers
from ngbrain.report.render.surface import area, outer_triangles

SQUARE = np.array([[0.0, 0, 0], [0.02, 0, 0], [0, 0.01, 0], [0.02, 0.01, 0.004]]), np.array([[0, 1, 2], [1, 3, 2]])
GREYS = ColourScale("height (mm)", 0.0, 4.0, np.array([[0, 0, 0], [255, 255, 255]]))


def scene(panel):
    """What the page gives to its viewer."""
    return json.loads(panel.data)


def array(text, kind, columns=1):
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, columns)


def points(made, number):
    shape = made["shapes"][number]
    low, high = np.array(made["low"]), np.array(made["high"])
    return low + array(shape["points"], "<u2", 3) / 65535 * (high - low), array(shape["triangles"], "<u4", 3)


def test_a_surface_keeps_its_points_and_values():
    layers = [
        SurfaceLayer("plate", *SQUARE, values=1e3 * SQUARE[0][:, 2], scale=GREYS),
        SurfaceLayer("edges", *SQUARE, "#112233", edges=True, shown=False),
    ]
    made = scene(Panel(layers, "A plate", cut_away=-2))
    at, triangles = points(made, 0)
    assert np.abs(at - SQUARE[0]).max() < 0.02 / 65535 and (triangles == SQUARE[1]).all()
    assert array(made["surfaces"][0]["values"], "u1").ravel().tolist() == [1, 1, 1, 255]
    first, second = made["surfaces"]
    assert first["shape"] == second["shape"] == 0 and made["shapes"][0]["edges"]  # stored once
    assert second["colour"] == [0x11 / 255, 0x22 / 255, 0x33 / 255] and not second["shown"] and made["cut"] == -2
    assert made["focus"] == pytest.approx([0.01, 0.005, 0.002])
    key = made["scales"][0]
    assert (key["label"], key["low"], key["high"]) == ("height (mm)", "0", "4")
    colours = array(key["colours"], "u1", 4)
    assert colours[0].tolist() == [0] * 4 and colours[1].tolist() == [0, 0, 0, 255] and colours[255, 0] == 255


def test_a_volume_is_transparent_where_it_is_unknown_and_thinned_where_it_is_large(monkeypatch):
    values = np.arange(24.0).reshape(2, 3, 4)
    values[0, 0, 0] = np.nan
    scale = ColourScale("", 0.0, 23.0, GREYS.colours)
    layer = VolumeLayer("map", values, np.array([0.1, 0.2, 0.3]), np.array([1e-3, 2e-3, 3e-3]), scale)
    made = scene(Panel([layer], "A map"))["volumes"][0]
    found = array(made["values"], "u1").reshape(made["shape"])
    assert found[0, 0, 0] == 0 and found[0, 0, 1] > 0 and found[1, 2, 3] == 255
    assert made["origin"] == [0.1, 0.2, 0.3] and made["spacing"] == [1e-3, 2e-3, 3e-3]
    monkeypatch.setattr(module, "MOST_VOXELS", 3)
    made = scene(Panel([layer], "A map"))["volumes"][0]
    assert made["shape"] == [1, 2, 2] and made["spacing"] == pytest.approx([2e-3, 4e-3, 6e-3])


def test_a_large_surface_is_coarser_and_has_nearly_the_same_area(monkeypatch):
    n = 60
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(0, 0.1, n), np.linspace(0, 0.1, n), indexing="ij"))
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = (each.ravel() for each in (number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]))
    tris = np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c])])
    at = np.column_stack([x, y, 0.01 * np.sin(30 * x)])
    monkeypatch.setattr(module, "MOST_TRIANGLES", 1500)
    layer = SurfaceLayer("wave", at, tris, values=1e3 * at[:, 2], scale=ColourScale("", -10, 10, GREYS.colours))
    made = scene(Panel([layer], "A wave"))
    found, kept = points(made, 0)
    assert 200 < len(kept) <= 1500 < len(tris) and area(found, kept) == pytest.approx(area(at, tris), rel=0.12)
    assert len(array(made["surfaces"][0]["values"], "u1")) == len(found)


def test_scan_and_labels_and_regions_of_a_mesh_in_one_scene():
    labels = nested((20.0, 14.0, 7.0))
    made = lattice(labels, RadialSizeField(5e-3, 5e-3)).elements
    t1 = Volume(50.0 + 40.0 * labels.volume.data * (labels.volume.data > 0), labels.volume.affine)
    panel = anatomy.panel(made, labels, t1, np.array([0, 5e-3, 0]))
    found = scene(panel)
    assert [each["name"] for each in found["surfaces"]] == [*made.regions, "elements at the surface"]
    assert [each["name"].split(" (")[0] for each in found["volumes"]] == ["scan", "labels"]
    assert found["volumes"][0]["shown"] and not found["volumes"][1]["shown"] and found["head"]
    outer, tris = points(found, found["surfaces"][-1]["shape"])
    wanted = outer_triangles(made.tets)
    assert len(tris) == len(wanted) and area(outer, tris) == pytest.approx(area(made.points, wanted), rel=1e-3)
    translucent = [each["name"] for each in found["surfaces"][:-1] if each["opacity"] < 1]
    assert translucent == [made.regions[0]]  # through which the others are seen
    assert found["focus"] == pytest.approx([0, 5e-3, 0], abs=1e-6)
    assert len(scan_layers(None, labels.volume.data, labels.regions, ["#000000"] * 3, np.zeros(3), np.ones(3))) == 1


def test_the_page_needs_no_network_and_escapes_names(tmp_path):
    panel = Panel([SurfaceLayer("</script><b>", *SQUARE)], "<i>Plate</i>", "A & B.")
    page = panel.write(tmp_path / "plate.html").read_text()
    assert not re.search(r"https?:|src=|import |fetch\(|XMLHttp|@import|url\(", page)
    assert page.count("</script>") == 1 and "<i>" not in page and "A &amp; B." in page
    assert html.unescape(re.search(r'srcdoc="([^"]*)"', panel._repr_html_())[1]) == panel.html()
    assert page.index('class="missing"') < page.index("<canvas") and 'class="live" hidden' in page  # until it works


def test_what_cannot_be_shown(monkeypatch):
    with pytest.raises(InputError, match="layers is empty"):
        Panel([SurfaceLayer("nothing", SQUARE[0], np.zeros((0, 3), int))], "Nothing")
    with pytest.raises(InputError, match="scale of plate is None"):
        Panel([SurfaceLayer("plate", *SQUARE, values=np.zeros(4))], "No colours")
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtra, match=r"ngbrain\[report\]"):
        ColourScale.of_map("x", 0, 1, "viridis")
