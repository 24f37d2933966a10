"""A rigid body against a named wall: a boundary energy of its signed distance and of what makes up for its penalty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from ngsolve.comp import IntegrationRuleSpaceSurface

from ngbrain.forward.common.kinematics import SolidKinematics
from ngbrain.forward.common.penalty import soft_penalty
from ngbrain.forward.common.unknowns import SolutionFields

SURFACE_ORDER = 8
"""Order of the quadrature on walls, whatever the elements': the contact zone ends inside facets.

Where it does, another rule is another contact: energy, force, area and pressure must all see the same points.
"""
NO_OFFSET = ngs.CF(0.0)
RULES = {shape: ngs.IntegrationRule(shape, SURFACE_ORDER) for shape in (ngs.SEGM, ngs.TRIG, ngs.QUAD)}


@dataclass(frozen=True)
class RigidContact:
    """Unilateral, frictionless contact of a wall with a rigid body: a penalty, and an offset that makes up for it.

    With the depth d = a - φ(X + u), the pressure on the reference area is ψ'(d): 0 for d ≤ 0, ε d²/(2s) up to d = s and
    ε (d - s/2) beyond: continuous with its derivative, so that a wall coming into touch does not unsettle Newton's
    method, and exactly zero where there is a gap. The energy per area is

        ψ(a - φ(X + u)) - ε a²/(2 θ) .

    The offset a ≥ 0 (m) is a field on the wall by which the body stands further out, unknown like the displacements: the energy
    is largest where a is θ/ε times the pressure, in the mean with each of its shape functions, and the wall then goes where
    the body should have put it but for (1 - θ) of the penalty's mean depth and for half the softness. It is an augmented
    Lagrangian, with the multiplier ε a/θ and θ just below 1, so that the equations of the offset keep a definite diagonal and
    need no pivoting. Of the displacements' order it has no more equations than the wall has ways to go, and does not lock its
    elements, as a multiplier at every point or a much higher penalty does. Forces, tangent and the offset's equation follow
    from the energy.

    wall       boundary name or pattern; it sees only this body
    distance   x ↦ φ(x), signed distance (m) to the body at the current position x, negative inside; one that is looked up has
               `follow(x, points, wall)` and `look()` besides (`surgery.tools.closed_surface`)
    penalty    ε (Pa/m)
    softness   s (m)
    share      θ in [0, 1), of the depth that the offset makes up for; 0: a penalty alone, a = 0
    way        Parameter that the body moves by, for its work

    Source: Alart and Curnier 1991, 10.1016/0045-7825(91)90022-X.
    """

    wall: str
    distance: Callable[[CoefficientFunction], CoefficientFunction]
    penalty: float
    softness: float
    share: float = 0.0
    way: ngs.Parameter | None = None

    def follow(self, u: ngs.GridFunction) -> Callable[[], None] | None:
        """Say which displacement tells where points stand, to a distance that is looked up: its `look`; else None."""
        if not self._looked_up:
            return None
        looked_up: Any = self.distance
        mesh = u.space.mesh
        looked_up.follow(ngs.CF((ngs.x, ngs.y, ngs.z)[: mesh.dim]) + u, self._points(mesh), mesh.Boundaries(self.wall))
        look: Callable[[], None] = looked_up.look
        look()
        return look

    def gaps(self, u: ngs.GridFunction) -> Callable[[], np.ndarray]:
        """What gives φ (m) at the points of the wall's quadrature, where the body stands then."""
        mesh, gap = u.space.mesh, self.gap(u).Compile()
        wall = mesh.Boundaries(self.wall)
        if not self._looked_up:
            points = mesh.MapToAllElements(surface_rules(mesh), wall)
            return lambda: np.asarray(gap(points))
        found = ngs.GridFunction(self._points(mesh))  # fields on them are read rightly by fields on them alone

        def at_points() -> np.ndarray:
            found.Interpolate(gap, definedon=wall)
            return np.asarray(found.vec.FV().NumPy())

        return at_points

    @property
    def _looked_up(self) -> bool:
        return hasattr(self.distance, "follow")

    def _points(self, mesh: ngs.Mesh) -> ngs.FESpace:
        """Space with an unknown for each point of the wall's quadrature."""
        return IntegrationRuleSpaceSurface(mesh, order=SURFACE_ORDER // 2, definedon=mesh.Boundaries(self.wall))

    def gap(self, u: CoefficientFunction) -> CoefficientFunction:
        """φ(X + u) in m."""
        return self.distance(ngs.CF((ngs.x, ngs.y, ngs.z)[: u.dim]) + u)

    def energy(self, u: CoefficientFunction, offset: CoefficientFunction = NO_OFFSET) -> CoefficientFunction:
        """Energy per reference area (J/m²)."""
        stored = soft_penalty(offset - self.gap(u), self.penalty, self.softness)
        return stored - self.penalty / (2 * self.share) * offset**2 if self.share else stored

    def pressure(self, u: CoefficientFunction, offset: CoefficientFunction = NO_OFFSET) -> CoefficientFunction:
        """Contact force per reference area (Pa)."""
        d, s = offset - self.gap(u), self.softness
        return self.penalty * ngs.IfPos(d, ngs.IfPos(d - s, d - s / 2, d * d / (2 * s)), 0)

    def driving(self, u: CoefficientFunction, offset: CoefficientFunction = NO_OFFSET) -> CoefficientFunction:
        """∂(energy)/∂way (J/m²): what moving the body takes, whatever its shape; 0 without a way."""
        return ngs.CF(0.0) if self.way is None else -self.pressure(u, offset) * self.gap(u).Diff(self.way)

    def join(self, form: ngs.BilinearForm, at: SolutionFields, kinematics: SolidKinematics) -> None:
        """Add the energy to a form of a problem's."""
        form += ngs.Variation((kinematics.weight() * self.energy(at.u, at.offset)).Compile() * self.measure())

    def measure(self) -> ngs.comp.DifferentialSymbol:
        """The `ds` of every integral over the wall."""
        return ngs.ds(self.wall, intrules=RULES)


@dataclass(frozen=True)
class Sliding:
    """A wall that slides freely along the rigid surface that it lies on, and never leaves it: energy κ/2 (u · N)² per area.

    As a brain does on the skull with a film of fluid between, which neither bears shear nor can open. For displacements that are
    small beside the surface's radii: N is the normal at rest. It is continuous, made of the facets' by projection: facets that
    meet at angles, each with its own, would hold a wall by its edges.

    wall       boundary name or pattern
    stiffness  κ (Pa/m)
    normal     N; `Sliding.on` makes it

    >>> from ngbrain.mesh import block
    >>> Sliding.on(block(maxh=0.02), "bottom", 1e8).wall
    'bottom'
    """

    wall: str
    stiffness: float
    normal: CoefficientFunction

    @classmethod
    def on(cls, mesh: ngs.Mesh, wall: str, stiffness: float) -> Sliding:
        """With the normals of a mesh."""
        normal = ngs.GridFunction(ngs.VectorH1(mesh, order=2))
        normal.Set(ngs.specialcf.normal(mesh.dim), definedon=mesh.Boundaries(wall))
        return cls(wall, stiffness, normal / ngs.Norm(normal))

    def energy(self, u: CoefficientFunction) -> CoefficientFunction:
        """Energy per reference area (J/m²)."""
        return self.stiffness / 2 * ngs.InnerProduct(u, self.normal) ** 2

    def join(self, form: ngs.BilinearForm, at: SolutionFields, kinematics: SolidKinematics) -> None:
        """Add the energy to a form of a problem's."""
        measure = self.measure(displacements(form).globalorder)
        form += ngs.Variation(kinematics.weight() * self.energy(at.u) * measure)

    def measure(self, order: int) -> ngs.comp.DifferentialSymbol:
        """The `ds` of every integral over the wall, for displacements of an order."""
        return ngs.ds(self.wall, intrules={shape: ngs.IntegrationRule(shape, 2 * order) for shape in RULES})


@dataclass(frozen=True)
class Closing:
    """Two walls of one body, plane and parallel at rest, that come to bear on each other when the cleft between them closes.

    The energy per area of `wall` is ψ(d) of `RigidContact` with d = (x - x') · N, for its current points x, those x' that lay
    opposite on the other wall at rest, and the normal N at rest: for walls that slip along each other by less than what they
    are uneven over. Neither friction nor offset; a point with nothing opposite within `reach` sees nothing.

    wall, other  boundary names or patterns
    penalty      ε (Pa/m)
    softness     s (m)
    reach        from wall to wall (m), at most

    >>> Closing("wall_plus", "wall_minus", 1e8, 1e-5, reach=6e-3).other
    'wall_minus'
    """

    wall: str
    other: str
    penalty: float
    softness: float
    reach: float

    def join(self, form: ngs.BilinearForm, at: SolutionFields, kinematics: SolidKinematics) -> ngs.comp.ContactBoundary:
        """Add the energy to a form of a problem's; what comes back has to live as long as the form."""
        mesh, space = form.space.mesh, displacements(form)
        pairs = ngs.comp.ContactBoundary(mesh.Boundaries(self.wall), mesh.Boundaries(self.other))
        x = ngs.CF((ngs.x, ngs.y, ngs.z)[: mesh.dim])
        across = (x + at.u) - (x.Other() + at.u.Other())
        pressed = soft_penalty(ngs.InnerProduct(across, pairs.normal), self.penalty, self.softness)
        pairs.AddEnergy((kinematics.weight() * pressed).Compile())
        pairs.Update(ngs.GridFunction(space), form, 2 * space.globalorder, self.reach)
        return pairs


def offsets(mesh: ngs.Mesh, contacts: Sequence[object], order: int, **options: bool) -> ngs.FESpace:
    """Space of the offsets of all contacts that have one; without unknowns if none has."""
    walls = "|".join(contact.wall for contact in contacts if isinstance(contact, RigidContact) and contact.share)
    return ngs.Compress(ngs.H1(mesh, order=order, definedon=mesh.Boundaries(walls), **options))


Touch = RigidContact | Sliding | Closing
"""What acts on walls."""


def surface_rules(mesh: ngs.Mesh) -> dict[ngs.ET, ngs.IntegrationRule]:
    """Quadrature on the walls of a mesh."""
    return {shape: rule for shape, rule in RULES.items() if (shape is ngs.SEGM) == (mesh.dim == 2)}


def displacements(form: ngs.BilinearForm) -> ngs.FESpace:
    """The displacements' part of a form's space."""
    return form.space if form.space.type == "VectorH1" else form.space.components[0]
