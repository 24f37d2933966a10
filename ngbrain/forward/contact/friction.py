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
"""Keeps roots and quotients of numbers about 1 finite at zero."""

Moves = Callable[[CoefficientFunction, CoefficientFunction], CoefficientFunction]
"""x, way ↦ how far (m) a rigid body has gone at that way, a vector; of one that widens, its surface at x."""


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
        x, way ↦ displacement of the body at the contact's travel; b is its increment in a step, so that a body may move down and
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
    >>> Friction(plate, 0.1, 1e-5, lambda x, way: ngs.CF((way, 0, 0))).wall
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
        """The contact's."""
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
    """Friction terms of a problem in the current time step, with pressures and normals of the current unknowns.

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
    rubs : list of FrictionFields
        Each friction with its fields.
    start : GridFunction
        Unknowns at the start of the step.
    """

    def __init__(
        self, layout: Layout, gfu: ngs.GridFunction, frictions: Sequence[Friction], kinematics: SolidKinematics
    ) -> None:
        self.layout, self.frictions, self._gfu = layout, frictions, gfu
        self.form = ngs.BilinearForm(gfu.space, symmetric=True)
        self.rubs: list[FrictionFields] = []
        self.slips: list[np.ndarray] = []
        if frictions:
            self.start, self._vec = ngs.GridFunction(gfu.space), gfu.vec.CreateVector()
            start = layout.fields(self.start).u
            self.rubs = [FrictionFields(friction, layout.fields(gfu), start, kinematics) for friction in frictions]
            self.join(self.form)
        self.finish()

    def join(self, form: ngs.BilinearForm) -> None:
        """Add the energies to a form of the problem's."""
        for rub in self.rubs:
            rub.join(form, self.layout)

    def join_driving(self, felt: ngs.BilinearForm, stiffness: ngs.BilinearForm, way: ngs.Parameter) -> None:
        """Add first and second derivatives of the energies with respect to a travel to forms of the problem.

        Parameters
        ----------
        felt, stiffness : BilinearForm
            Of the first and the second derivative.
        way : ngsolve.Parameter
            Travel of the contacts concerned.
        """
        for rub in self.rubs:
            if rub.friction.contact.way is way:
                rub.join_driving(felt, stiffness, self.layout)

    def boundary_forms(self) -> list[tuple[str | None, ngs.BilinearForm]]:
        """Each by itself, with its wall."""
        found: list[tuple[str | None, ngs.BilinearForm]] = []
        for rub in self.rubs:
            form = ngs.BilinearForm(self.form.space, symmetric=True)
            rub.join(form, self.layout)
            found.append((rub.friction.wall, form))
        return found

    def rest(self) -> None:
        """Without slip and traction."""
        self.slips = [np.zeros_like(slip) for slip in self.slips]

    def begin(self, dt: float) -> None:
        """Begin a time step at the unknowns that stand, with the bodies where they are."""
        if self.frictions:
            start, ways = _values(self._gfu).copy(), [rub.way for rub in self.rubs]
            self.frozen = {"start": start, "ways": ways, "slips": self.slips}

    def finish(self) -> None:
        """End the step begun; forces can still be read."""
        self.slips = [rub.end() for rub in self.rubs]

    def forces(self) -> np.ndarray | float:
        """Nodal forces, one for each unknown; 0 for all without friction."""
        if not self.frictions:
            return 0.0
        self.form.Apply(self._gfu.vec, self._vec)
        return self._vec.FV().NumPy().copy()

    def work(self) -> float:
        """What went into friction (J) since the step began, by the trapezoidal rule.

        As the tissue's work is measured; in a step that turns back it is too little, and may be negative.
        """
        return sum((rub.integral(rub.work) for rub in self.rubs), 0.0)

    def driving(self) -> float:
        """∂(energy)/∂way (J/m): what friction adds to `RigidContact.driving`."""
        return sum((rub.integral(rub.driving) for rub in self.rubs), 0.0)

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
        """All that the energies of the present step are made of, but for the unknowns that stand."""
        if not self.frictions:
            return {}
        slips = [np.array([_values(rub.slip), _values(rub.before)]) for rub in self.rubs]
        return {"start": _values(self.start).copy(), "ways": [rub.start.Get() for rub in self.rubs], "slips": slips}

    @frozen.setter
    def frozen(self, saved: Mapping[str, Any]) -> None:
        if self.frictions:
            _values(self.start)[:] = saved["start"]
            for rub, way, slip in zip(self.rubs, saved["ways"], saved["slips"], strict=True):
                rub.start.Set(way)
                _values(rub.slip)[:], _values(rub.before)[:] = slip


