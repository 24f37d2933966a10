"""Moves of a mesh's vertices that make its worst tetrahedra better and keep its interfaces where they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Points = np.ndarray
TRIES = 6
"""Steps of a vertex of which the best is taken."""
FLATTEST = 1e-4
"""Shape that tetrahedra outside have to keep: they only must not turn inside out."""
_EDGES = ((0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2), (1, 2, 0, 3), (1, 3, 0, 2), (2, 3, 0, 1))
"""Of each edge its corners, and the corners opposite to the two faces that it lies between."""


def shape_quality(x: np.ndarray) -> np.ndarray:
    """Smallest sine (n,) of the angles between two faces of tetrahedra (n, 4, 3) in Netgen's orientation.

    Small for angles near 0 and near 180°; negative where the tetrahedron is inside out (sin = 3/2 V l / (A B) for faces of
    areas A and B with a common edge of length l: Freitag & Ollivier-Gooch 1997,
    10.1002/(SICI)1097-0207(19971115)40:21<3979::AID-NME251>3.0.CO;2-9).
    """
    p, q, r = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 0]
    s, t = x[:, 2] - x[:, 1], x[:, 3] - x[:, 1]
    pq = _cross(p, q)
    volume = -_dot(pq, r)  # six times
    double = np.stack([_square(_cross(s, t)), _square(_cross(q, r)), _square(_cross(p, r)), _square(pq)])
    lengths = np.stack([_square(e) for e in (p, q, r, s, t, x[:, 3] - x[:, 2])])
    pairs = np.stack([lengths[k] / np.maximum(double[m] * double[n], 1e-60) for k, (*_, m, n) in enumerate(_EDGES)])
    return np.asarray(volume * np.sqrt(pairs.min(axis=0)))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:  # np.cross takes three times as long
    (x, y, z), (u, v, w) = a.T, b.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("ij,ij->i", a, b))


def _square(a: np.ndarray) -> np.ndarray:
    return _dot(a, a)


@dataclass(frozen=True, eq=False)
class Stars:
    """Which tetrahedra there are around each vertex: `tets[start[v] : start[v + 1]]`."""

    start: np.ndarray
    tets: np.ndarray

    @classmethod
    def of(cls, tets: np.ndarray, n: int) -> Stars:
        """Of n vertices of tetrahedra (m, 4)."""
        order = np.argsort(tets.ravel(), kind="stable")
        return cls(np.r_[0, np.cumsum(np.bincount(tets.ravel(), minlength=n))], order // 4)

    def tets_of_vertices(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The tetrahedra around vertices, one after the other, and where those of each vertex start."""
        count = self.start[vertices + 1] - self.start[vertices]
        first = np.r_[0, np.cumsum(count)[:-1]]
        return self.tets[np.repeat(self.start[vertices] - first, count) + np.arange(count.sum())], first


def smooth_vertices(
    points: Points,
    tets: np.ndarray,
    kept: np.ndarray,
    place: Callable[[np.ndarray, Points], Points],
    goal: float,
    rounds: int,
    rng: np.random.Generator,
) -> Points:
    """Points (n, 3) moved so that fewer tetrahedra (m, 4) have a shape (see `shapes`) below the goal.

    Random steps of single vertices of bad tetrahedra, the best of several, taken where the worst tetrahedron around the
    vertex gets better; many vertices at a time, none two of one tetrahedron.

    kept    (m,), the tetrahedra whose shape counts; the others only must not turn inside out
    place   (vertices, wanted points) → points where these vertices may be
    """
    points = points.copy()
    stars = Stars.of(tets, len(points))
    quality = np.where(kept, shape_quality(points[tets]), np.inf)
    for _ in range(rounds):
        bad = np.flatnonzero(quality < goal)
        if not len(bad):
            break
        movable = _apart(tets, stars, quality, np.unique(tets[bad]), len(points), rng)
        around, first = stars.tets_of_vertices(movable)
        owner = np.repeat(np.arange(len(movable)), np.diff(np.r_[first, len(around)]))
        corner = (tets[around] == movable[owner, None]).argmax(axis=1)
        x = points[tets[around]]
        rows = np.arange(len(around))
        length = np.sqrt(np.minimum.reduceat(_square(x[rows, (corner + 1) % 4] - points[movable][owner]), first))
        best = np.minimum.reduceat(quality[around], first)
        chosen, new = points[movable], quality[around]
        for _ in range(TRIES):
            step = (
                rng.normal(size=(len(movable), 3)) * (length * 10.0 ** rng.uniform(-1.5, -0.2, len(movable)))[:, None]
            )
            trial = place(movable, points[movable] + step)
            x[rows, corner] = trial[owner]
            shape = shape_quality(x)
            shape = np.where(kept[around], shape, np.where(shape > FLATTEST, np.inf, -np.inf))
            worst = np.minimum.reduceat(shape, first)
            better = worst > best
            best = np.where(better, worst, best)
            chosen = np.where(better[:, None], trial, chosen)
            new = np.where(better[owner], shape, new)
        points[movable] = chosen
        quality[around] = new
    return points


def _apart(
    tets: np.ndarray, stars: Stars, quality: np.ndarray, active: np.ndarray, n: int, rng: np.random.Generator
) -> np.ndarray:
    """Those of the active vertices of which no two share a tetrahedron: the ones that come first in a random order."""
    turn = np.full(n, np.inf)
    turn[active] = rng.random(len(active))
    around, first = stars.tets_of_vertices(active)
    earliest = np.minimum.reduceat(turn[tets[around]].min(axis=1), first)
    return active[turn[active] <= earliest]
