"""A voxelised ellipsoid as a signed distance: its volume, surface, normals and distances against closed forms."""

import numpy as np
import pytest

from ngbrain.mesh import LevelSet

VOXEL = 1e-3
CENTRE = np.array([3.3, -2.6, 1.7]) * 1e-3  # between the grid's points
RADIUS = 20e-3
SEMI_AXES = np.array([20.0, 28.0, 16.0]) * 1e-3


def voxelised(semi_axes):
    """The smoothed outline of an ellipsoid in a grid with room to spare, and its mask."""
    origin = np.array([-40.0, -44.0, -36.0]) * 1e-3
    points = origin + VOXEL * np.moveaxis(np.indices((81, 89, 73)), 0, -1)
    mask = np.sum(((points - CENTRE) / semi_axes) ** 2, axis=-1) <= 1
    return LevelSet.of(mask, origin, VOXEL, smoothing=1.5e-3, margin=8e-3), mask


@pytest.fixture(scope="module")
def ball():
    return voxelised(np.full(3, RADIUS))


@pytest.fixture(scope="module")
def ellipsoid():
    return voxelised(SEMI_AXES)


@pytest.fixture
def directions(rng):
    u = rng.normal(size=(300, 3))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def way_out(start, direction, semi_axes):
    """Distance (n,) from points inside the ellipsoid to its surface: the positive root."""
    p, d = (start - CENTRE) / semi_axes, direction / semi_axes
    a, b, c = d @ d, p @ d, np.sum(p * p, axis=1) - 1
    return (-b + np.sqrt(b * b - a * c)) / a


@pytest.mark.parametrize("shape", ["ball", "ellipsoid"])
def test_the_volume_is_the_masks(shape, request):
    level, mask = request.getfixturevalue(shape)
    assert np.sum(level.values < 0) == mask.sum()
    assert level.spacing == VOXEL


def test_the_grid_has_the_margin_asked_for(ellipsoid):
    level, _ = ellipsoid
    last = level.origin + VOXEL * (np.array(level.values.shape) - 1)
    for border, side in ((level.origin, -1), (last, 1)):
        room = side * (border - CENTRE) - SEMI_AXES
        assert (room > 7e-3 - 1e-9).all() and (room < 8e-3 + 1e-9).all()


def test_values_are_the_distance_to_a_ball(ball, directions):
    level, _ = ball
    radii = np.linspace(14e-3, 26e-3, len(directions))
    assert np.abs(level(CENTRE + radii[:, None] * directions) - (radii - RADIUS)).max() < 0.5 * VOXEL


def test_values_are_linear_between_grid_points_and_constant_beyond(ball):
    level, _ = ball
    corner = level.values[10, 12, 14]
    at = level.origin + VOXEL * np.array([[10, 12, 14], [10.25, 12, 14]])
    assert level(at) == pytest.approx([corner, 0.75 * corner + 0.25 * level.values[11, 12, 14]], rel=1e-6)
    border = level.origin + VOXEL * np.array([0, 20, 20])
    assert level(border - [0.1, 0, 0]) == pytest.approx(level(border), rel=1e-12)


def test_normals_are_those_of_the_ball(ball, directions):
    level, _ = ball
    normals = level.normals(CENTRE + RADIUS * directions)
    size = np.linalg.norm(normals, axis=1)
    assert np.abs(size - 1).max() < 0.15
    assert np.einsum("ij,ij->i", normals, directions / size[:, None]).min() > np.cos(np.radians(8))


@pytest.mark.parametrize("wanted", [0.0, -2e-3, 3e-3])
def test_projected_points_lie_on_the_level_and_on_the_sphere(ball, directions, wanted):
    level, _ = ball
    start = CENTRE + 1.2 * RADIUS * directions
    before = start.copy()
    points = level.project(start, wanted)
    assert np.array_equal(start, before)
    assert np.abs(level(points) - wanted).max() < 1e-9
    assert np.abs(np.linalg.norm(points - CENTRE, axis=1) - RADIUS - wanted).max() < 0.5 * VOXEL


def test_points_are_projected_onto_the_ellipsoid_from_all_over_the_grid(ellipsoid, directions):
    level, _ = ellipsoid
    for part in (0.5, 0.8, 1.2):
        points = level.project(CENTRE + part * SEMI_AXES * directions)
        relative = np.linalg.norm((points - CENTRE) / SEMI_AXES, axis=1)
        assert np.abs(relative - 1).max() < 0.5 * VOXEL / SEMI_AXES.min()


def test_along_is_the_way_to_the_surface(ellipsoid, directions, rng):
    level, _ = ellipsoid
    start = CENTRE + 0.7 * rng.random((len(directions), 1)) * SEMI_AXES * directions
    for direction in (np.array([0.48, 0.6, 0.64]), np.array([0, -1.0, 0])):
        way = level.ray_distance(start, direction, 70e-3)
        assert np.abs(way - way_out(start, direction, SEMI_AXES)).max() < 0.6 * VOXEL
        assert np.abs(level(start + way[:, None] * direction)).max() < 0.05 * VOXEL


def test_along_is_nan_where_the_surface_is_not_met(ellipsoid):
    level, _ = ellipsoid
    up = np.array([0, 0, 1.0])
    start = CENTRE + np.array([[0, 0, 0], [0, 0, 12e-3], [0, 0, 22e-3], [0, 0, -22e-3]])
    # Too far; near enough; from outside, away from and towards the shape.
    assert np.isnan(level.ray_distance(start, up, 10e-3)).tolist() == [True, False, True, True]


def test_the_outline_is_closed_and_on_the_surface(ball):
    pytest.importorskip("skimage")
    level, mask = ball
    a, b, c = np.moveaxis(level.outline(), 1, 0)
    assert np.abs(np.linalg.norm(a - CENTRE, axis=1) - RADIUS).max() < 0.5 * VOXEL
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(4 * np.pi * RADIUS**2, rel=0.02)
    assert np.abs(np.cross(b - a, c - a).sum(axis=0)).max() < 1e-12
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert abs(volume) == pytest.approx(mask.sum() * VOXEL**3, rel=0.01)
