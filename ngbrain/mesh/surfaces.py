"""Triangles on a smooth closed surface, as fine as a size field asks: samples, spread evenly, and their Delaunay facets."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from ngbrain.errors import InputError
from ngbrain.mesh.grading import Sizes
from ngbrain.mesh.levelset import LevelSet, Points

CLOSE = 0.72
"""Samples are first this part of the element size apart; spread evenly they end up a size apart."""
ROUNDS = 12
"""of spreading."""
PIECES = 2
"""The surface is spread over in pieces at least this much smaller than a size."""
REFINEMENTS = 8
"""How often places where the triangles do not close to a surface are sampled more finely,"""
FINER = 0.7
"""each time by this factor."""


def triangulated(surface: LevelSet, size: Sizes, fixed: Points, seed: int = 0) -> tuple[Points, np.ndarray]:
    """Vertices (n, 3) m on φ = 0, the `fixed` ones first, and triangles (m, 3), outwards: closed and without crossings.

    The triangles are the facets of the samples' Delaunay tetrahedra that part those with a circumcentre inside from the
    others (the restricted Delaunay triangulation: Boissonnat & Oudot 2005, 10.1016/j.gmod.2005.01.004). They bound a
    union of tetrahedra, so that they close and cannot cross, and approximate the surface where samples are dense.
    Neighbours among `fixed` (along a curve, say) stay joined by an edge if nothing else lies within their smallest ball.

    Raises `InputError` if even finer samples give no surface.
    """
    dense, area = _dense(surface, size)
    h = size(dense)
    for _ in range(REFINEMENTS):
        points = _spread(surface, dense, area, h, fixed, np.random.default_rng(seed))
        triangles = _facets(surface, points)
        bad = _open(triangles, len(points))
        if not len(bad):
            return points, triangles
        reach, _ = cKDTree(points[bad]).query(dense)
        h = np.where(reach < 2 * h, FINER * h, h)
    raise InputError("mesh sizes", "such that the surface does not close", "smaller elements")


def _dense(surface: LevelSet, size: Sizes) -> tuple[Points, np.ndarray]:
    """Points (n, 3) that stand for the whole surface, and the area (m²) of each: pieces well below the size there."""
    pieces = surface.outline()
    kept = []
    while len(pieces):
        edge = np.linalg.norm(pieces - pieces[:, [1, 2, 0]], axis=2).max(axis=1)
        large = PIECES * edge > size(pieces.mean(axis=1))
        kept.append(pieces[~large])
        a, b, c = np.moveaxis(pieces[large], 1, 0)
        p, q, r = (a + b) / 2, (b + c) / 2, (c + a) / 2
        pieces = np.stack([np.stack(t, axis=1) for t in ((a, p, r), (p, b, q), (r, q, c), (p, q, r))]).reshape(-1, 3, 3)
    pieces = np.concatenate(kept)
    normal = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    return pieces.mean(axis=1), np.linalg.norm(normal, axis=1) / 2


def _spread(
    surface: LevelSet, dense: Points, area: np.ndarray, h: np.ndarray, fixed: Points, rng: np.random.Generator
) -> Points:
    """Samples a size apart: thrown at random, then moved to the weighted centres of what is nearest to them."""
    tree = cKDTree(dense)
    taken = np.zeros(len(dense), bool)
    chosen: list[int] = []
    if len(fixed):
        reach = h[tree.query(fixed)[1]]
        for near in tree.query_ball_point(fixed, CLOSE * reach):
            taken[near] = True
    for i in rng.permutation(len(dense)):
        if not taken[i]:
            chosen.append(i)
            taken[tree.query_ball_point(dense[i], CLOSE * h[i])] = True
    free = dense[chosen]
    weight = area * h**-4.0  # so that the samples' spacing goes with h
    for _ in range(ROUNDS):
        owner = cKDTree(np.concatenate([fixed, free])).query(dense)[1] - len(fixed)
        mine = owner >= 0
        total = np.bincount(owner[mine], weight[mine], len(free))
        centres = [np.bincount(owner[mine], (weight * dense[:, k])[mine], len(free)) for k in range(3)]
        free = free[total > 0]
        free = surface.project((np.stack(centres, axis=1)[total > 0]) / total[total > 0, None])
    return np.concatenate([fixed, free])


def _facets(surface: LevelSet, points: Points) -> np.ndarray:
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.array(np.meshgrid(*np.stack([low, high], axis=1) * 1.0)).reshape(3, -1).T
    around = (low + high) / 2 + 3 * (corners - (low + high) / 2)  # so that every facet of the surface has two sides
    every = np.concatenate([points, around])
    try:
        delaunay = Delaunay(every)
    except QhullError as error:
        raise InputError("mesh sizes", "such that the surface has too few points", "smaller elements") from error
    tets, neighbours = delaunay.simplices, delaunay.neighbors
    inside = surface(_circumcentres(every[tets])) < 0
    inside &= (tets < len(points)).all(axis=1)
    facets = []
    for k in range(4):
        other = neighbours[:, k]
        border = inside & ~((other >= 0) & inside[other])
        three = np.delete(tets[border], k, axis=1)
        a, b, c = (every[three[:, i]] for i in range(3))
        d = every[tets[border, k]]
        outwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0
        three[~outwards] = three[~outwards][:, [0, 2, 1]]
        facets.append(three)
    return np.concatenate(facets)


def _circumcentres(tets: np.ndarray) -> Points:
    edges = tets[:, 1:] - tets[:, :1]
    volume = np.linalg.det(edges)
    flat = np.abs(volume) < 1e-30
    edges[flat] = np.eye(3)
    half = np.linalg.solve(edges, (edges**2).sum(axis=2, keepdims=True) / 2)[..., 0]
    half[flat] = 0
    return np.asarray(tets[:, 0] + half)


def _open(triangles: np.ndarray, n: int) -> np.ndarray:
    """Vertices at which the triangles are no surface: an edge without exactly two of them, or several fans; unused ones."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    bad = set(unique[count != 2].ravel().tolist())
    used = np.bincount(triangles.ravel(), minlength=n)
    bad |= set(np.flatnonzero(used == 0).tolist())
    # One fan around a vertex: the edges opposite to it form one closed path.
    after: dict[int, dict[int, int]] = {}
    for a, b, c in triangles.tolist():
        for v, p, q in ((a, b, c), (b, c, a), (c, a, b)):
            after.setdefault(v, {})[p] = q
    for v, path in after.items():
        start = at = next(iter(path))
        steps = 0
        while steps <= len(path) and at in path:
            at, steps = path[at], steps + 1
            if at == start:
                break
        if at != start or steps != used[v]:
            bad.add(v)
    return np.array(sorted(bad), int)
