"""A rigid body against named walls: a boundary energy of its signed distance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import ngsolve as ngs
from ngsolve import CoefficientFunction

BONUS_INTORDER = 4
"""Extra quadrature order on contact facets: the contact zone ends inside facets."""


@dataclass(frozen=True)
class Contact:
    """Unilateral, frictionless contact of a wall with a rigid body by a penalty.

    With the penetration d = -φ(X + u), the pressure on the reference area is 0 for d ≤ 0, ε d²/(2s) up to d = s and
    ε (d - s/2) beyond: continuous with its derivative, so that a wall coming into touch does not unsettle Newton's
    method, and exactly zero where there is a gap. Force direction and tangent follow from the energy (its integral).

    wall       boundary name or pattern; it sees only this body
    distance   x ↦ φ(x), signed distance (m) to the body at the current position x, negative inside
    penalty    ε (Pa/m)
    softness   s (m)
    """

    wall: str
    distance: Callable[[CoefficientFunction], CoefficientFunction]
    penalty: float
    softness: float

    def gap(self, u: CoefficientFunction) -> CoefficientFunction:
        """φ(X + u) in m."""
        return self.distance(ngs.CF((ngs.x, ngs.y, ngs.z)) + u)

    def energy(self, u: CoefficientFunction) -> CoefficientFunction:
        """Energy per reference area (J/m²)."""
        d, s = -self.gap(u), self.softness
        soft, stiff = d**3 / (6 * s), (d * d - d * s + s * s / 3) / 2
        return self.penalty * ngs.IfPos(d, ngs.IfPos(d - s, stiff, soft), 0)

    def pressure(self, u: CoefficientFunction) -> CoefficientFunction:
        """Contact force per reference area (Pa)."""
        d, s = -self.gap(u), self.softness
        return self.penalty * ngs.IfPos(d, ngs.IfPos(d - s, d - s / 2, d * d / (2 * s)), 0)

    def measure(self) -> ngs.comp.DifferentialSymbol:
        """The `ds` of every integral over the wall, so that energy, force and area see the same points."""
        return ngs.ds(self.wall, bonus_intorder=BONUS_INTORDER)


def current_normal_area(u: ngs.GridFunction) -> CoefficientFunction:
    """cof(F) N on a boundary: the current normal times current over reference area.

    On a boundary the gradient of a GridFunction is the tangential one, which is all that this needs.
    """
    return ngs.Cof(ngs.Id(3) + ngs.Grad(u)) * ngs.specialcf.normal(3)
