"""Coulomb friction between a wall and a rigid body: a boundary energy in each time step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from ngsolve.comp import IntegrationRuleSpaceSurface

from ngbrain.forward.common.kinematics import SolidKinematics
from ngbrain.forward.common.state import Term
from ngbrain.forward.common.unknowns import Layout, SolutionFields
from ngbrain.forward.contact.rigid import SURFACE_ORDER, RigidContact
from ngbrain.materials.base import Value, check_parameter, check_positive

TINY = 1e-14
"""Keeps square roots and quotients of numbers of order 1 finite at zero."""

Moves = Callable[[CoefficientFunction, CoefficientFunction], CoefficientFunction]
"""x, travel ↦ displacement (m) of a rigid body at that travel, a vector; for an expanding body, that of its surface at x."""


@dataclass(frozen=True)
class Friction:
    """Coulomb friction in a `RigidContact`, with an elastic slip in place of the sharp stick-slip transition.

    With the elastic slip e and the displacement u₀ at the start of a time step, the body's own displacement b since then, and
    the contact's normal n = ∇φ, the traction per reference area on the wall is -τ,

        g = (1 - n⊗n)(e + u - u₀ - b),   τ = μP s(|g|/r) g/|g|,   s(y) = (3y - y³)/2 up to y = 1, and 1 beyond,

    from an energy per area in g that is convex and twice continuously differentiable. At the end of a step the elastic slip is
    the part of g no longer than r, and zero without pressure: a sticking wall moves by at most r, whatever the number of steps,
    and moves back. P and n are those at the end of the step but are not varied: the tangent is symmetric and positive
    semi-definite, and omits only the dependence of τ on P.

    Parameters
    ----------
    contact : RigidContact
        Contact whose pressure P acts; on the same problem.
    coefficient : float or Parameter
        Friction coefficient μ.
    slip : float or Parameter
        Elastic slip r (m) before sliding.
    moves : callable, optional
        x, travel ↦ displacement of the body at the contact's travel; b is its increment in a step, so that a body may move down and
        then sideways. None: the surface is at rest, or moves along its normal.

    Raises
    ------
    InputError
        For a coefficient below 0 or a slip that is not positive.

    References
    ----------
    Simo and Laursen 1992, 10.1016/0045-7949(92)90540-G, with a penalty in place of the slip.

    Examples
    --------
    >>> plate = RigidContact("top", lambda x: 0.02 - x[2], 1e8, 1e-5)
    >>> Friction(plate, 0.1, 1e-5, lambda x, travel: ngs.CF((travel, 0, 0))).wall
    'top'
    """

    contact: RigidContact
    coefficient: Value
    slip: Value
    moves: Moves | None = None

    def __post_init__(self) -> None:
        check_parameter(self.coefficient, "friction coefficient", lambda mu: mu >= 0, "a number of at least 0")
        check_positive(self.slip, "slip of friction")

    @property
    def wall(self) -> str:
        """Wall of the contact."""
        return self.contact.wall

    def energy(self, g: CoefficientFunction, pressure: CoefficientFunction) -> CoefficientFunction:
        """Frictional energy per reference area (J/m²).

        Parameters
        ----------
        g : CoefficientFunction
            Tangential slip (m).
        pressure : CoefficientFunction
            Contact pressure (Pa).

        Returns
        -------
        CoefficientFunction
        """
        square = ngs.InnerProduct(g, g) / self.slip**2
        sticks, slides = square * (6 - square) / 8, _root(square) - 3 / 8
        return self.coefficient * self.slip * pressure * ngs.IfPos(square - 1, slides, sticks)

    def elastic(self, g: CoefficientFunction, pressure: CoefficientFunction) -> CoefficientFunction:
        """Elastic (reversible) part of the slip (m).

        Parameters
        ----------
        g, pressure : CoefficientFunction
            Tangential slip (m) and contact pressure (Pa).

        Returns
        -------
        CoefficientFunction
        """
        square = ngs.InnerProduct(g, g) / self.slip**2
        return ngs.IfPos(pressure, ngs.IfPos(square - 1, 1 / _root(square), 1), 0) * g


class FrictionTerm(Term):
    """Friction term of a problem in the current time step, with pressures and normals of the current unknowns.

    Parameters
    ----------
    layout : Layout
    gfu : GridFunction
        Current unknowns.
    frictions : sequence of Friction
    kinematics : SolidKinematics

    Attributes
    ----------
    form : BilinearForm
        The friction energies alone.
    walls : list of FrictionFields
        Each friction law with its fields on the wall.
    start : GridFunction
        Unknowns at the start of the step.
    """

    def __init__(
        self, layout: Layout, gfu: ngs.GridFunction, frictions: Sequence[Friction], kinematics: SolidKinematics
    ) -> None:
        self.layout, self.frictions, self._gfu = layout, frictions, gfu
        self.form = ngs.BilinearForm(gfu.space, symmetric=True)
        self.walls: list[FrictionFields] = []
        self.slips: list[np.ndarray] = []
        if frictions:
            self.start, self._vec = ngs.GridFunction(gfu.space), gfu.vec.CreateVector()
            start = layout.fields(self.start).u
            self.walls = [FrictionFields(friction, layout.fields(gfu), start, kinematics) for friction in frictions]
            self.join(self.form)
        self.finish()

    def join(self, form: ngs.BilinearForm) -> None:
        """Add the energies to a form of the problem's."""
        for wall in self.walls:
            wall.join(form, self.layout)

    def join_driving_force(self, force: ngs.BilinearForm, stiffness: ngs.BilinearForm, travel: ngs.Parameter) -> None:
        """Add first and second derivatives of the energies with respect to a travel to forms of the problem.

        Parameters
        ----------
        force, stiffness : BilinearForm
            Forms of the first and the second derivative.
        travel : ngsolve.Parameter
            Travel of the contacts concerned.
        """
        for wall in self.walls:
            if wall.friction.contact.travel is travel:
                wall.join_driving_force(force, stiffness, self.layout)

    def boundary_forms(self) -> list[tuple[str | None, ngs.BilinearForm]]:
        """The form of each friction law, with its wall."""
        found: list[tuple[str | None, ngs.BilinearForm]] = []
        for wall in self.walls:
            form = ngs.BilinearForm(self.form.space, symmetric=True)
            wall.join(form, self.layout)
            found.append((wall.friction.wall, form))
        return found

    def reset(self) -> None:
        """Reset slip and traction to zero."""
        self.slips = [np.zeros_like(slip) for slip in self.slips]

    def begin(self, dt: float) -> None:
        """Begin a time step at the current unknowns and positions of the bodies."""
        if self.frictions:
            start, travels = _values(self._gfu).copy(), [wall.travel for wall in self.walls]
            self.frozen = {"start": start, "ways": travels, "slips": self.slips}

    def finish(self) -> None:
        """End the step; forces can still be read."""
        self.slips = [wall.end() for wall in self.walls]

    def forces(self) -> np.ndarray | float:
        """Nodal forces, one for each unknown; 0 for all without friction."""
        if not self.frictions:
            return 0.0
        self.form.Apply(self._gfu.vec, self._vec)
        return self._vec.FV().NumPy().copy()

    def work(self) -> float:
        """Frictional work (J) since the start of the step, by the trapezoidal rule, like the work on the tissue.

        In a step that reverses direction it is underestimated, and may be negative.
        """
        return sum((wall.integral(wall.work) for wall in self.walls), 0.0)

    def driving_force(self) -> float:
        """∂(energy)/∂travel (J/m): contribution of friction to `RigidContact.driving_force`."""
        return sum((wall.integral(wall.driving_force) for wall in self.walls), 0.0)

    @property
    def internal(self) -> Mapping[str, Any]:
        """Elastic slips and tractions."""
        return {"slips": self.slips} if self.frictions else {}

    @internal.setter
    def internal(self, saved: Mapping[str, Any]) -> None:
        if self.frictions:
            self.slips = saved["slips"]

    @property
    def frozen(self) -> Mapping[str, Any]:
        """Coefficients of the energies of the current step, apart from the unknowns."""
        if not self.frictions:
            return {}
        slips = [np.array([_values(wall.slip), _values(wall.before)]) for wall in self.walls]
        return {"start": _values(self.start).copy(), "ways": [wall.start.Get() for wall in self.walls], "slips": slips}

    @frozen.setter
    def frozen(self, saved: Mapping[str, Any]) -> None:
        if self.frictions:
            _values(self.start)[:] = saved["start"]
            for wall, travel, slip in zip(self.walls, saved["ways"], saved["slips"], strict=True):
                wall.start.Set(travel)
                _values(wall.slip)[:], _values(wall.before)[:] = slip


