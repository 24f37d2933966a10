"""Coulomb friction between a wall and a rigid body: one more boundary energy in every time step."""

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
    """Coulomb friction in a `RigidContact`: the wall sticks to the body up to a traction μP, and slides with that.

    With the elastic slip e and the displacement u₀ at the start of a time step, the body's own displacement b since then, and
    the contact's normal n = ∇φ, the traction per reference area on the wall is -τ,

        g = (1 - n⊗n)(e + u - u₀ - b),   τ = μP s(|g|/r) g/|g|,   s(y) = (3y - y³)/2 up to y = 1, and 1 beyond,

    from an energy per area in g, which is convex and twice continuously differentiable. At the end of a step the elastic slip is
    what of g is no longer than r, or none without a pressure: a wall that sticks goes no further than r, however many steps there
    are, and comes back. P and n are those of the end of the step too, but are not varied: the tangent is symmetric and positive
    semi-definite, and misses only what a change of P changes in τ.

    contact      whose pressure P presses; it has to act on the same body
    coefficient  μ, a number or a `Parameter`
    slip         r (m), by which a wall gives before it slides
    moves        x, way ↦ how far the body has gone at the contact's way: b is what is added in a step, so that a body may go
                 down and then along; None: its surface stays, or moves along its normal

    Raises `InputError` for a coefficient below 0 and a slip that is not above it. Source, with a penalty in place of the slip:
    Simo and Laursen 1992, 10.1016/0045-7949(92)90540-G.

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
        """Energy per reference area (J/m²)."""
        square = ngs.InnerProduct(g, g) / self.slip**2
        sticks, slides = square * (6 - square) / 8, _root(square) - 3 / 8
        return self.coefficient * self.slip * pressure * ngs.IfPos(square - 1, slides, sticks)

    def elastic(self, g: CoefficientFunction, pressure: CoefficientFunction) -> CoefficientFunction:
        """What of g comes back (m)."""
        square = ngs.InnerProduct(g, g) / self.slip**2
        return ngs.IfPos(pressure, ngs.IfPos(square - 1, 1 / _root(square), 1), 0) * g


class Grip(Term):
    """The frictions of a problem in its present time step. Pressures and normals are those of the unknowns that stand.

    layout     what the unknowns are
    gfu        where they stand
    frictions  what rubs, if anything

    Attributes: `form`, the energies alone; `rubs`, each friction with its fields; `start`, where the step began.
    """

    def __init__(
        self, layout: Layout, gfu: ngs.GridFunction, frictions: Sequence[Friction], kinematics: SolidKinematics
    ) -> None:
        self.layout, self.frictions, self._gfu = layout, frictions, gfu
        self.form = ngs.BilinearForm(gfu.space, symmetric=True)
        self.rubs: list[Rub] = []
        self.slips: list[np.ndarray] = []
        if frictions:
            self.start, self._vec = ngs.GridFunction(gfu.space), gfu.vec.CreateVector()
            start = layout.fields(self.start).u
            self.rubs = [Rub(friction, layout.fields(gfu), start, kinematics) for friction in frictions]
            self.join(self.form)
        self.finish()

    def join(self, form: ngs.BilinearForm) -> None:
        """Add the energies to a form of the problem's."""
        for rub in self.rubs:
            rub.join(form, self.layout)

    def join_driving(self, felt: ngs.BilinearForm, stiffness: ngs.BilinearForm, way: ngs.Parameter) -> None:
        """Add the energies' first and second derivative by a way of contacts to forms of the problem's."""
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


class Slipping:
    """A wall that rubs, as expressions of where it is, where the step began and with what elastic slip.

    u, offset  displacement and offset of the contact
    start      displacement at the start of the step
    slip       elastic slip there
    before     way of the rigid body at the start (m)
    way        its way since then (m), a variable

    Attributes: `gone`, how far along the body; `traction` τ (Pa) and `elastic`, the slip that comes back; `moves`, how far the
    body goes per metre of its way.
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
        """What of a vector is along the body's surface."""
        n = self._normal
        return v - ngs.InnerProduct(n, v) / (ngs.InnerProduct(n, n) + TINY) * n

    def _gone(self, u: CoefficientFunction) -> CoefficientFunction:
        return u - self._start - self._moved


class Rub:
    """One friction: its fields on the wall.

    slip, before  e and τ at the start of the step, at the points of the wall's quadrature; start: the contact's way there
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
        self.now = Slipping(friction, u, now.offset, start, self.slip, self.start, self.way_gone)
        self._elastic, self._traction = self.now.elastic.Compile(), self.now.traction.Compile()
        self.work = (ngs.InnerProduct(self.now.traction + self.before, self.now.gone) / 2).Compile()
        self.driving = (-ngs.InnerProduct(self.now.traction, self.now.moves)).Compile()

    @property
    def way(self) -> float:
        """Of the contact, now (m)."""
        way = self.friction.contact.way
        return 0.0 if way is None else float(way.Get())

    def join(self, form: ngs.BilinearForm, layout: Layout) -> None:
        """Add the energy to a form of the problem's."""
        form += ngs.Variation((self.weight * self._energy(form.space, layout)).Compile() * self.measure)

    def join_driving(self, felt: ngs.BilinearForm, stiffness: ngs.BilinearForm, layout: Layout) -> None:
        """Add the energy's first and second derivative by the contact's way to forms of the problem's."""
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
