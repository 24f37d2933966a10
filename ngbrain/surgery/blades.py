"""Retractor blades as rigid bodies: a signed distance and where it stands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.mesh.cleft import Cleft

INSIDE = 1e-9
"""Length (m) that keeps the derivative of a norm finite at zero."""

Signed = Callable[[CoefficientFunction], CoefficientFunction]
"""x ↦ signed distance (m) to a rigid body at the current position x, negative inside."""


class Blade(Protocol):
    """What the wall towards `cleft.across` sees of a retractor.

    width   of the wall (m) over which pressure is read; tip: height (m) of the lower end above the cleft's floor
    """

    @property
    def cleft(self) -> Cleft:
        """The frame it moves in."""

    @property
    def width(self) -> float:
        """(m)."""

    @property
    def tip(self) -> float:
        """(m)."""

    def distance(self, advance: CoefficientFunction) -> Signed:
        """Its signed distance when it has gone `advance` (m) from where it touches the unloaded wall."""

    def moves(self, x: CoefficientFunction, advance: CoefficientFunction) -> CoefficientFunction:
        """How far its surface at x has gone (m), a vector."""


@dataclass(frozen=True)
class Spatula:
    """A blade with rounded edges that goes towards `cleft.across`, extended behind its face so that nothing slips through.

    width         along the walls (m), at the surface
    edge_radius   of its side edges and tip (m)
    tip           height of the tip above the cleft's floor (m)
    thickness     front to back (m), for pictures and for room in the cleft: contact sees only the front face
    tip_width     along the walls at its tip (m), from where it widens evenly up to the surface; None: as wide as there
    bend          radius (m) of its face, which bulges towards the tissue halfway up the wall; inf: flat

    The face starts at the unloaded wall; `distance` takes how far it has advanced from there.
    """

    cleft: Cleft
    width: float
    edge_radius: float
    tip: float
    thickness: float
    tip_width: float | None = None
    bend: float = np.inf

    def distance(self, advance: CoefficientFunction) -> Signed:
        """x ↦ signed distance (m) to {across ≤ face, |along| ≤ half the width, height ≥ tip} with edges rounded."""
        r, face = self.edge_radius, self.cleft.opening / 2 + advance

        def signed(x: CoefficientFunction) -> CoefficientFunction:
            a, b, c = coordinates(self.cleft, x)
            return _rounded((self._before(a - face, c) + r, self._beside(b, c) + r, self.tip + r - c), r)

        return signed

    def moves(self, x: CoefficientFunction, advance: CoefficientFunction) -> CoefficientFunction:
        """As one: towards `cleft.across`."""
        return advance * ngs.CF(tuple(map(float, self.cleft.across)))

    def _before(self, a: CoefficientFunction, c: CoefficientFunction) -> CoefficientFunction:
        """Distance (m) to the face's plane or cylinder, at a height c and a in front of its foremost line."""
        if np.isinf(self.bend):
            return a
        return ngs.sqrt((a + self.bend) ** 2 + (c - self.middle) ** 2 + INSIDE**2) - self.bend

    def _beside(self, b: CoefficientFunction, c: CoefficientFunction) -> CoefficientFunction:
        """Distance (m) to the side edges' planes."""
        along = ngs.sqrt(b * b + INSIDE**2)
        if self.tip_width is None:
            return along - self.width / 2
        slope = (self.width - self.tip_width) / 2 / (self.cleft.depth - self.tip)
        return (along - self.tip_width / 2 - slope * (c - self.tip)) / np.hypot(1, slope)

    @property
    def middle(self) -> float:
        """Height (m) halfway from the tip to the surface."""
        return (self.tip + self.cleft.depth) / 2


@dataclass(frozen=True)
class Tube:
    """A round retractor that widens: a cylinder around the cleft's axis, which first touches both walls halfway along.

    width         of the wall (m) over which pressure is read
    edge_radius   of its lower rim (m)
    tip           height of the rim above the cleft's floor (m)

    `distance` takes by how much its radius has grown.
    """

    cleft: Cleft
    width: float
    edge_radius: float
    tip: float

    def distance(self, advance: CoefficientFunction) -> Signed:
        """x ↦ signed distance (m) to {across² + along² ≤ radius², height ≥ tip} with the rim rounded."""
        r, radius = self.edge_radius, self.cleft.opening / 2 + advance

        def signed(x: CoefficientFunction) -> CoefficientFunction:
            a, b, c = coordinates(self.cleft, x)
            return _rounded((ngs.sqrt(a * a + b * b + INSIDE**2) - radius + r, self.tip + r - c), r)

        return signed

    def moves(self, x: CoefficientFunction, advance: CoefficientFunction) -> CoefficientFunction:
        """Away from its axis."""
        a, b, _ = coordinates(self.cleft, x)
        across, along = (ngs.CF(tuple(map(float, axis))) for axis in (self.cleft.across, self.cleft.along))
        return advance * (a * across + b * along) / ngs.sqrt(a * a + b * b + INSIDE**2)


def patch(blade: Blade, margin: float, height: float | None = None) -> CoefficientFunction:
    """1 on the unloaded wall under a blade, `margin` (m) inside its edges; `height` keeps only that much from the tip."""
    _, b, c = coordinates(blade.cleft, ngs.CF((ngs.x, ngs.y, ngs.z)))
    half = blade.width / 2 - margin
    inside = ngs.IfPos(half * half - b * b, 1, 0) * ngs.IfPos(c - blade.tip - margin, 1, 0)
    return inside if height is None else inside * ngs.IfPos(blade.tip + height - c, 1, 0)


def coordinates(cleft: Cleft, x: CoefficientFunction) -> tuple[CoefficientFunction, ...]:
    """Across and along the cleft and up from its floor (m), as `Cleft.coordinates` of numbers."""
    target, *axes = (ngs.CF(tuple(map(float, v))) for v in (cleft.target, cleft.across, cleft.along, cleft.out))
    return tuple(ngs.InnerProduct(x - target, axis) for axis in axes)


def _rounded(inward: Sequence[CoefficientFunction], r: float) -> CoefficientFunction:
    """Signed distance (m) to where several others are at most r, with edges of radius r where they meet."""
    beyond = sum((ngs.IfPos(q, q, 0) ** 2 for q in inward), ngs.CF(INSIDE**2))
    deepest = inward[0]
    for q in inward[1:]:
        deepest = ngs.IfPos(deepest - q, deepest, q)
    return ngs.sqrt(beyond) + ngs.IfPos(deepest, 0, deepest) - r