class FrictionExpressions:
    """Symbolic expressions of a wall with friction: slip, traction and elastic slip.

    Parameters
    ----------
    friction : Friction
    u, offset : CoefficientFunction
        Displacement and contact offset (m).
    start, slip : CoefficientFunction
        Displacement and elastic slip (m) at the start of the step.
    before, way : CoefficientFunction
        Travel of the rigid body (m) at the start, and since then; `way` is a variable.

    Attributes
    ----------
    gone : tangential displacement relative to the body (m)
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
        way: CoefficientFunction,
    ) -> None:
        x = (ngs.CF((ngs.x, ngs.y, ngs.z)[: u.dim]) + u).MakeVariable()
        self._friction, self._start, self._slip = friction, start, slip
        self._normal = friction.contact.distance(x).Diff(x)
        self._pressure = friction.contact.pressure(u, offset)
        moves = friction.moves or (lambda x, way: ngs.CF((0.0,) * u.dim))
        self._moved = moves(x, before + way) - moves(x, before)
        self.moves = self._moved.Diff(way)
        self.gone = self.tangential(self._gone(u))
        g = (self.gone + self.tangential(slip)).MakeVariable()
        self.traction = friction.energy(g, self._pressure).Diff(g)
        self.elastic = friction.elastic(g, self._pressure)

    def energy(self, u: CoefficientFunction) -> CoefficientFunction:
        """Per reference area (J/m²), for another displacement with the same pressure and normal."""
        return self._friction.energy(self.tangential(self._gone(u) + self._slip), self._pressure)

    def tangential(self, v: CoefficientFunction) -> CoefficientFunction:
        """Component of a vector tangential to the body's surface."""
        n = self._normal
        return v - ngs.InnerProduct(n, v) / (ngs.InnerProduct(n, n) + TINY) * n

    def _gone(self, u: CoefficientFunction) -> CoefficientFunction:
        return u - self._start - self._moved


class FrictionFields:
    """One friction with its fields on the wall.

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
        # Its rule is the contact's: of the same order, at whose points fields on it can be read.
        points = IntegrationRuleSpaceSurface(mesh, order=SURFACE_ORDER // 2, definedon=self.on)
        self.measure = ngs.ds(friction.wall, intrules=points.GetIntegrationRules())
        self.slip, self.before, *self._ends = (ngs.GridFunction(ngs.VectorValued(points, mesh.dim)) for _ in range(4))
        self.start = ngs.Parameter(self.way)
        # A variable of its own, by which the energy is derived while pressure and normal stay.
        self.way_gone = (ngs.CF(0.0) if contact.way is None else contact.way - self.start).MakeVariable()
        self.now = FrictionExpressions(friction, u, now.offset, start, self.slip, self.start, self.way_gone)
        self._elastic, self._traction = self.now.elastic.Compile(), self.now.traction.Compile()
        self.work = (ngs.InnerProduct(self.now.traction + self.before, self.now.gone) / 2).Compile()
        self.driving = (-ngs.InnerProduct(self.now.traction, self.now.moves)).Compile()

    @property
    def way(self) -> float:
        """Of the contact, now (m)."""
        way = self.friction.contact.way
        return 0.0 if way is None else float(way.Get())

    def join(self, form: ngs.BilinearForm, layout: Layout) -> None:
        """Add the energy to a form of the problem.

        Parameters
        ----------
        form : BilinearForm
        layout : Layout
        """
        form += ngs.Variation((self.weight * self._energy(form.space, layout)).Compile() * self.measure)

    def join_driving(self, felt: ngs.BilinearForm, stiffness: ngs.BilinearForm, layout: Layout) -> None:
        """Add first and second derivatives of the energy with respect to the contact's travel to forms of the problem.

        Parameters
        ----------
        felt, stiffness : BilinearForm
            Of the first and the second derivative.
        layout : Layout
        """
        once = self._energy(felt.space, layout).Diff(self.way_gone)
        for form, derivative in ((felt, once), (stiffness, once.Diff(self.way_gone))):
            form += ngs.Variation((self.weight * derivative).Compile() * self.measure)

    def _energy(self, space: ngs.FESpace, layout: Layout) -> CoefficientFunction:
        """Per reference area (J/m²)."""
        return self.now.energy(layout.fields(space.TrialFunction()).u)

    def end(self) -> np.ndarray:
        """Elastic slip and traction at the unknowns that stand."""
        for field, value in zip(self._ends, (self._elastic, self._traction), strict=True):
            field.Interpolate(value, definedon=self.on)
        return np.array([_values(field) for field in self._ends])

    def integral(self, value: CoefficientFunction) -> float:
        """Over the wall."""
        return float(ngs.Integrate(self.weight * value * self.measure, self.slip.space.mesh))


def _root(square: CoefficientFunction) -> CoefficientFunction:
    """Of what may be 0 where it is not needed."""
    return ngs.sqrt(square + TINY)


def _values(field: ngs.GridFunction) -> Any:
    return field.vec.FV().NumPy()
