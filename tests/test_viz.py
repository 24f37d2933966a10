"""Pictures for a notebook: what they show, and what is said when they cannot."""

import numpy as np
import pytest
from phantoms import nested

from ngbrain import viz
from ngbrain.errors import InputError, MissingExtra
from ngbrain.image.volume import Volume
from ngbrain.mesh.grading import Graded
from ngbrain.mesh.lattice import lattice

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def head():
    labels = nested((20.0, 14.0, 7.0))
    return labels, lattice(labels, Graded(5e-3, 5e-3)).elements


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


def test_a_mesh_to_turn(head):
    import ngsolve as ngs

    _, made = head
    mesh = made.mesh()
    scene = viz.interactive(mesh, at=(0, 5e-3, 0), show=False)
    data = scene.GetData()
    assert data["funcmin"] == 0 and data["funcmax"] == 2  # three regions
    assert not data["autoscale"] and data["clipping_function"] and data["clipping_y"] == 1
    assert data["mesh_center"][1] - data["clipping_dist"] == pytest.approx(5e-3, abs=1e-9)
    data = viz.interactive(mesh, ngs.x, show=False).GetData()
    assert data["funcmax"] == pytest.approx(made.points[:, 0].max(), rel=1e-3)
    assert "clipping_dist" in scene.GenerateHTML()


def test_what_cannot_be_shown(head, monkeypatch):
    labels, made = head
    with pytest.raises(InputError, match=r"at is \(1, 2\); wanted: three numbers, m"):
        viz.slices(made, labels, at=(1, 2))
    with pytest.raises(InputError, match="at is "):
        viz.interactive(made.mesh(), at=(0, np.nan, 0))
    monkeypatch.setitem(__import__("sys").modules, "IPython.display", None)
    with pytest.raises(MissingExtra, match=r"ngbrain\[viz\]"):
        viz.quality(made)
