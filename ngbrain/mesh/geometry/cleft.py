"""The surgeon's opening: a slot from the surface to a target, and the frame that a blade moves in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.errors import InputError

Vector = np.ndarray


@dataclass(frozen=True)
class Cleft:
    """A slot with plane walls: floor centre at `target`, running out along `out` to the surface.

    target     centre of the floor (m)
    out        unit vector from the floor to the surface
    across     unit vector from one wall to the other, at right angles to `out`; the blade pushes this way
    depth      floor to surface along `out` (m)
    opening    between the walls (m); `width`: along them (m)

    Boundaries: `wall_plus` and `wall_minus` (towards ±across), `end_plus`, `end_minus`, `floor`.
    """

    target: Vector
    out: Vector
    across: Vector
    depth: float
    opening: float
    width: float

    @property
    def along(self) -> Vector:
        """Unit vector along the walls, at right angles to `out` and `across`."""
        return np.cross(self.out, self.across)

    @property
    def entry(self) -> Vector:
        """Where the axis meets the surface (m)."""
        return self.target + self.depth * self.out

    def coordinates(self, points: Vector) -> Vector:
        """Points (n, 3) in m to (across, along, height above the floor), (n, 3) in m."""
        return (np.asarray(points) - self.target) @ np.column_stack([self.across, self.along, self.out])

    def distance_to_walls(self, points: Vector) -> Vector:
        """Distance (m) of points (n, 3) to the nearer wall of the unloaded slot."""
        a, b, c = self.coordinates(points).T
        off_b = np.maximum(np.abs(b) - self.width / 2, 0)
        off_c = np.maximum(np.maximum(-c, c - self.depth), 0)
        return np.sqrt((np.abs(np.abs(a) - self.opening / 2)) ** 2 + off_b**2 + off_c**2)


def frame(out: Vector, across: Vector | None = None) -> tuple[Vector, Vector]:
    """Unit `out` and the unit vector at right angles to it that is nearest to `across` (left to right by default)."""
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
