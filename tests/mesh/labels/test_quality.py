"""Mesh quality and agreement with labels, on shapes with known values."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.labels.indicators import Indicators
from ngbrain.mesh.quality import Quality, deviations, interfaces, radius_ratios, volume_errors, volumes_ml
from ngbrain.mesh.tet_mesh import Elements

MM = 1e-3


def nested(radii=(15.0, 8.0), n=40):
    distance = np.linalg.norm(np.indices((n, n, n)) - (n - 1) / 2, axis=0)
    numbers = sum((distance < r).astype(np.int16) for r in radii)
    affine = np.diag([MM, MM, MM, 1.0])
    affine[:3, 3] = -(n - 1) / 2 * MM
    return LabelMap(Volume(numbers, affine), {1: "grey", 2: "white"})


def two_tets():
    """A cube's corner and its neighbour across a face, in two regions."""
    points = MM * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
    tets = np.array([[1, 0, 2, 3], [1, 2, 4, 3]])
    none = np.zeros((0, 3), int)
    return Elements(points, tets, np.array([0, 1]), none, np.zeros(0, int), ("grey", "white"), ())


def test_a_regular_tetrahedron_is_one_and_a_flat_one_zero():
    regular = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])
    flat = regular * [1, 1, 1e-6]
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    ratios = radius_ratios(np.array([regular, 7 * regular, corner, flat]))
    # A corner of a cube: r_in = 1/(3 + √3), r_circ = √3/2.
    assert ratios == pytest.approx([1, 1, 6 / (3 + 3**0.5) / 3**0.5, 0], abs=1e-5)


def test_volumes_interfaces_and_shapes_of_two_elements():
    mesh = two_tets()
    assert volumes_ml(mesh) == pytest.approx({"grey": 1e-3 / 6, "white": 1e-3 / 3})
    triangles, pairs = interfaces(mesh)
    assert len(triangles) == 7 and (pairs == (1, 2)).all(axis=1).sum() == 1
    assert triangles[(pairs == (1, 2)).all(axis=1)].tolist() == [[1, 2, 3]]
    assert sorted(map(tuple, pairs.tolist())) == [(0, 1)] * 3 + [(0, 2)] * 3 + [(1, 2)]
    quality = Quality.of(mesh).summary()
    assert quality["n_tets"] == 2 and quality["fraction_radius_ratio_below_0_1"] == 0
    assert quality["min_dihedral_deg"] == pytest.approx(np.degrees(np.arccos(1 / 3**0.5)))


def test_distance_from_where_two_regions_meet():
    indicators = Indicators.of(nested())
    directions = np.random.default_rng(0).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for a, b, radius in ((0, 1, 15.0), (1, 2, 8.0)):
        for off in (-0.5, 0.0, 0.5):
            found = indicators.distance(MM * (radius + off) * directions, a, b)
            print(a, b, off, found.mean() / MM)
            assert found.mean() / MM == pytest.approx(
                abs(off), abs=0.17
            )  # of first order: off the interface the slope falls
    inside, between = indicators.region(np.zeros((1, 3))), indicators.region(np.array([[0.0115, 0, 0]]))
    assert (inside, between, indicators.region(np.array([[0.1, 0, 0]]))) == (2, 1, 0)


def test_deviations_are_of_the_triangles_asked_for():
    mesh, indicators = two_tets(), Indicators.of(nested())
    found = deviations(mesh, indicators)
    assert set(found) == {(0, 1), (0, 2), (1, 2)} and len(found[1, 2]) == 4
    assert deviations(mesh, indicators, lambda points: np.zeros(len(points), bool)) == {}
    assert volume_errors(mesh, nested())["white"] == pytest.approx(
        volumes_ml(mesh)["white"] / nested().volumes_ml()["white"] - 1
    )


def test_labels_have_names():
    volume = nested().volume
    with pytest.raises(InputError, match=r"labels is without a name for \[2\]"):
        LabelMap(volume, {1: "grey"})
    with pytest.raises(InputError, match="labels is made of float64 numbers"):
        LabelMap(Volume(volume.data.astype(float), volume.affine), {1: "grey", 2: "white"})
    merged = LabelMap(volume, {1: "brain", 2: "brain", 3: "lesion"})
    assert merged.regions == ("brain",) and set(np.unique(merged.region_numbers())) == {0, 1}
