"""A head from voxels: names, volumes of the masks, exact planes, sound elements, the same bits twice, refusals."""

from types import SimpleNamespace

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.mesh import Cleft, Elements, LevelSet, Sizes, smallest_angles
from ngbrain.mesh.geometry.cleft import frame
from ngbrain.mesh.routes.cleft_head import head
from ngbrain.mesh.surface.head_outlines import Outlines

VOXEL = 2e-3
SEMI_AXES = np.array([66.0, 84.0, 60.0]) * 1e-3
VENTRICLE = np.array([12.0, 25.0, 10.0]) * 1e-3
CENTRE = np.array([0.0, 5.0, 5.0]) * 1e-3
TARGET = np.array([20.0, 10.0, 25.0]) * 1e-3
CRANIOTOMY = 40e-3
SIZES = Sizes(4e-3, 10e-3, 24e-3)
WALLS = {
    "wall_plus": (0, 2e-3),
    "wall_minus": (0, -2e-3),
    "end_plus": (1, 6e-3),
    "end_minus": (1, -6e-3),
    "floor": (2, 0),
}


@pytest.fixture(scope="module")
def scan():
    """Masks and outlines of nested ellipsoids."""
    axis = np.arange(-45, 46) * VOXEL
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    masks = [np.sum(((points - at) / axes) ** 2, axis=-1) <= 1 for at, axes in ((0, SEMI_AXES), (CENTRE, VENTRICLE))]
    brain, ventricles = (LevelSet.of(mask, np.full(3, axis[0]), VOXEL, 2e-3, 12e-3) for mask in masks)
    whole, inner = (mask.sum() * VOXEL**3 for mask in masks)
    shape = Outlines(brain, {"ventricles": ventricles}, ())
    return SimpleNamespace(brain=brain, outlines=shape, volume=whole, ventricle=inner)


def cleft_to(scan, target, opening=4e-3):
    out, across = frame(target / SEMI_AXES**2)
    depth = float(scan.brain.ray_distance(target[None], out, 0.1)[0])
    return Cleft(target, out, across, depth, opening, 12e-3)


@pytest.fixture(scope="module")
def cleft(scan):
    return cleft_to(scan, TARGET)


@pytest.fixture(scope="module")
def made(scan, cleft):
    return head(scan.outlines, cleft, CRANIOTOMY, SIZES).elements


def triangles(made, name):
    return made.triangles[made.boundary == made.boundaries.index(name)]


