"""Heads with a lesion and with the cavity that its resection leaves, by every route."""

import numpy as np
import pytest
from phantoms import nested

from ngbrain.errors import InputError
from ngbrain.image import mni152
from ngbrain.image.labelling import label_tissues
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.image.segment.topology import clean_labels
from ngbrain.mesh.geometry.sizing import RadialSizeField
from ngbrain.mesh.quality import Quality, interfaces, volumes_ml
from ngbrain.mesh.routes.registry import ROUTES
from ngbrain.mesh.surface.head_outlines import WALL

MM = 1e-3
EVEN = RadialSizeField(3 * MM, 3 * MM)


def painted(labels, centre, radius, number, name="lesion", within=None):
    """Paint a ball with a label into a label map; `number` 0 removes it."""
    data = labels.volume.data.copy()
    at = labels.volume.to_world(np.argwhere(np.ones_like(data))).reshape(*data.shape, 3)
    ball = (np.linalg.norm(at - np.array(centre), axis=-1) < radius) & (data > 0)
    data[ball & np.isin(data, within or np.unique(data))] = number
    return LabelMap(Volume(data, labels.volume.affine), {**labels.names, **({number: name} if number else {})})


@pytest.fixture(scope="module")
def head():
    return nested((30.0, 22.0, 7.0))


