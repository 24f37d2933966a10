"""A rigid body against a named wall: a boundary energy of its signed distance, and what makes up for its penalty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

SURFACE_ORDER = 8
"""Order of the quadrature on walls, whatever the elements': the contact zone ends inside facets.

Where it does, another rule is another contact: energy, force, area and pressure must all see the same points.
"""


@dataclass(frozen=True)
class Contact:
    """Unilateral, frictionless contact of a wall with a rigid body by a penalty.

    With the penetration d = a - φ(X + u), the pressure on the reference area is 0 for d ≤ 0, ε d²/(2s) up to d = s and
    ε (d - s/2) beyond: continuous with its derivative, so that a wall coming into touch does not unsettle Newton's
    method, and exactly zero where there is a gap. Force direction and tangent follow from the energy (its integral).

    The offset a ≥ 0 makes up for the penalty: the body stands that much further out, so that the wall goes where the
    body should have put it, but for the rest of a soft penalty's mean penetration. It is one number a body, a multiplier
    too coarse to lock the wall's elements as one at every point does (see `Offset`).

    wall       boundary name or pattern; it sees only this body
    distance   x ↦ φ(x), signed distance (m) to the body at the current position x, negative inside
    penalty    ε (Pa/m)
    softness   s (m)
    share      of the mean penetration that the offset makes up for, below 1 so that touching walls never show a gap
    offset     a (m), a Parameter: an unknown like the displacements
    way        Parameter that the body moves by, for its work
    """

    wall: str
    distance: Callable[[CoefficientFunction], CoefficientFunction]
    penalty: float
    softness: float
    share: float = 0.0
    offset: ngs.Parameter = field(default_factory=lambda: ngs.Parameter(0.0), compare=False)
    way: ngs.Parameter | None = None

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

    def driving(self, u: CoefficientFunction) -> CoefficientFunction:
        """∂(energy)/∂way (J/m²): what moving the body takes, whatever its shape; 0 without a way."""
        return ngs.CF(0.0) if self.way is None else -self.pressure(u) * self.gap(u).Diff(self.way)

    def measure(self) -> ngs.comp.DifferentialSymbol:
        """The `ds` of every integral over the wall."""
        return ngs.ds(self.wall, intrules={ngs.TRIG: surface_rule()})


class Offset:
    """The equation of a contact's offset beside the residual of a body: g = a - share × mean penetration = 0.

    The mean penetration is ∫ p d / ∫ p over the wall, with the contact pressure p. Derivatives are those of the two
    integrals, taken by their variation.

    u      displacement of a body, a component of `unknowns`
    trial  its trial function in the space of `unknowns`
    """

    def __init__(self, contact: Contact, u: ngs.GridFunction, trial: CoefficientFunction, unknowns: ngs.GridFunction):
        self.contact, self.unknowns = contact, unknowns
        mesh, a = u.space.mesh, contact.offset
        self._where = {"mesh": mesh, "definedon": mesh.Boundaries(contact.wall), "order": SURFACE_ORDER}

        def moments(u: CoefficientFunction) -> tuple[CoefficientFunction, CoefficientFunction]:
            pressure = contact.pressure(u)
            return pressure, pressure * (a - contact.gap(u))

        force, depth = moments(u)
        self._values = ngs.CF((force, depth, force.Diff(a), depth.Diff(a))).Compile()
        self._forms = []
        for moment in moments(trial):
            form = ngs.BilinearForm(unknowns.space)
            form += ngs.Variation(moment.Compile() * contact.measure())
            self._forms.append(form)

    @property
    def value(self) -> float:
        """a (m)."""
        return float(self.contact.offset.Get())

    @value.setter
    def value(self, offset: float) -> None:
        self.contact.offset.Set(float(offset))

    def missing(self) -> float:
        """g (m) at the current state; 0 where nothing touches and the offset is 0."""
        force, depth, *_ = ngs.Integrate(self._values, **self._where)
        return self.value - (self.contact.share * depth / force if force else 0.0)

    def border(self) -> tuple[np.ndarray, np.ndarray, float]:
        """∂R/∂a, ∂g/∂(unknowns) and ∂g/∂a, with the residual R of the body; an energy's mixed derivative is the force's."""
        force, depth, force_a, depth_a = ngs.Integrate(self._values, **self._where)
        by_force, by_depth = (self._gradient(form) for form in self._forms)
        if not force:
            return by_force, 0 * by_depth, 1.0
        mean, share = depth / force, self.contact.share
        return by_force, -share * (by_depth - mean * by_force) / force, 1 - share * (depth_a - mean * force_a) / force

    def _gradient(self, form: ngs.BilinearForm) -> np.ndarray:
        vector = self.unknowns.vec.CreateVector()
        form.Apply(self.unknowns.vec, vector)
        return vector.FV().NumPy().copy()


def surface_rule() -> ngs.IntegrationRule:
    """Quadrature on walls."""
    return ngs.IntegrationRule(ngs.TRIG, SURFACE_ORDER)


def current_normal_area(u: ngs.GridFunction) -> CoefficientFunction:
    """cof(F) N on a boundary: the current normal times current over reference area.

    On a boundary the gradient of a GridFunction is the tangential one, which is all that this needs.
    """
    return ngs.Cof(ngs.Id(3) + ngs.Grad(u)) * ngs.specialcf.normal(3)
