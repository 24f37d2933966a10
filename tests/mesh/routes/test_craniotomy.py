"""Clefts in meshes whose tissues conform, and in hulls: walls on their planes, the volume cut away, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from phantoms import nested, turned
from resampled_scans import rotation

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.geometry.sizing import CleftSizeField, RadialSizeField
from ngbrain.mesh.quality import Quality, interfaces, volumes_ml
from ngbrain.mesh.routes.cleft_subtraction import SIDES, fit_cleft_walls, remove_cleft
from ngbrain.mesh.routes.craniotomy import Opening, mesh_with_cleft
from ngbrain.mesh.routes.registry import ROUTES

MM = 1e-3
TISSUES = ("lattice", "conforming")
CUT = Opening((6 * MM, 4 * MM, 12 * MM), opening=5 * MM, width=10 * MM, craniotomy=24 * MM, approach=(0.3, 0.1, 1.0))


@pytest.fixture(scope="module")
def labels():
    return nested((30.0, 20.0, 7.0))


@pytest.fixture(scope="module", params=TISSUES)
def made(request, labels):
    left, found = mesh_with_cleft(labels, CUT, request.param, 2 * MM, 4 * MM)
    return request.param, left, found.elements


def corners(mesh, name):
    return mesh.points[mesh.triangles[mesh.boundary == mesh.boundaries.index(name)]]


def areas(x):
    return np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]) / 2


def test_walls_are_on_their_planes_and_as_large_as_asked(made, labels):
    route, _, mesh = made
    cleft, least = CUT.cleft(labels), {"lattice": 0.8, "conforming": 0.75}[route]
    wanted = {0: cleft.width * cleft.depth, 1: cleft.opening * cleft.depth, 2: cleft.opening * cleft.width}
    half = np.array([cleft.opening / 2, cleft.width / 2, 0])
    for name, (axis, side) in SIDES.items():
        x = corners(mesh, name)
        assert np.linalg.norm(areas(x), axis=1).sum() == pytest.approx(wanted[axis], rel=0.2), name
        off = np.abs(side * cleft.coordinates(x.mean(axis=1))[:, axis] - half[axis])
        assert off.mean() < 0.35 * MM and off.max() < 1.5 * MM, name
        out_of_tissue = -side * np.stack([cleft.across, cleft.along, cleft.out])[axis]
        assert areas(x).sum(axis=0) @ out_of_tissue > least * wanted[axis]


def test_the_cleft_is_empty_and_the_rest_is_there(made, labels):
    _, left, mesh = made
    cleft = CUT.cleft(labels)
    missing = sum(labels.volumes_ml().values()) - sum(left.volumes_ml().values())
    assert missing == pytest.approx(1e6 * cleft.opening * cleft.width * cleft.depth, rel=0.05)
    assert sum(volumes_ml(mesh).values()) == pytest.approx(sum(left.volumes_ml().values()), rel=5e-3)
    a, b, height = np.abs(cleft.coordinates(mesh.points[mesh.tets].mean(axis=1)).T)
    within = (a < cleft.opening / 2 - MM) & (b < cleft.width / 2 - MM) & (height > MM) & (height < cleft.depth)
    inside = cleft.coordinates(mesh.points[mesh.tets].mean(axis=1))[:, 2] > 0
    assert not (within & inside).any()


def test_elements_stay_sound_and_boundaries_are_all_there(made, labels):
    route, _, mesh = made
    quality = Quality.of(mesh)
    assert mesh.volumes().min() > 0 and quality.dihedrals.min() > (8 if route == "lattice" else 3)
    assert (quality.ratios < 0.1).mean() <= (1e-4 if route == "lattice" else 1e-3)
    assert len(interfaces(mesh)[0]) == len(mesh.triangles) and not mesh.mesh().Boundaries("default").Mask().NumSet()
    lid, cleft = corners(mesh, "craniotomy").mean(axis=1), CUT.cleft(labels)
    a, b, height = cleft.coordinates(lid).T
    assert (np.hypot(a, b) < 12 * MM).all() and height.min() > cleft.depth / 2
    other = corners(mesh, "outer_grey").mean(axis=1)
    a, b, height = cleft.coordinates(other).T
    assert np.mean((np.hypot(a, b) < 12 * MM) & (height > 0)) < 0.05  # what is left are the cleft's edges


def test_the_same_cleft_in_a_hull_has_exact_planes(labels):
    _, found = mesh_with_cleft(labels, CUT, "hull", 2.5 * MM, 6 * MM)
    mesh, cleft = found.elements, CUT.cleft(labels)
    local = cleft.coordinates(corners(mesh, "wall_plus").reshape(-1, 3))
    assert np.abs(local[:, 0] - cleft.opening / 2).max() < 1e-9
    assert {"skull", "craniotomy", "ventricle_wall", *SIDES} == set(mesh.boundaries)
    _, found = mesh_with_cleft(nested((30.0, 20.0), ("grey", "white")), CUT, "hull", 2.5 * MM, 6 * MM)
    assert found.elements.regions == ("brain",) and "ventricle_wall" not in found.elements.boundaries


def test_lesions_are_regions_of_a_hull_that_is_cut_unless_the_cleft_touches_them(labels):
    data = labels.volume.data.copy()
    at = labels.volume.to_world(np.argwhere(np.ones_like(data))).reshape(*data.shape, 3)
    for number, centre in ((4, (-14, 0, 8)), (5, (6, 6, 13))):
        data[np.linalg.norm(at - MM * np.array(centre), axis=-1) < 4 * MM] = number
    both = LabelMap(Volume(data, labels.volume.affine), {**labels.names, 4: "tumour", 5: "lesion"})
    left, found = mesh_with_cleft(both, CUT, "hull", 2.5 * MM, 6 * MM)
    mesh = found.elements
    assert mesh.regions == ("brain", "ventricles", "tumour") and "tumour_wall" in mesh.boundaries
    assert volumes_ml(mesh)["tumour"] == pytest.approx(left.volumes_ml()["tumour"], rel=0.05)
    assert mesh.volumes().min() > 0 and areas(corners(mesh, "tumour_wall")).sum(axis=0) == pytest.approx(0, abs=1e-9)


def test_a_turned_head_is_cut_at_the_same_place(labels):
    turn = rotation(25, np.array([1.0, 2.0, 0.5]))
    cut = replace(CUT, target=tuple(turn @ CUT.target), approach=tuple(turn @ CUT.approach))
    there = cut.cleft(turned(labels, turn))
    assert there.depth == pytest.approx(CUT.cleft(labels).depth, abs=0.3 * MM)
    left = remove_cleft(turned(labels, turn), there)
    assert sum(left.volumes_ml().values()) == pytest.approx(
        sum(remove_cleft(labels, CUT.cleft(labels)).volumes_ml().values()), rel=0.01
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"target": (0.0, 0.0, 40 * MM)},
            r"cleft.target_mm is \(0.0, 0.0, 40.0\) mm; wanted: a point inside the brain",
        ),
        ({"target": (0.0, 0.0, 2 * MM)}, "a point in tissue, not in a ventricle"),
        ({"opening": 0.0}, "cleft.opening_mm is 0; wanted: a length above 0"),
        ({"craniotomy": 11 * MM}, "cleft.craniotomy_mm is 11; wanted: at least 11.18, the diagonal of the cleft"),
        ({"opening": 3 * MM}, "mesh size is 2 mm near and 4 mm far; wanted: at most 1.5 mm near, for a cleft of 3 mm"),
        ({"target": (8.0 * MM, 0.0, 0.0), "approach": (0.0, 0.0, 1.0)}, "a cleft that opens a ventricle"),
    ],
)
def test_refusals(labels, change, message):
    with pytest.raises(InputError, match=message) as caught:
        mesh_with_cleft(labels, replace(CUT, **change), "lattice", 2 * MM, 4 * MM)
    assert "\n" not in str(caught.value)


def test_sizes_grow_from_the_walls(labels):
    cleft = CUT.cleft(labels)
    size = CleftSizeField(cleft, 2 * MM, 4 * MM)
    at = cleft.target + np.outer([0, 2.5e-3, 5e-3, 50e-3], cleft.across)
    assert size(at) == pytest.approx([2e-3 + 0.3 * 2.5e-3, 2e-3, 2e-3 + 0.3 * 2.5e-3, 4e-3])


def test_a_cut_that_takes_a_whole_region(labels):
    data = labels.volume.data.copy()
    at = labels.volume.to_world(np.argwhere(np.ones_like(data)))
    local = CUT.cleft(labels).coordinates(at) - [0, 0, 5 * MM]
    data.ravel()[(np.abs(local) < 1.5 * MM).all(axis=1)] = 4
    with_speck = LabelMap(Volume(data, labels.volume.affine), {**labels.names, 4: "lesion"})
    with pytest.raises(InputError, match="a cleft that takes all of lesion; wanted: another cleft"):
        remove_cleft(with_speck, CUT.cleft(labels))


def test_walls_that_a_mesh_is_too_coarse_for(labels):
    cleft = CUT.cleft(labels)
    coarse = ROUTES["lattice"].make(labels, RadialSizeField(6 * MM, 6 * MM)).elements
    with pytest.raises(InputError, match=r"such that the cleft has no \w+; wanted: smaller elements near it"):
        fit_cleft_walls(coarse, cleft, CUT.craniotomy, MM)