def sound(made, route):
    quality = Quality.of(made)
    assert made.volumes().min() > 0 and quality.dihedrals.min() > (8 if route == "lattice" else 3)
    assert (quality.ratios < 0.1).mean() <= (1e-4 if route == "lattice" else 1e-3)
    triangles, pairs = interfaces(made)
    outer = triangles[pairs[:, 0] == 0]
    edges = np.sort(outer[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all()


def areas(x):
    return np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 2


def area(made, name):
    return areas(made.points[made.triangles[made.boundary == made.boundaries.index(name)]]).sum()


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("place", ["in white matter", "at a ventricle", "at the surface"])
def test_a_lesion_is_a_region(route, place, head):
    at = {"in white matter": 15.0, "at a ventricle": 11.0, "at the surface": 25.0}[place]
    labels = painted(head, (at * MM, 0, 0), 6 * MM, 4, within=[1, 2])
    made = ROUTES[route].make(labels, EVEN).elements
    sound(made, route)
    found, wanted = volumes_ml(made)["lesion"], labels.volumes_ml()["lesion"]
    # A hull keeps tissue between a lesion and what it touches.
    least = 0.55 if route == "hull" and place != "in white matter" else 0.97
    assert least * wanted < found < 1.03 * wanted
    assert sum(volumes_ml(made).values()) == pytest.approx(sum(labels.volumes_ml().values()), rel=0.01)
    if place == "in white matter":
        name = "lesion_wall" if route == "hull" else "white_lesion"
        assert area(made, name) == pytest.approx(4 * np.pi * 36e-6, rel=0.08)


def test_the_wall_of_a_lesion_turns_outwards_and_keeps_away_from_ventricles(head):
    labels = painted(head, (11 * MM, 0, 0), 6 * MM, 4, within=[1, 2])
    made = ROUTES["hull"].make(labels, EVEN).elements
    for name in ("lesion", "ventricles"):
        wall = made.boundaries.index("lesion_wall" if name == "lesion" else "ventricle_wall")
        a, b, c = np.moveaxis(made.points[made.triangles[made.boundary == wall]], 1, 0)
        flow = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        assert 1e6 * flow == pytest.approx(volumes_ml(made)[name], rel=1e-6)
    walls = [
        made.points[np.unique(made.triangles[made.boundary == made.boundaries.index(n)])]
        for n in ("lesion_wall", "ventricle_wall")
    ]
    gap = np.linalg.norm(walls[0][:, None] - walls[1], axis=2).min()
    assert gap > 0.6 * WALL


@pytest.mark.parametrize("route", ROUTES)
def test_a_core_in_a_lesion_is_another_region_or_refused(route, head):
    labels = painted(painted(head, (0, 0, 15 * MM), 7 * MM, 4), (0, 0, 15 * MM), 4 * MM, 5, "tumour_core")
    if route == "hull":
        with pytest.raises(
            InputError, match=r"such that tumour_core is too thin, or too close to .*lesion.*; wanted: 2 mm"
        ):
            ROUTES[route].make(labels, EVEN)
        return
    made = ROUTES[route].make(labels, EVEN).elements
    sound(made, route)
    assert {"lesion", "tumour_core"} <= set(made.regions)
    assert volumes_ml(made)["tumour_core"] == pytest.approx(labels.volumes_ml()["tumour_core"], rel=0.12)


@pytest.mark.parametrize("route", ROUTES)
def test_a_cavity_that_is_open_to_the_outside(route, head):
    labels = painted(head, (0, 0, 26 * MM), 9 * MM, 0)
    made = ROUTES[route].make(labels, EVEN).elements
    sound(made, route)
    assert sum(volumes_ml(made).values()) == pytest.approx(sum(labels.volumes_ml().values()), rel=0.01)
    within = np.linalg.norm(made.points[made.tets].mean(axis=1) - np.array([0, 0, 26 * MM]), axis=1) < 7 * MM
    assert not within.any()


@pytest.mark.parametrize("route", ROUTES)
def test_a_cavity_that_is_closed_stays_hollow_or_is_said_to_be_filled(route, head):
    centre = np.array([0, 0, 17.5]) * MM
    labels, _ = clean_labels(painted(head, centre, 6.5 * MM, 0))
    hollow = sum(head.volumes_ml().values()) - sum(labels.volumes_ml().values())
    assert hollow > 1
    made = ROUTES[route].make(labels, EVEN).elements
    sound(made, route)
    if route == "hull":
        assert "hollows (filled)" in ROUTES[route].left_out
        assert sum(volumes_ml(made).values()) == pytest.approx(sum(head.volumes_ml().values()), rel=0.01)
    else:
        assert sum(volumes_ml(made).values()) == pytest.approx(sum(labels.volumes_ml().values()), rel=0.01)
        inner = np.array([name.startswith("outer") for name in made.boundaries])[made.boundary]
        x = made.points[made.triangles[inner]]
        x = x[np.linalg.norm(x.mean(axis=1) - centre, axis=1) < 8 * MM]
        assert areas(x).sum() == pytest.approx(4 * np.pi * 42.25e-6, rel=0.08)


def operated():
    """The MNI152 brain with a lesion of 20 mm in white matter on the left and a cavity of 24 mm on the right."""
    labels = label_tissues(mni152()).labels
    labels = painted(labels, (-28 * MM, -10 * MM, 28 * MM), 10 * MM, 5, within=[3])
    return painted(labels, (42 * MM, 20 * MM, 40 * MM), 12 * MM, 0)


@pytest.mark.slow
@pytest.mark.parametrize("route", ROUTES)
def test_a_head_with_a_lesion_and_a_cavity(route):
    labels, _ = clean_labels(operated())
    size = RadialSizeField(2 * MM, 8 * MM, (-28 * MM, -10 * MM, 28 * MM), ROUTES[route].radius)
    made = ROUTES[route].make(labels, size).elements
    sound(made, route)
    found, wanted = volumes_ml(made), labels.volumes_ml()
    print(route, len(made.tets), Quality.of(made).summary(), found, wanted)
    assert found["lesion"] == pytest.approx(wanted["lesion"], rel=0.02)
    assert sum(found.values()) == pytest.approx(sum(wanted.values()), rel=0.01)
    assert len(made.tets) <= 80_000
    centre = np.array([42, 20, 40]) * MM
    assert not (np.linalg.norm(made.points[made.tets].mean(axis=1) - centre, axis=1) < 6 * MM).any()
