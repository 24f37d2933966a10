"""Optimisation-based vertex smoothing: moves of single vertices that improve the worst tetrahedra and keep interfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ngbrain.look import BriefText

Points = np.ndarray
TRIES = 6
"""Number of trial steps of a vertex, of which the best is taken."""
FLATTEST = 1e-4
"""Shape quality that tetrahedra outside have to keep: they only must not be inverted."""
_EDGES = ((0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2), (1, 2, 0, 3), (1, 3, 0, 2), (2, 3, 0, 1))
"""Of each edge its corners, and the corners opposite to the two faces that share it."""


def shape_quality(x: np.ndarray) -> np.ndarray:
    """Shape quality of tetrahedra (n, 4, 3) in Netgen's orientation: smallest sine (n,) of the dihedral angles.

    It is small for angles near 0° and near 180°, and negative for an inverted tetrahedron: sin = 3/2 V l / (A B) for faces of
    areas A and B with a common edge of length l.

    References
    ----------
    Freitag & Ollivier-Gooch (1997), doi:10.1002/(SICI)1097-0207(19971115)40:21<3979::AID-NME251>3.0.CO;2-9.
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


@dataclass(frozen=True, eq=False, repr=False)
class Stars(BriefText):
    """Vertex stars: the tetrahedra around vertex v are `tets[start[v] : start[v + 1]]`.

    Parameters
    ----------
    start : ndarray of int, shape (n + 1,)
        Start of each vertex's tetrahedra.
    tets : ndarray of int
        Numbers of the tetrahedra.
    """

    start: np.ndarray
    tets: np.ndarray

    @classmethod
    def of(cls, tets: np.ndarray, n: int) -> Stars:
        """Stars of the n vertices of tetrahedra.

        Parameters
        ----------
        tets : ndarray of int, shape (m, 4)
            Tetrahedra.
        n : int
            Number of vertices.

        Returns
        -------
        Stars
            The stars.
        """
        order = np.argsort(tets.ravel(), kind="stable")
        return cls(np.r_[0, np.cumsum(np.bincount(tets.ravel(), minlength=n))], order // 4)

    def tets_of_vertices(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The tetrahedra around vertices, concatenated, and the start of each vertex's part."""
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
    """Move vertices so that fewer tetrahedra have a shape quality (`shape_quality`) below a goal.

    Single vertices of bad tetrahedra try random steps. The best step is taken if it improves the worst tetrahedron around the
    vertex. Many vertices move at a time, but no two of one tetrahedron.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra in Netgen's orientation.
    kept : ndarray of bool, shape (m,)
        Tetrahedra whose quality counts; the others only must not be inverted.
    place : callable
        (vertices, wanted points) → nearest allowed points of these vertices (m).
    goal : float
        Quality below which a tetrahedron is bad.
    rounds : int
        Number of rounds.
    rng : numpy.random.Generator
        Random numbers.

    Returns
    -------
    ndarray, shape (n, 3)
        New positions (m).
    """
    points = points.copy()
    stars = Stars.of(tets, len(points))
    quality = np.where(kept, shape_quality(points[tets]), np.inf)
    for _ in range(rounds):
        bad = np.flatnonzero(quality < goal)
        if not len(bad):
            break
        movable = _independent_vertices(tets, stars, np.unique(tets[bad]), len(points), rng)
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


def _independent_vertices(
    tets: np.ndarray, stars: Stars, active: np.ndarray, n: int, rng: np.random.Generator
) -> np.ndarray:
    """An independent subset of the active vertices, no two in one tetrahedron: the first ones in a random order."""
    turn = np.full(n, np.inf)
    turn[active] = rng.random(len(active))
    around, first = stars.tets_of_vertices(active)
    earliest = np.minimum.reduceat(turn[tets[around]].min(axis=1), first)
    return active[turn[active] <= earliest]
