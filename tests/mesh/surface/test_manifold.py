"""Sets of tetrahedra with a non-manifold boundary: found and repaired by small changes."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from ngbrain.mesh.surface.manifold import boundary, faults, pieces, repair_manifold


def triangulation(rng, n=150):
    """Random points in a cube within eight far corners, and the volumes of their tetrahedra."""
    points = np.concatenate([rng.random((n, 3)), 5 * np.array(list(np.ndindex(2, 2, 2))) - 2.0])
    made = Delaunay(points)
    volumes = np.abs(np.linalg.det(points[made.simplices[:, 1:]] - points[made.simplices[:, :1]])) / 6
    return made.simplices, made.neighbors, volumes


def bad(tets, neighbours, inside, n=158):
    triangles, _ = boundary(tets, neighbours, inside)
    return np.intersect1d(faults(triangles, n), triangles)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_any_set_of_tetrahedra_becomes_one_with_a_surface(share, rng):
    tets, neighbours, volumes = triangulation(rng)
    within = (tets < 150).all(axis=1)
    inside = within & (rng.random(len(tets)) < share)
    after = repair_manifold(tets, neighbours, inside, volumes, 150)
    before = bad(tets, neighbours, inside)
    print(share, len(before), "faults,", (inside != after).sum(), "of", within.sum(), "tetrahedra changed")
    assert len(before) > 20 and len(bad(tets, neighbours, after)) == 0
    assert not (after & ~within).any()


def test_what_is_a_surface_is_left_alone(rng):
    tets, neighbours, volumes = triangulation(rng)
    stars = ((tets == vertex).any(axis=1) for vertex in range(150))
    star = next(star for star in stars if (tets[star] < 150).all())
    assert len(bad(tets, neighbours, star)) == 0
    assert np.array_equal(repair_manifold(tets, neighbours, star, volumes, 150), star)


def test_an_edge_with_four_triangles_is_a_fault():
    two = np.array([[0, 1, 2, 3], [0, 1, 4, 5]])  # on either side of the edge 0-1
    none, both = np.full((2, 4), -1), np.ones(2, bool)
    assert bad(two, none, both, 6).tolist() == [0, 1]
    assert repair_manifold(two, none, both, np.array([2.0, 1.0]), 6).tolist() == [True, False]


def test_pieces_hang_together_by_faces():
    neighbours = np.array([[1, -1, -1, -1], [-1, -1, -1, 0], [-1, -1, -1, -1]])
    assert pieces(neighbours, np.ones(3, bool)).tolist() == [1, 1, 2]
    assert pieces(neighbours, np.array([True, False, True])).tolist() == [1, 0, 2]