def area(made, name):
    a, b, c = np.moveaxis(made.points[triangles(made, name)], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def volume(made, name):
    return made.volumes()[made.region == made.regions.index(name)].sum()


def test_names(made):
    assert made.regions == ("brain", "ventricles")
    assert set(made.boundaries) == set(WALLS) | {"skull", "craniotomy", "ventricle_wall"}
    assert set(np.unique(made.region)) == {0, 1}
    assert set(np.unique(made.boundary)) == set(range(len(made.boundaries)))


def test_volumes_are_those_of_the_masks_less_the_slot(made, scan, cleft):
    slot = cleft.opening * cleft.width * cleft.depth
    assert volume(made, "brain") == pytest.approx(scan.volume - scan.ventricle - slot, rel=3e-3)
    assert volume(made, "ventricles") == pytest.approx(scan.ventricle, rel=2e-2)


@pytest.mark.parametrize("name", WALLS)
def test_walls_are_exact_planes(made, cleft, name):
    k, place = WALLS[name]
    where = cleft.coordinates(made.points[np.unique(triangles(made, name))])
    assert np.abs(where[:, k] - place).max() < 1e-12
    assert np.abs(where[:, 0]).max() < cleft.opening / 2 + 1e-12
    assert np.abs(where[:, 1]).max() < cleft.width / 2 + 1e-12
    assert where[:, 2].min() > -1e-12


def test_the_floor_is_whole_and_two_elements_across(made, cleft):
    assert area(made, "floor") == pytest.approx(cleft.opening * cleft.width, rel=1e-12)
    a = cleft.coordinates(made.points[np.unique(triangles(made, "floor"))])[:, 0]
    assert len(np.unique(np.round(a, 9))) >= 3
    assert np.abs(cleft.coordinates(made.points[triangles(made, "floor")].mean(axis=1))[:, 0]).min() > 1e-4


def test_walls_reach_the_surface(made, cleft):
    for name, length in (("wall", cleft.width), ("end", cleft.opening)):
        both = area(made, f"{name}_plus") + area(made, f"{name}_minus")
        assert both == pytest.approx(2 * length * cleft.depth, rel=0.02)


def test_the_craniotomy_is_a_disc_less_the_slot(made, cleft):
    disc = np.pi * CRANIOTOMY**2 / 4 - cleft.opening * cleft.width
    assert 0.98 < area(made, "craniotomy") / disc < 1.06
    a, b, _ = cleft.coordinates(made.points[np.unique(triangles(made, "craniotomy"))]).T
    assert np.hypot(a, b).max() == pytest.approx(CRANIOTOMY / 2, rel=0.03)


def test_surface_and_ventricle_follow_the_outlines(made, scan):
    # Moved outwards so that flat triangles enclose the volume: by the order of the sagitta of coarse ones.
    for level, name, most in ((scan.brain, "skull", 1.5e-3), (scan.outlines.ventricles, "ventricle_wall", 4.5e-3)):
        points = made.points[np.unique(triangles(made, name))]
        assert np.abs(level(points)).max() < most


def test_boundaries_close_around_each_region(made):
    hull = np.concatenate([triangles(made, name) for name in made.boundaries if name != "ventricle_wall"])
    for surface in (hull, triangles(made, "ventricle_wall")):
        edges = surface[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
        every = {(a, b) for a, b in edges}
        assert len(every) == len(edges) and every == {(b, a) for a, b in every}


def test_elements_are_sound(made):
    assert made.volumes().min() > 0
    assert smallest_angles(made.points[made.tets]).min() > 3


def test_the_same_bits_twice(made, scan, cleft):
    again = head(scan.outlines, cleft, CRANIOTOMY, SIZES).elements.arrays()
    assert all(values.tobytes() == again[key].tobytes() for key, values in made.arrays().items())


def test_arrays_give_the_elements_back(made, tmp_path):
    np.savez(tmp_path / "head.npz", **made.arrays())
    with np.load(tmp_path / "head.npz", allow_pickle=False) as file:
        back = Elements.from_arrays(dict(file))
    assert (back.regions, back.boundaries) == (made.regions, made.boundaries)
    for key in ("points", "tets", "region", "triangles", "boundary"):
        assert np.array_equal(getattr(back, key), getattr(made, key))


def test_the_mesh_integrates_to_the_same(made):
    mesh = made.mesh()
    assert mesh.GetMaterials() == made.regions and set(mesh.GetBoundaries()) == set(made.boundaries)
    for name in made.regions:
        integral = ngs.Integrate(ngs.CF(1), mesh, definedon=mesh.Materials(name))
        assert integral == pytest.approx(volume(made, name), rel=1e-10)
    for name in made.boundaries:
        integral = ngs.Integrate(ngs.CF(1), mesh, definedon=mesh.Boundaries(name))
        assert integral == pytest.approx(area(made, name), rel=1e-10)


def test_finer_elements_near_the_cleft_are_as_fine_as_asked(scan, cleft):
    fine = head(scan.outlines, cleft, CRANIOTOMY, Sizes(3e-3, 8e-3, 20e-3)).elements
    for name in ("wall_plus", "end_minus", "floor"):
        corners = fine.points[triangles(fine, name)]
        sides = np.sort(np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2), axis=1)
        assert sides[:, 1].max() < 1.2 * 3e-3  # all but the diagonal


@pytest.mark.parametrize("height", [7e-3, 15.5e-3, -15e-3])
def test_a_cleft_through_a_ventricle_is_refused(scan, height):
    # The floor in it; the floor within its clearance; the walls through it.
    target = np.array([*CENTRE[:2], height])
    out, across = frame(np.array([0, 0, 1.0]))
    depth = float(scan.brain.ray_distance(target[None], out, 0.1)[0])
    with pytest.raises(InputError, match=r"cleft\.target_mm is .* opens a ventricle"):
        head(scan.outlines, Cleft(target, out, across, depth, 4e-3, 12e-3), CRANIOTOMY, SIZES)


def test_a_craniotomy_over_the_edge_is_refused(scan, cleft):
    with pytest.raises(InputError, match=r"cleft\.craniotomy_mm is 110; wanted: less"):
        head(scan.outlines, cleft, 110e-3, SIZES)


def test_walls_that_do_not_end_on_the_surface_are_refused(scan):
    target = np.array([0, 0, 50e-3])
    cleft = Cleft(target, np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), 30e-3, 30e-3, 12e-3)
    with pytest.raises(InputError, match=r"cleft\.approach"):
        head(scan.outlines, cleft, CRANIOTOMY, SIZES)
