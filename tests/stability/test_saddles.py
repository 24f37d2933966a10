"""A level through saddles, where triangles do not close. Naive: ever finer samples. Ours: closed or cut below a voxel."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import Delaunay, cKDTree

from ngbrain.mesh.geometry.level_set import LevelSet
from ngbrain.mesh.surface.manifold import boundary, faults
from ngbrain.mesh.surface.remeshing import _circumcentres, _dense_points, _spaced_samples, remesh_surface

VOXEL, SIZE = 1e-3, 5e-3
FINER, ROUNDS = 0.7, 8


@pytest.fixture(scope="module")
def walls():
    """A ball of 20 mm with a slot between walls that touch here and there, at the level of the ridge between them."""
    axis = np.arange(-24, 25) * VOXEL
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    slot = (np.abs(x) < 0.6 * VOXEL) & (z > -6e-3) & (np.random.default_rng(0).random(x.shape) < 0.7)
    mask = (x**2 + y**2 + z**2 < 20e-3**2) & ~slot
    level = LevelSet.of(mask, np.full(3, axis[0]), VOXEL, smoothing=2e-3, margin=8e-3)
    ridge = np.stack([np.zeros(9), np.linspace(-4e-3, 4e-3, 9), np.full(9, 4e-3)], axis=1)
    return replace(level, values=level.values - np.float32(np.median(level(ridge))))


def size(points):
    return np.full(len(points), SIZE)


def faulty(level, points):
    """Vertices at which the restricted Delaunay triangles of points are no surface."""
    corners = 0.1 * np.array(list(np.ndindex(2, 2, 2))) - 0.05
    every = np.concatenate([points, corners])
    made = Delaunay(every)
    inside = (level(_circumcentres(every[made.simplices])) < 0) & (made.simplices < len(points)).all(axis=1)
    return faults(boundary(made.simplices, made.neighbors, inside)[0], len(points))


def test_naive_refinement_makes_more_faults_than_it_mends(walls):
    dense, area = _dense_points(walls, size)
    h, found = size(dense), []
    for _ in range(ROUNDS):
        points = _spaced_samples(walls, dense, area, h, np.zeros((0, 3)), np.random.default_rng(0))
        bad = faulty(walls, points)
        found.append(len(bad))
        if not len(bad):
            break
        reach, _ = cKDTree(points[bad]).query(dense)
        h = np.where(reach < 2 * h, FINER * h, h)
    print("faults", found)
    assert len(found) == ROUNDS and found[-1] > 3 * found[0] > 0


def test_ours_closes_and_says_by_how_much(walls):
    surface = remesh_surface(walls, size, np.zeros((0, 3)))
    changed = np.abs(surface.changed[:, 3]).sum()
    enclosed = (walls.values < 0).sum() * VOXEL**3
    print("faults 0, changed", changed * 1e6, "of", enclosed * 1e6, "ml at", len(surface.changed), "places")
    assert len(faults(surface.triangles, len(surface.points))) == 0
    assert 0 < changed < 3e-3 * enclosed and np.isfinite(surface.changed).all()
    assert np.abs(surface.changed[:, 0]).max() < 4e-3  # all of it in the slot
    a, b, c = np.moveaxis(surface.points[surface.triangles], 1, 0)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(enclosed, rel=0.1)
