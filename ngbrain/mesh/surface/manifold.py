"""Sets of tetrahedra whose boundary is a surface: where it is none, tetrahedra are added or taken away until it is."""

from __future__ import annotations

import numpy as np
from scipy import sparse

ROUNDS = 60
"""Passes over the vertices at which the boundary is no surface;"""
BOTH_WAYS = 20
"""in the first of them tetrahedra are added or taken away, whichever is less, in the rest only added: that comes to an end."""


def faults(triangles: np.ndarray, n: int) -> np.ndarray:
    """Vertices of n at which triangles (m, 3) are no surface: an edge without exactly two of them, several fans, or none at all.

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
    # A fan: corners of triangles around one vertex that edges join. Corner k of triangle t is 3 t + k.
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
    """Triangles (k, 3) between tetrahedra (m, 4) inside and what is not, and the corner (k,) of the one inside opposite to each."""
    within = np.where(neighbours >= 0, inside[neighbours], False)
    corner, t = np.nonzero((inside[:, None] & ~within).T)
    faces = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    return tets[t[:, None], faces[corner]], tets[t, corner]


def pieces(neighbours: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Number (m,) from 1 of the piece that each of the chosen tetrahedra belongs to, by their faces; 0 for the others.

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
    """Which tetrahedra (m,) are inside, a few of them changed so that their boundary is a surface everywhere.

    At a vertex the boundary is a surface if the tetrahedra around it that are inside hang together by their faces, and so do the
    others. Of what does not, the smaller parts change sides.

    tets, neighbours   (m, 4), as of a Delaunay triangulation: across the face opposite to each corner, -1 for none
    volumes            (m,)
    free               vertices from this number on are outside for good

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
    """Change tetrahedra around a vertex, in place, until those inside and the others are one part each: the least ones first."""
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
    """Tetrahedra around a vertex that are on the same side and hang together by faces at it."""
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
