"""The walls, ends and floor of a cleft as triangles in exact planes, cut by a smooth surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.errors import InputError
from ngbrain.look import BriefText
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.mesh.geometry.level_set import LevelSet, Points

LEAST_ACROSS = 2
"""Smallest number of elements across the floor."""
BEYOND = 40e-3
"""Largest height (m) of the walls' rim above or below the point where the axis leaves the surface."""
START = 16e-3
"""Depth (m) below the entry from which rays to the craniotomy's rim start; the surface must not curve away further."""


@dataclass(frozen=True, eq=False, repr=False)
class CleftWalls(BriefText):
    """Triangle grids on the five sides of a cleft, with common edges.

    Parameters
    ----------
    cleft : Cleft
        The cleft.
    points : ndarray, shape (n, 3)
        Vertices (m); the first `mouth` of them form the mouth on the surface.
    mouth : int
        Number of vertices of the mouth.
    sides : dict of str to ndarray of int, shape (m, 3)
        Boundary name → triangles, with normals into the slot.
    """

    cleft: Cleft
    points: Points
    mouth: int
    sides: dict[str, np.ndarray]

    @classmethod
    def of(cls, cleft: Cleft, surface: LevelSet, site: float) -> CleftWalls:
        """Build the walls of a cleft up to a surface.

        Parameters
        ----------
        cleft : Cleft
            The cleft.
        surface : LevelSet
            The brain's surface.
        site : float
            Element size (m); at least two elements lie across the floor.

        Returns
        -------
        CleftWalls
            The triangles.

        Raises
        ------
        InputError
            The walls do not reach the surface.
        """
        na = max(LEAST_ACROSS, int(np.ceil(cleft.opening / site - 1e-9)))
        nb, nc = (max(2, int(np.ceil(length / site - 1e-9))) for length in (cleft.width, cleft.depth))
        a = np.linspace(-cleft.opening / 2, cleft.opening / 2, na + 1)
        b = np.linspace(-cleft.width / 2, cleft.width / 2, nb + 1)
        ring = [(i, 0) for i in range(na)] + [(na, j) for j in range(nb)]
        ring += [(i, nb) for i in range(na, 0, -1)] + [(0, j) for j in range(nb, 0, -1)]
        number: dict[tuple[int, int, int], int] = {(i, j, nc): n for n, (i, j) in enumerate(ring)}
        feet = np.array([_at(cleft, a[i], b[j], 0.0) for i, j in ring])
        top = surface.ray_distance(feet, cleft.out, cleft.depth + BEYOND)
        if np.isnan(top).any() or np.ptp(top) > cleft.depth / 2 + cleft.width:
            raise InputError("cleft.approach", "such that the walls do not end on the surface", "a steeper way out")
        points = [foot + t * cleft.out for foot, t in zip(feet, top, strict=True)]
        for k in range(nc):
            for (i, j), t in zip(ring, top, strict=True):
                number[i, j, k] = len(points)
                points.append(_at(cleft, a[i], b[j], t * k / nc))
        for i in range(1, na):
            for j in range(1, nb):
                number[i, j, 0] = len(points)
                points.append(_at(cleft, a[i], b[j], 0.0))
        A, B, C = range(na + 1), range(nb + 1), range(nc + 1)
        grids = {
            "wall_plus": ([[(na, j, k) for k in C] for j in B], -cleft.across),
            "wall_minus": ([[(0, j, k) for k in C] for j in B], cleft.across),
            "end_plus": ([[(i, nb, k) for k in C] for i in A], -cleft.along),
            "end_minus": ([[(i, 0, k) for k in C] for i in A], cleft.along),
            "floor": ([[(i, j, 0) for j in B] for i in A], cleft.out),
        }
        where = np.array(points)
        sides = {
            name: _triangles(np.array([[number[key] for key in row] for row in grid]), where, inwards)
            for name, (grid, inwards) in grids.items()
        }
        return cls(cleft, where, len(ring), sides)


def rim(cleft: Cleft, surface: LevelSet, diameter: float, size: float) -> Points:
    """Points on the edge of a round craniotomy about a cleft.

    Parameters
    ----------
    cleft : Cleft
        The cleft.
    surface : LevelSet
        The brain's surface.
    diameter : float
        Diameter of the craniotomy (m).
    size : float
        Distance of neighbouring points (m).

    Returns
    -------
    ndarray, shape (n, 3)
        Points (m) on the surface.
    """
    n = max(8, int(np.ceil(np.pi * diameter / size)))
    angle = 2 * np.pi * (np.arange(n) + 0.5) / n
    below = max(cleft.depth - START, 0.0)
    feet = np.array([_at(cleft, diameter / 2 * np.cos(q), diameter / 2 * np.sin(q), below) for q in angle])
    top = surface.ray_distance(feet, cleft.out, START + BEYOND)
    if np.isnan(top).any():
        wanted = "less, or another cleft.approach: the surface of the brain curves away under its rim"
        raise InputError("cleft.craniotomy_mm", f"{1e3 * diameter:g}", wanted)
    return feet + top[:, None] * cleft.out


def _at(cleft: Cleft, a: float, b: float, c: float) -> np.ndarray:
    return np.asarray(cleft.target + a * cleft.across + b * cleft.along + c * cleft.out)


def _triangles(grid: np.ndarray, points: Points, inwards: np.ndarray) -> np.ndarray:
    """Two triangles for each square of a grid (n, m) of indices, oriented to `inwards`; the diagonals alternate."""
    squares = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=-1)
    even = (np.indices(squares.shape[:2]).sum(axis=0) % 2 == 0).ravel()
    p, q, r, s = squares.reshape(-1, 4).T
    first = np.where(even, (p, q, r), (p, q, s)).T
    second = np.where(even, (p, r, s), (q, r, s)).T
    triangles = np.concatenate([first, second])
    x, y, z = (points[triangles[0, k]] for k in range(3))
    return triangles if np.cross(y - x, z - x) @ inwards > 0 else triangles[:, [0, 2, 1]]