class FrictionExpressions:
    """Symbolic expressions of a wall with friction: slip, traction and elastic slip.

    Parameters
    ----------
    friction : Friction
    u, offset : CoefficientFunction
        Displacement and contact offset (m).
    start, slip : CoefficientFunction
        Displacement and elastic slip (m) at the start of the step.
    before, travel : CoefficientFunction
        Travel of the rigid body (m) at the start, and since then; `travel` is a variable.

    Attributes
    ----------
    tangential_slip : tangential displacement relative to the body (m)
    traction, elastic : τ (Pa), and the elastic slip (m)
    moves : displacement of the body per metre of travel
    """

    def __init__(
        self,
        friction: Friction,
        u: CoefficientFunction,
        offset: CoefficientFunction,
        start: CoefficientFunction,
        slip: CoefficientFunction,
        before: CoefficientFunction,
        travel: CoefficientFunction,
    ) -> None:
        x = (ngs.CF((ngs.x, ngs.y, ngs.z)[: u.dim]) + u).MakeVariable()
        self._friction, self._start, self._slip = friction, start, slip
        self._normal = friction.contact.distance(x).Diff(x)
        self._pressure = friction.contact.pressure(u, offset)
        moves = friction.moves or (lambda x, travel: ngs.CF((0.0,) * u.dim))
        self._moved = moves(x, before + travel) - moves(x, before)
        self.moves = self._moved.Diff(travel)
        self.tangential_slip = self.tangential(self._relative_displacement(u))
        g = (self.tangential_slip + self.tangential(slip)).MakeVariable()
        self.traction = friction.energy(g, self._pressure).Diff(g)
        self.elastic = friction.elastic(g, self._pressure)

    def energy(self, u: CoefficientFunction) -> CoefficientFunction:
        """Energy per reference area (J/m²), for another displacement with the same pressure and normal."""
        return self._friction.energy(self.tangential(self._relative_displacement(u) + self._slip), self._pressure)

    def tangential(self, v: CoefficientFunction) -> CoefficientFunction:
        """Component of a vector tangential to the body's surface."""
        n = self._normal
        return v - ngs.InnerProduct(n, v) / (ngs.InnerProduct(n, n) + TINY) * n

    def _relative_displacement(self, u: CoefficientFunction) -> CoefficientFunction:
        return u - self._start - self._moved


