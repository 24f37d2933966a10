"""A rigid body against a named wall: a boundary energy of its signed distance, and what makes up for its penalty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import ngsolve as ngs
from ngsolve import CoefficientFunction

SURFACE_ORDER = 8
"""Order of the quadrature on walls, whatever the elements': the contact zone ends inside facets.

Where it does, another rule is another contact: energy, force, area and pressure must all see the same points.
"""
SLACK = 0.04
"""The offset may miss its share of the mean penetration by so much of it."""


@dataclass(frozen=True)
class Contact:
    """Unilateral, frictionless contact of a wall with a rigid body by a penalty.

    With the penetration d = a - φ(X + u), the pressure on the reference area is 0 for d ≤ 0, ε d²/(2s) up to d = s and
    ε (d - s/2) beyond: continuous with its derivative, so that a wall coming into touch does not unsettle Newton's
    method, and exactly zero where there is a gap. Force direction and tangent follow from the energy (its integral).

    The offset a ≥ 0 makes up for the penalty: the body stands that much further out, so that the wall goes where the
    body should have put it, but for the rest of a soft penalty's mean penetration. It is one number a body, a multiplier
    too coarse to lock the wall's elements as one at every point does (see `settle`).

    wall       boundary name or pattern; it sees only this body
    distance   x ↦ φ(x), signed distance (m) to the body at the current position x, negative inside
    penalty    ε (Pa/m)
    softness   s (m)
    share      of the mean penetration that the offset makes up for, below 1 so that touching walls never show a gap
    offset     a (m), a Parameter: part of the state
    """

    wall: str
    distance: Callable[[CoefficientFunction], CoefficientFunction]
    penalty: float
    softness: float
    share: float = 0.0
    offset: ngs.Parameter = field(default_factory=lambda: ngs.Parameter(0.0), compare=False)

    def gap(self, u: CoefficientFunction) -> CoefficientFunction:
        """φ(X + u) in m."""
        return self.distance(ngs.CF((ngs.x, ngs.y, ngs.z)) + u)

    def energy(self, u: CoefficientFunction) -> CoefficientFunction:
        """Energy per reference area (J/m²)."""
        d, s = self.offset - self.gap(u), self.softness
        soft, stiff = d**3 / (6 * s), (d * d - d * s + s * s / 3) / 2
        return self.penalty * ngs.IfPos(d, ngs.IfPos(d - s, stiff, soft), 0)

    def pressure(self, u: CoefficientFunction) -> CoefficientFunction:
        """Contact force per reference area (Pa)."""
        d, s = self.offset - self.gap(u), self.softness
        return self.penalty * ngs.IfPos(d, ngs.IfPos(d - s, d - s / 2, d * d / (2 * s)), 0)

    def settle(self, u: ngs.GridFunction) -> bool:
        """True if the offset is its share of the mean penetration where there is any; else set it to that."""
        if not self.share:
            return True
        d, pressure = self.offset - self.gap(u), self.pressure(u)
        force, depth = (ngs.Integrate(value * self.measure(), u.space.mesh) for value in (pressure, pressure * d))
        mean, now = depth / force if force else 0.0, self.offset.Get()
        if abs(now - self.share * mean) <= SLACK * mean:
            return True
        self.offset.Set(self.share * mean)
        return False

    def measure(self) -> ngs.comp.DifferentialSymbol:
        """The `ds` of every integral over the wall."""
        return ngs.ds(self.wall, intrules={ngs.TRIG: surface_rule()})


def surface_rule() -> ngs.IntegrationRule:
    """Quadrature on walls."""
    return ngs.IntegrationRule(ngs.TRIG, SURFACE_ORDER)


def current_normal_area(u: ngs.GridFunction) -> CoefficientFunction:
    """cof(F) N on a boundary: the current normal times current over reference area.

    On a boundary the gradient of a GridFunction is the tangential one, which is all that this needs.
    """
    return ngs.Cof(ngs.Id(3) + ngs.Grad(u)) * ngs.specialcf.normal(3)
