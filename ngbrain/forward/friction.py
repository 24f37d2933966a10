"""Coulomb friction between a wall and a rigid body: one more boundary energy in every time step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from ngsolve.comp import IntegrationRuleSpaceSurface

from ngbrain.forward.contact import SURFACE_ORDER, Contact
from ngbrain.materials.base import checked, positive

TINY = 1e-12
"""Length (m) that keeps the derivative of a norm finite at zero."""

Moves = Callable[[CoefficientFunction], CoefficientFunction]
"""x ↦ how far (m) a rigid body's surface at x moves per metre of its way, a vector."""


@dataclass(frozen=True)
class Friction:
    """Coulomb friction in a `Contact`: the wall sticks to the body up to a traction μP, and slides with that.

    With the elastic slip e₀ and the displacement u₀ at the start of a time step, the body's own displacement b since then, and
    the contact's normal n = ∇φ,

        g = (1 - n⊗n)(e₀ + u - u₀ - b),   traction τ = k g min(1, ℓ/|g|),   ℓ = μP/k,

    per reference area, from the energy k |g|²/2 up to |g| = ℓ and k ℓ (|g| - ℓ/2) beyond. At the end of a step the elastic slip
    is τ/k, so that a wall which sticks has gone no further than ℓ however many steps there are, and comes back elastically. P and
    n are those of the end of the step too, but not varied: the tangent is symmetric and positive semi-definite, and misses
    only what the change of P changes in τ.

    contact      whose pressure P presses; it has to act on the same body
    coefficient  μ
    stiffness    k (Pa/m), of sticking
    moves        x ↦ b per metre of the contact's way; None: the body's surface stays, or moves along its normal

    Raises `InputError` for a coefficient below 0 and a stiffness that is not above it. Source: Simo and Laursen 1992,
    10.1016/0045-7949(92)90540-G.

    >>> plate = Contact("top", lambda x: 0.02 - x[2], 1e8, 1e-5)
    >>> Friction(plate, 0.1, 1e8).wall
    'top'
    """

    contact: Contact
    coefficient: float
    stiffness: float
    moves: Moves | None = None

    def __post_init__(self) -> None:
        checked(self.coefficient, "friction coefficient", lambda mu: mu >= 0, "a number of at least 0")
        positive(self.stiffness, "stiffness of friction")

    @property
    def wall(self) -> str:
        """The contact's."""
        return self.contact.wall

    def energy(self, g: CoefficientFunction, pressure: CoefficientFunction) -> CoefficientFunction:
        """Energy per reference area (J/m²)."""
        limit, size = self.coefficient * pressure / self.stiffness, _size(g)
        slides = limit * (size - limit / 2)
        return self.stiffness * ngs.IfPos(size - limit, slides, ngs.InnerProduct(g, g) / 2)

    def held(self, g: CoefficientFunction, pressure: CoefficientFunction) -> CoefficientFunction:
        """τ/k: what of g is elastic (m)."""
        limit, size = self.coefficient * pressure / self.stiffness, _size(g)
        return ngs.IfPos(size - limit, limit / size, 1) * g