class FrictionFields:
    """One friction law with its fields on the wall.

    Parameters
    ----------
    friction : Friction
    now : SolutionFields
        Current unknowns.
    start : GridFunction
        Displacement at the start of the step.
    kinematics : SolidKinematics

    Attributes
    ----------
    slip, before : e and τ at the start of the step, at the wall's quadrature points
    start : travel of the contact there
    """

    def __init__(
        self, friction: Friction, now: SolutionFields, start: ngs.GridFunction, kinematics: SolidKinematics
    ) -> None:
        self.friction, contact = friction, friction.contact
        mesh, u = now.u.space.mesh, now.u
        self.weight = kinematics.weight()
        self.on = mesh.Boundaries(friction.wall)
        # The contact's quadrature rule, so that fields can be evaluated at its points.
        points = IntegrationRuleSpaceSurface(mesh, order=SURFACE_ORDER // 2, definedon=self.on)
        self.measure = ngs.ds(friction.wall, intrules=points.GetIntegrationRules())
        self.slip, self.before, *self._ends = (ngs.GridFunction(ngs.VectorValued(points, mesh.dim)) for _ in range(4))
        self.start = ngs.Parameter(self.travel)
        # A separate variable: the energy is differentiated with respect to it at fixed pressure and normal.
        self.travel_increment = (ngs.CF(0.0) if contact.travel is None else contact.travel - self.start).MakeVariable()
        self.now = FrictionExpressions(friction, u, now.offset, start, self.slip, self.start, self.travel_increment)
        self._elastic, self._traction = self.now.elastic.Compile(), self.now.traction.Compile()
        self.work = (ngs.InnerProduct(self.now.traction + self.before, self.now.tangential_slip) / 2).Compile()
        self.driving_force = (-ngs.InnerProduct(self.now.traction, self.now.moves)).Compile()

    @property
    def travel(self) -> float:
        """Current travel of the contact (m)."""
        travel = self.friction.contact.travel
        return 0.0 if travel is None else float(travel.Get())

    def join(self, form: ngs.BilinearForm, layout: Layout) -> None:
        """Add the energy to a form of the problem.

        Parameters
        ----------
        form : BilinearForm
        layout : Layout
        """
        form += ngs.Variation((self.weight * self._energy(form.space, layout)).Compile() * self.measure)

    def join_driving_force(self, force: ngs.BilinearForm, stiffness: ngs.BilinearForm, layout: Layout) -> None:
        """Add first and second derivatives of the energy with respect to the contact's travel to forms of the problem.

        Parameters
        ----------
        force, stiffness : BilinearForm
            Forms of the first and the second derivative.
        layout : Layout
        """
        once = self._energy(force.space, layout).Diff(self.travel_increment)
        for form, derivative in ((force, once), (stiffness, once.Diff(self.travel_increment))):
            form += ngs.Variation((self.weight * derivative).Compile() * self.measure)

    def _energy(self, space: ngs.FESpace, layout: Layout) -> CoefficientFunction:
        """Energy per reference area (J/m²)."""
        return self.now.energy(layout.fields(space.TrialFunction()).u)

    def end(self) -> np.ndarray:
        """Elastic slip and traction at the current unknowns."""
        for field, value in zip(self._ends, (self._elastic, self._traction), strict=True):
            field.Interpolate(value, definedon=self.on)
        return np.array([_values(field) for field in self._ends])

    def integral(self, value: CoefficientFunction) -> float:
        """Integral over the wall."""
        return float(ngs.Integrate(self.weight * value * self.measure, self.slip.space.mesh))


def _root(square: CoefficientFunction) -> CoefficientFunction:
    """Square root, finite at 0."""
    return ngs.sqrt(square + TINY)


def _values(field: ngs.GridFunction) -> Any:
    return field.vec.FV().NumPy()
