"""The surgical cleft: a slot from the brain's surface to a target, and the frame in which a retractor blade moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.errors import InputError

Vector = np.ndarray


@dataclass(frozen=True)
class Cleft:
    """A slot with plane walls: the floor's centre at `target`, running out along `out` to the surface.

    Its boundaries are `wall_plus` and `wall_minus` (towards ±across), `end_plus`, `end_minus` and `floor`.

    Parameters
    ----------
    target : ndarray, shape (3,)
        Centre of the floor (m).
    out : ndarray, shape (3,)
        Unit vector from the floor to the surface.
    across : ndarray, shape (3,)
        Unit vector from wall to wall, orthogonal to `out`: the direction in which a blade pushes.
    depth : float
        Distance from floor to surface along `out` (m).
    opening : float
        Distance between the walls (m).
    width : float
        Extent along the walls (m).
    """

    target: Vector
    out: Vector
    across: Vector
    depth: float
    opening: float
    width: float

    @property
    def along(self) -> Vector:
        """Unit vector along the walls, orthogonal to `out` and `across`."""
        return np.cross(self.out, self.across)

    @property
    def entry(self) -> Vector:
        """Intersection of the axis with the surface (m)."""
        return self.target + self.depth * self.out

    def coordinates(self, points: Vector) -> Vector:
        """Transform points (n, 3) in m to (across, along, height above the floor), (n, 3) in m."""
        return (np.asarray(points) - self.target) @ np.column_stack([self.across, self.along, self.out])

    def distance_to_walls(self, points: Vector) -> Vector:
        """Distance (m) of points (n, 3) to the nearer wall of the undeformed slot."""
        a, b, c = self.coordinates(points).T
        off_b = np.maximum(np.abs(b) - self.width / 2, 0)
        off_c = np.maximum(np.maximum(-c, c - self.depth), 0)
        return np.sqrt((np.abs(np.abs(a) - self.opening / 2)) ** 2 + off_b**2 + off_c**2)


def frame(out: Vector, across: Vector | None = None) -> tuple[Vector, Vector]:
    """Orthonormal pair of axes of a cleft.

    Parameters
    ----------
    out : ndarray, shape (3,)
        Direction outwards, of any length.
    across : ndarray, shape (3,), optional
        Preferred direction from wall to wall; left to right by default.

    Returns
    -------
    out, across : ndarray, shape (3,)
        Unit vector outwards, and the unit vector orthogonal to it that is nearest to `across`.
    """
    out = np.asarray(out, float)
    size = np.linalg.norm(out)
    if not size > 0:
        raise InputError("cleft.approach", out.tolist(), "a direction other than zero")
    out = out / size
    guesses = [np.asarray(across, float)] if across is not None else [np.array([1.0, 0, 0]), np.array([0, 1.0, 0])]
    for guess in guesses:
        flat = guess - (guess @ out) * out
        if np.linalg.norm(flat) > 0.1 * np.linalg.norm(guess) > 0:
            return out, flat / np.linalg.norm(flat)
    raise InputError("cleft.across", guesses[0].tolist(), "a direction that is not along the approach")
