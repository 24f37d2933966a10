"""Manifold repair: tetrahedra are added to or removed from a set until its boundary is a surface."""

from __future__ import annotations

import numpy as np
from scipy import sparse

ROUNDS = 60
"""Passes over the non-manifold vertices."""
BOTH_WAYS = 20
"""Number of first passes in which tetrahedra are added or removed, whichever is less volume; later ones only add, which
terminates."""


def faults(triangles: np.ndarray, n: int) -> np.ndarray:
    """Vertices at which triangles are not a manifold: an edge without exactly two triangles, several fans, or no triangle.

    Parameters
    ----------
    triangles : ndarray of int, shape (m, 3)
        Triangles.
    n : int
        Number of vertices.

    Returns
    -------
    ndarray of int
        Numbers of the vertices.

    Examples
    --------
    >>> tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> two = np.concatenate([tetrahedron, tetrahedron + 3])  # they touch at vertex 3
    >>> faults(two, 8).tolist()
    [3, 7]
    """
    bad = np.bincount(triangles.ravel(), minlength=n) == 0
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    keys, edge, count = np.unique(edges[:, 0] * np.int64(n) + edges[:, 1], return_inverse=True, return_counts=True)
    odd = keys[count != 2]
    bad[odd // n] = bad[odd % n] = True
    # A fan: triangle corners at one vertex, connected by edges. Corner k of triangle t is 3 t + k.
    order = np.argsort(edge, kind="stable")
    order = order[count[edge[order]] == 2].reshape(-1, 2)
    ends = np.stack([order // 3 * 3 + order % 3, order // 3 * 3 + (order % 3 + 1) % 3], axis=2)
    same = triangles.ravel()[ends[:, 0, 0]] == triangles.ravel()[ends[:, 1, 0]]
    other = np.where(same[:, None], ends[:, 1], ends[:, 1, ::-1])
    joins = np.stack([ends[:, 0].ravel(), other.ravel()])
    graph = sparse.coo_matrix((np.ones(joins.shape[1], bool), joins), (triangles.size, triangles.size))
    _, fan = sparse.csgraph.connected_components(graph, directed=False)
    fans = np.unique(np.stack([triangles.ravel(), fan]), axis=1)[0]
    return np.flatnonzero(bad | (np.bincount(fans, minlength=n) > 1))


def boundary(tets: np.ndarray, neighbours: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles between the tetrahedra inside and the rest.

    Parameters
    ----------
    tets : ndarray of int, shape (m, 4)
        Tetrahedra.
    neighbours : ndarray of int, shape (m, 4)
        Tetrahedron across the face opposite to each corner; -1 for none.
    inside : ndarray of bool, shape (m,)
        Tetrahedra inside.

    Returns
    -------
    triangles : ndarray of int, shape (k, 3)
        The boundary.
    opposite : ndarray of int, shape (k,)
        Opposite corner of the tetrahedron inside.
    """
    within = np.where(neighbours >= 0, inside[neighbours], False)
    corner, t = np.nonzero((inside[:, None] & ~within).T)
    faces = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    return tets[t[:, None], faces[corner]], tets[t, corner]


def pieces(neighbours: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Connected components of chosen tetrahedra, connected by faces.

    Parameters
    ----------
    neighbours : ndarray of int, shape (m, 4)
        Tetrahedra across the faces; -1 for none.
    chosen : ndarray of bool, shape (m,)
        Tetrahedra that count.

    Returns
    -------
    ndarray of int, shape (m,)
        Number of each tetrahedron's component from 1; 0 for the others.

    Examples
    --------
    >>> pieces(np.array([[1], [0], [-1], [-1]]), np.array([True, True, False, True])).tolist()
    [1, 1, 0, 2]
    """
    t, corner = np.nonzero((neighbours >= 0) & chosen[:, None])
    other = neighbours[t, corner]
    joined = chosen[other]
    n = len(chosen)
    graph = sparse.coo_matrix((np.ones(int(joined.sum()), bool), (t[joined], other[joined])), (n, n))
    _, number = sparse.csgraph.connected_components(graph, directed=False)
    found = np.zeros(n, int)
    found[chosen] = 1 + np.unique(number[chosen], return_inverse=True)[1]
    return found


def repair_manifold(
    tets: np.ndarray, neighbours: np.ndarray, inside: np.ndarray, volumes: np.ndarray, free: int
) -> np.ndarray:
    """Change a few tetrahedra between inside and outside so that the boundary is a manifold.

    At a vertex, the boundary is a manifold if the tetrahedra inside around it are connected by their faces, and so are those
    outside. Otherwise the smaller components change sides.

    Parameters
    ----------
    tets, neighbours : ndarray of int, shape (m, 4)
        A Delaunay triangulation: corners, and tetrahedra across the opposite faces (-1 for none).
    inside : ndarray of bool, shape (m,)
        Tetrahedra inside.
    volumes : ndarray, shape (m,)
        Volumes of the tetrahedra.
    free : int
        Vertices from this number on always stay outside.

    Returns
    -------
    ndarray of bool, shape (m,)
        Tetrahedra inside after the repair.

    Examples
    --------
    >>> two = np.array([[0, 1, 2, 3], [3, 4, 5, 6]])  # they touch at vertex 3; the smaller one goes
    >>> repair_manifold(two, np.full((2, 4), -1), np.ones(2, bool), np.array([1.0, 2.0]), 7).tolist()
    [False, True]
    """
    inside, n = inside.copy(), int(tets.max()) + 1
    around = np.argsort(tets.ravel(), kind="stable") // 4
    start = np.r_[0, np.cumsum(np.bincount(tets.ravel(), minlength=n))]
    cost = np.where((tets >= free).any(axis=1), np.inf, volumes)
    for turn in range(ROUNDS):
        triangles, _ = boundary(tets, neighbours, inside)
        bad = np.intersect1d(faults(triangles, n), triangles)
        if not len(bad):
            break
        for vertex in bad.tolist():
            star = around[start[vertex] : start[vertex + 1]].tolist()
            _settle(star, vertex, tets, neighbours, inside, cost, turn >= BOTH_WAYS)
    return inside


def _settle(
    star: list[int],
    vertex: int,
    tets: np.ndarray,
    neighbours: np.ndarray,
    inside: np.ndarray,
    cost: np.ndarray,
    adding: bool,
) -> None:
    """Change tetrahedra around a vertex, in place, until those inside and outside are one component each; the smallest first."""
    while True:
        parts = sorted(_parts(star, vertex, tets, neighbours, inside), key=lambda part: float(cost[part].sum()))
        within, without = ([part for part in parts if inside[part[0]] == side] for side in (True, False))
        if len(within) <= 1 and len(without) <= 1:
            return
        spare = without if adding and np.isfinite(cost[without[0]]).all() else [*within[:-1], *without[:-1]]
        part = min(spare, key=lambda part: float(cost[part].sum()))
        inside[part] = not inside[part[0]]


def _parts(
    star: list[int], vertex: int, tets: np.ndarray, neighbours: np.ndarray, inside: np.ndarray
) -> list[list[int]]:
    """Components of the tetrahedra around a vertex: same side, connected by faces at the vertex."""
    left, parts = set(star), []
    while left:
        part = [left.pop()]
        for t in part:
            for corner in range(4):
                other = int(neighbours[t, corner])
                if tets[t, corner] != vertex and other in left and inside[other] == inside[t]:
                    left.remove(other)
                    part.append(other)
        parts.append(sorted(part))
    return parts
