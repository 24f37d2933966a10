"""Contact of a wall with a rigid body: a boundary energy of the signed distance, with an augmented-Lagrangian offset."""

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
"""Order of the quadrature on walls, for elements of any order: the contact zone ends inside facets.

There another rule would be another contact: energy, force, area and pressure must use the same points.
"""
NO_OFFSET = ngs.CF(0.0)
RULES = {shape: ngs.IntegrationRule(shape, SURFACE_ORDER) for shape in (ngs.SEGM, ngs.TRIG, ngs.QUAD)}


@dataclass(frozen=True)
class RigidContact:
    """Unilateral, frictionless contact of a wall with a rigid body: a penalty with an augmented-Lagrangian offset.

    With the depth d = a - φ(X + u), the pressure on the reference area is ψ'(d): 0 for d ≤ 0, ε d²/(2s) up to d = s and
    ε (d - s/2) beyond. It is continuously differentiable, which helps Newton's method at first touch, and exactly zero in a gap.
    The energy per area is

        ψ(a - φ(X + u)) - ε a²/(2 θ) .

    The offset a ≥ 0 (m) is an unknown field on the wall that moves the body's surface outwards. The energy is stationary where
    a is θ/ε times the pressure, in the mean with each shape function. The remaining penetration is then (1 - θ) of the
    penalty's mean depth and half the softness. This is an augmented Lagrangian with the multiplier ε a/θ; with θ just below 1
    the diagonal of the offset's equations is definite and needs no pivoting. An offset of the displacements' order does not
    lock the elements, unlike a multiplier at every point or a much higher penalty.

    Parameters
    ----------
    wall : str
        Boundary name or pattern; it meets this body only.
    distance : callable
        x ↦ φ(x), signed distance (m) to the body at the current position, negative inside. A tabulated one also has
        `follow(x, points, wall)` and `look()` (`surgery.tools.closed_surface`).
    penalty : float
        ε (Pa/m).
    softness : float
        s (m).
    share : float
        θ in [0, 1), fraction of the penetration that the offset compensates for; 0: penalty only, a = 0.
    travel : ngsolve.Parameter, optional
        Travel of the body, needed for its work.

    References
    ----------
    Alart and Curnier 1991, 10.1016/0045-7825(91)90022-X.
    """

    wall: str
    distance: Callable[[CoefficientFunction], CoefficientFunction]
    penalty: float
    softness: float
    share: float = 0.0
    travel: ngs.Parameter | None = None

    def follow(self, u: ngs.GridFunction) -> Callable[[], None] | None:
        """Connect a tabulated distance to a displacement; returns its `look`, which updates it, or None for a symbolic
        distance."""
        if not self._looked_up:
            return None
        looked_up: Any = self.distance
        mesh = u.space.mesh
        looked_up.follow(ngs.CF((ngs.x, ngs.y, ngs.z)[: mesh.dim]) + u, self._points(mesh), mesh.Boundaries(self.wall))
        look: Callable[[], None] = looked_up.look
        look()
        return look

    def gaps(self, u: ngs.GridFunction) -> Callable[[], np.ndarray]:
        """Function that gives φ (m) at the quadrature points of the wall, for the current state of the body."""
        mesh, gap = u.space.mesh, self.gap(u).Compile()
        wall = mesh.Boundaries(self.wall)
        if not self._looked_up:
            points = mesh.MapToAllElements(surface_rules(mesh), wall)
            return lambda: np.asarray(gap(points))
        found = ngs.GridFunction(self._points(mesh))  # fields at quadrature points are correct only at these points

        def at_points() -> np.ndarray:
            found.Interpolate(gap, definedon=wall)
            return np.asarray(found.vec.FV().NumPy())

        return at_points

    @property
    def _looked_up(self) -> bool:
        return hasattr(self.distance, "follow")

    def _points(self, mesh: ngs.Mesh) -> ngs.FESpace:
        """Space with one unknown per quadrature point of the wall."""
        return IntegrationRuleSpaceSurface(mesh, order=SURFACE_ORDER // 2, definedon=mesh.Boundaries(self.wall))

    def gap(self, u: CoefficientFunction) -> CoefficientFunction:
        """φ(X + u) in m."""
        return self.distance(ngs.CF((ngs.x, ngs.y, ngs.z)[: u.dim]) + u)

    def energy(self, u: CoefficientFunction, offset: CoefficientFunction = NO_OFFSET) -> CoefficientFunction:
        """Contact energy per reference area (J/m²).

        Parameters
        ----------
        u, offset : CoefficientFunction
            Displacement and offset (m).

        Returns
        -------
        CoefficientFunction
        """
        stored = soft_penalty(offset - self.gap(u), self.penalty, self.softness)
        return stored - self.penalty / (2 * self.share) * offset**2 if self.share else stored

    def pressure(self, u: CoefficientFunction, offset: CoefficientFunction = NO_OFFSET) -> CoefficientFunction:
        """Contact pressure on the reference area (Pa).

        Parameters
        ----------
        u, offset : CoefficientFunction
            Displacement and offset (m).

        Returns
        -------
        CoefficientFunction
        """
        d, s = offset - self.gap(u), self.softness
        return self.penalty * ngs.IfPos(d, ngs.IfPos(d - s, d - s / 2, d * d / (2 * s)), 0)

    def driving_force(self, u: CoefficientFunction, offset: CoefficientFunction = NO_OFFSET) -> CoefficientFunction:
        """Driving force per area, ∂(energy)/∂way (N/m²): the force needed to move the body; 0 without a travel.

        Parameters
        ----------
        u, offset : CoefficientFunction
            Displacement and offset (m).

        Returns
        -------
        CoefficientFunction
        """
        return ngs.CF(0.0) if self.travel is None else -self.pressure(u, offset) * self.gap(u).Diff(self.travel)

    def join(self, form: ngs.BilinearForm, at: SolutionFields, kinematics: SolidKinematics) -> None:
        """Add the energy to a form of a problem.

        Parameters
        ----------
        form : BilinearForm
        at : SolutionFields
            Trial functions.
        kinematics : SolidKinematics
        """
        form += ngs.Variation((kinematics.weight() * self.energy(at.u, at.offset)).Compile() * self.measure())

    def measure(self) -> ngs.comp.DifferentialSymbol:
        """Surface measure of all integrals over the wall."""
        return ngs.ds(self.wall, intrules=RULES)


@dataclass(frozen=True)
class SlidingSupport:
    """Bilateral sliding support along the rigid surface on which a wall lies: energy κ/2 (u · N)² per area.

    Models the brain on the skull with a fluid film that neither transmits shear nor opens. Valid for displacements small compared
    with the surface's radii of curvature: N is the normal of the reference configuration, made continuous by projection. Normals
    of the facets would constrain the wall at edges between facets.

    Parameters
    ----------
    wall : str
        Boundary name or pattern.
    stiffness : float
        κ (Pa/m).
    normal : CoefficientFunction
        N; `SlidingSupport.on` makes it.

    Examples
    --------
    >>> from ngbrain.mesh import block
    >>> SlidingSupport.on(block(maxh=0.02), "bottom", 1e8).wall
    'bottom'
    """

    wall: str
    stiffness: float
    normal: CoefficientFunction

    @classmethod
    def on(cls, mesh: ngs.Mesh, wall: str, stiffness: float) -> SlidingSupport:
        """With the normals of a mesh."""
        normal = ngs.GridFunction(ngs.VectorH1(mesh, order=2))
        normal.Set(ngs.specialcf.normal(mesh.dim), definedon=mesh.Boundaries(wall))
        return cls(wall, stiffness, normal / ngs.Norm(normal))

    def energy(self, u: CoefficientFunction) -> CoefficientFunction:
        """Energy per reference area (J/m²)."""
        return self.stiffness / 2 * ngs.InnerProduct(u, self.normal) ** 2

    def join(self, form: ngs.BilinearForm, at: SolutionFields, kinematics: SolidKinematics) -> None:
        """Add the energy to a form of a problem.

        Parameters
        ----------
        form : BilinearForm
        at : SolutionFields
            Trial functions.
        kinematics : SolidKinematics
        """
        measure = self.measure(displacements(form).globalorder)
        form += ngs.Variation(kinematics.weight() * self.energy(at.u) * measure)

    def measure(self, order: int) -> ngs.comp.DifferentialSymbol:
        """Surface measure of all integrals over the wall, for displacements of an order."""
        return ngs.ds(self.wall, intrules={shape: ngs.IntegrationRule(shape, 2 * order) for shape in RULES})


@dataclass(frozen=True)
class SelfContact:
    """Frictionless self-contact of the two walls of a cleft, plane and parallel at rest, when it closes.

    The energy per area of `wall` is ψ(d) of `RigidContact` with d = (x - x') · N, for current points x, the points x' opposite
    on the other wall at rest, and the normal N at rest: valid while the walls slide along each other by less than the length
    scale of their unevenness. There is no offset; points without an opposite point within `reach` do not count.

    Parameters
    ----------
    wall, other : str
        Boundary names or patterns.
    penalty : float
        ε (Pa/m).
    softness : float
        s (m).
    reach : float
        Largest distance from wall to wall (m).

    Examples
    --------
    >>> SelfContact("wall_plus", "wall_minus", 1e8, 1e-5, reach=6e-3).other
    'wall_minus'
    """

    wall: str
    other: str
    penalty: float
    softness: float
    reach: float

    def join(self, form: ngs.BilinearForm, at: SolutionFields, kinematics: SolidKinematics) -> ngs.comp.ContactBoundary:
        """Add the energy to a form of a problem.

        Parameters
        ----------
        form : BilinearForm
        at : SolutionFields
            Trial functions.
        kinematics : SolidKinematics

        Returns
        -------
        ContactBoundary
            Has to be kept as long as the form.
        """
        mesh, space = form.space.mesh, displacements(form)
        pairs = ngs.comp.ContactBoundary(mesh.Boundaries(self.wall), mesh.Boundaries(self.other))
        x = ngs.CF((ngs.x, ngs.y, ngs.z)[: mesh.dim])
        across = (x + at.u) - (x.Other() + at.u.Other())
        pressed = soft_penalty(ngs.InnerProduct(across, pairs.normal), self.penalty, self.softness)
        pairs.AddEnergy((kinematics.weight() * pressed).Compile())
        pairs.Update(ngs.GridFunction(space), form, 2 * space.globalorder, self.reach)
        return pairs


def offsets(mesh: ngs.Mesh, contacts: Sequence[object], order: int, **options: bool) -> ngs.FESpace:
    """Space of the contact offsets; empty if no contact has one.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    contacts : sequence
    order : int
        Order of the displacements.
    **options : bool
        Such as complex=True.

    Returns
    -------
    FESpace
    """
    walls = "|".join(contact.wall for contact in contacts if isinstance(contact, RigidContact) and contact.share)
    return ngs.Compress(ngs.H1(mesh, order=order, definedon=mesh.Boundaries(walls), **options))


WallContact = RigidContact | SlidingSupport | SelfContact
"""Interactions of walls."""


def surface_rules(mesh: ngs.Mesh) -> dict[ngs.ET, ngs.IntegrationRule]:
    """Quadrature on the walls of a mesh."""
    return {shape: rule for shape, rule in RULES.items() if (shape is ngs.SEGM) == (mesh.dim == 2)}


def displacements(form: ngs.BilinearForm) -> ngs.FESpace:
    """Displacement space of a form."""
    return form.space if form.space.type == "VectorH1" else form.space.components[0]