class Grip:
    """The frictions of a body in its present time step.

    fes        the body's space: displacements, pressures, offsets
    frictions  what rubs, if anything

    `begin` a step, `hold` the state at which pressures and normals are taken, `finish` it. Attributes: `form`, the energies alone.
    """

    def __init__(self, fes: ngs.FESpace, frictions: Sequence[Friction]) -> None:
        self.frictions = frictions
        self.form = ngs.BilinearForm(fes, symmetric=True)
        if frictions:
            self._now, self._start = ngs.GridFunction(fes), ngs.GridFunction(fes)
            self._vec = self._now.vec.CreateVector()
            self._rubs = [_Rub(friction, self._now, self._start) for friction in frictions]
            self.join(self.form)
            self.slips = [rub.end() for rub in self._rubs]

    def join(self, form: ngs.BilinearForm) -> ngs.BilinearForm:
        """Add the energies to a form of the body's, and give it back."""
        u = form.space.TrialFunction()[0]
        for rub in self._rubs if self.frictions else ():
            form += ngs.Variation(rub.energy(u).Compile() * rub.measure)
        return form

    def begin(self, x: np.ndarray) -> None:
        """Begin a step at a state x, with the bodies where they are."""
        if self.frictions:
            self.frozen = {"start": x, "ways": [rub.way for rub in self._rubs], "slips": self.slips}

    def hold(self, x: ngs.BaseVector) -> None:
        """Take pressures and normals at a state."""
        if self.frictions:
            self._now.vec.data = x

    def finish(self) -> None:
        """End the step begun at the state held; forces can still be read."""
        if self.frictions:
            self.slips = [rub.end() for rub in self._rubs]

    def forces(self) -> np.ndarray | float:
        """Nodal forces at the state held, one for each unknown; 0 for all without friction."""
        if not self.frictions:
            return 0.0
        self.form.Apply(self._now.vec, self._vec)
        return self._vec.FV().NumPy().copy()

    def work(self) -> float:
        """What went into friction (J) from the start of the step to the state held, by the trapezoidal rule."""
        return sum(rub.integral(rub.work) for rub in self._rubs) if self.frictions else 0.0

    def driving(self) -> float:
        """∂(energy)/∂way (J/m) at the state held: what friction adds to `Contact.driving`."""
        return sum(rub.integral(rub.driving) for rub in self._rubs) if self.frictions else 0.0

    # Restart.

    @property
    def frozen(self) -> dict[str, Any]:
        """All that the energies of the present step are made of, but for the state held."""
        if not self.frictions:
            return {}
        slips = [_values(rub.slip).copy() for rub in self._rubs]
        return {"start": _values(self._start).copy(), "ways": [rub.start.Get() for rub in self._rubs], "slips": slips}

    @frozen.setter
    def frozen(self, saved: dict[str, Any]) -> None:
        if self.frictions:
            _values(self._start)[:] = saved["start"]
            for rub, way, slip in zip(self._rubs, saved["ways"], saved["slips"], strict=True):
                rub.start.Set(way)
                _values(rub.slip)[:] = slip

    @property
    def memory(self) -> dict[str, Any]:
        """All that decides the steps to come."""
        return {"slips": self.slips} if self.frictions else {}

    @memory.setter
    def memory(self, saved: dict[str, Any]) -> None:
        if self.frictions:
            self.slips = [np.array(slip) for slip in saved["slips"]]


class _Rub:
    """One friction: its fields on the wall.

    slip   e₀ at the points of the wall's quadrature; start: the contact's way when the step began
    """

    def __init__(self, friction: Friction, now: ngs.GridFunction, start: ngs.GridFunction) -> None:
        self.friction, contact = friction, friction.contact
        mesh = now.space.mesh
        self._on = mesh.Boundaries(friction.wall)
        # Its rule is the contact's: of the same order, at whose points fields on it can be read.
        points = IntegrationRuleSpaceSurface(mesh, order=SURFACE_ORDER // 2, definedon=self._on)
        self.measure = ngs.ds(friction.wall, intrules=points.GetIntegrationRules())
        self.slip, self._end = (ngs.GridFunction(ngs.VectorValued(points, 3)) for _ in range(2))
        self.start = ngs.Parameter(self.way)
        u, _, offset = now.components
        x = (ngs.CF((ngs.x, ngs.y, ngs.z)) + u).MakeVariable()
        self._normal = contact.distance(x).Diff(x)
        self._pressure, self._before = contact.pressure(u, offset), start.components[0]
        moves = friction.moves(x) if friction.moves else ngs.CF((0.0, 0.0, 0.0))
        self._moved = moves if contact.way is None else (contact.way - self.start) * moves
        held = friction.held(self._along(self._gone(u) + self.slip), self._pressure)
        self._held = held.Compile()
        k = friction.stiffness
        self.work = (k / 2 * ngs.InnerProduct(self._along(self._gone(u)), self.slip + held)).Compile()
        self.driving = (-k * ngs.InnerProduct(held, moves)).Compile()

    @property
    def way(self) -> float:
        """Of the contact, now (m)."""
        way = self.friction.contact.way
        return 0.0 if way is None else float(way.Get())

    def energy(self, u: CoefficientFunction) -> CoefficientFunction:
        """Energy per reference area (J/m²)."""
        return self.friction.energy(self._along(self._gone(u) + self.slip), self._pressure)

    def _gone(self, u: CoefficientFunction) -> CoefficientFunction:
        return u - self._before - self._moved

    def _along(self, v: CoefficientFunction) -> CoefficientFunction:
        n = self._normal
        return v - ngs.InnerProduct(n, v) / (ngs.InnerProduct(n, n) + TINY) * n

    def end(self) -> np.ndarray:
        """Elastic slip at the state held."""
        self._end.Interpolate(self._held, definedon=self._on)
        return _values(self._end).copy()

    def integral(self, value: CoefficientFunction) -> float:
        """Over the wall."""
        return float(ngs.Integrate(value * self.measure, self.slip.space.mesh))


def _size(v: CoefficientFunction) -> CoefficientFunction:
    return ngs.sqrt(ngs.InnerProduct(v, v) + TINY**2)


def _values(field: ngs.GridFunction) -> Any:
    return field.vec.FV().NumPy()
