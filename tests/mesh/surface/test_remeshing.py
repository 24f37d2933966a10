"""Triangles on balls and a torus: closed, outwards, of the right genus and the size asked, the same bits twice."""

import numpy as np
import pytest

from ngbrain.mesh import LevelSet
from ngbrain.mesh.surface.remeshing import remesh_surface

VOXEL = 1e-3
NONE = np.zeros((0, 3))
RADIUS = 18e-3


def voxelised(inside):
    """The smoothed outline of the set `inside(x, y, z)` ≤ 0, within 32 mm of the origin."""
    axis = np.arange(-32, 33) * VOXEL
    mask = inside(*np.meshgrid(axis, axis, axis, indexing="ij")) <= 0
    return LevelSet.of(mask, np.full(3, axis[0]), VOXEL, smoothing=1e-3, margin=6e-3)


def balls(gap, r=12e-3):
    return lambda x, y, z: (np.abs(x) - r - gap / 2) ** 2 + y**2 + z**2 - r**2


def same(size):
    return lambda points: np.full(len(points), size)


def graded(points):
    return np.clip(2e-3 + 0.3 * np.linalg.norm(points - [0, 0, RADIUS], axis=1), 2e-3, 8e-3)


SHAPES = {
    "ball": (lambda x, y, z: x**2 + y**2 + z**2 - RADIUS**2, same(5e-3), 2),
    "graded ball": (lambda x, y, z: x**2 + y**2 + z**2 - RADIUS**2, graded, 2),
    "torus": (lambda x, y, z: (np.hypot(x, y) - 20e-3) ** 2 + z**2 - 8e-3**2, same(4e-3), 0),
    "touching balls": (balls(0.0), same(4e-3), 2),
    "near balls": (balls(3e-3), same(4e-3), 4),
}


@pytest.fixture(scope="module", params=SHAPES)
def made(request):
    inside, size, euler = SHAPES[request.param]
    level = voxelised(inside)
    surface = remesh_surface(level, size, NONE)
    assert not len(surface.changed)
    return level, size, euler, surface.points, surface.triangles


@pytest.fixture(scope="module")
def ball():
    return voxelised(SHAPES["ball"][0])


def edges(triangles):
    return triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)


def test_every_edge_has_two_triangles_of_opposite_directions(made):
    *_, triangles = made
    every = {(a, b) for a, b in edges(triangles).tolist()}
    assert len(every) == 3 * len(triangles)
    assert every == {(b, a) for a, b in every}


def test_the_euler_characteristic_is_the_shapes(made):
    _, _, euler, points, triangles = made
    assert np.array_equal(np.unique(triangles), np.arange(len(points)))
    assert len(points) - len(edges(triangles)) // 2 + len(triangles) == euler


def test_triangles_face_outwards_and_enclose_the_shape(made):
    level, _, _, points, triangles = made
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert 0.9 < volume / (np.sum(level.values < 0) * VOXEL**3) < 1.0
    normals = level.normals((a + b + c) / 3)
    assert np.mean(np.einsum("ij,ij->i", np.cross(b - a, c - a), normals) > 0) > 0.99


def test_vertices_lie_on_the_surface(made):
    level, _, _, points, _ = made
    assert np.abs(level(points)).max() < 1e-3 * VOXEL


def test_edges_are_as_long_as_asked(made):
    _, size, _, points, triangles = made
    ends = points[edges(triangles)]
    relative = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / size(ends.mean(axis=1))
    assert relative.min() > 0.5 and relative.max() < 1.6
    assert relative.mean() == pytest.approx(1, abs=0.05)


def test_the_same_bits_twice(made):
    level, size, _, points, triangles = made
    again = remesh_surface(level, size, NONE)
    assert np.array_equal(points, again.points) and np.array_equal(triangles, again.triangles)


def test_another_seed_gives_other_points(ball):
    first, second = (remesh_surface(ball, same(6e-3), NONE, seed=seed).points for seed in (0, 1))
    assert not np.array_equal(first, second)


def test_fixed_points_come_first_and_neighbours_stay_joined(ball):
    n = 24
    angle = 2 * np.pi * np.arange(n) / n
    ring = ball.project(RADIUS * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1))
    surface = remesh_surface(ball, same(5e-3), ring)
    points, triangles = surface.points, surface.triangles
    assert np.array_equal(points[:n], ring)
    joined = set(map(tuple, edges(triangles).tolist()))
    assert all((i, (i + 1) % n) in joined for i in range(n))
