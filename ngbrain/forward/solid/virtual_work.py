"""Virtual work of a body as a functional of its state, differentiated symbolically to any order.

    R(u)[v] = d/ds E(u + s v) at s = 0 ,    R'(u)[v, a] = d/dr R(u + r a)[v] at r = 0 , …

Fields are perturbed by numbers s, r, …, and the energy is differentiated with respect to these: the expressions of a law stay
unchanged, and a shared subexpression is differentiated once. With fields instead, the third derivative of Ogden's energy takes
144 000 operations at each point, with numbers 2 400.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.common.loads import CavityVolume, Load, LoadContext, PressureLoad
from ngbrain.forward.common.unknowns import Layout
from ngbrain.forward.contact.rigid import NO_OFFSET, RigidContact, SelfContact, SlidingSupport, WallContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials.base import Deformation

Array = np.ndarray
Motion: TypeAlias = Any
"""A GridFunction of a body's `fes`, or its trial or test functions."""
Integrand: TypeAlias = "Callable[[FieldState], ngs.comp.SumOfIntegrals]"


@dataclass(frozen=True)
class WorkIntegral:
    """An integral: integrand and measure.

    Parameters
    ----------
    coef : CoefficientFunction
        Integrand.
    over : DifferentialSymbol
        Measure, dx or ds.
    """

    coef: CoefficientFunction
    over: ngs.comp.DifferentialSymbol

    def derivative(self, variable: CoefficientFunction, direction: CoefficientFunction | None = None) -> WorkIntegral:
        """Derivative with respect to a number or a field.

        Parameters
        ----------
        variable : CoefficientFunction
        direction : CoefficientFunction, optional
            Direction, of a field.

        Returns
        -------
        WorkIntegral
        """
        slope = self.coef.Diff(variable) if direction is None else self.coef.Diff(variable, direction)
        return WorkIntegral(slope, self.over)

    def times(self, factor: CoefficientFunction | float) -> WorkIntegral:
        """A multiple."""
        return WorkIntegral(factor * self.coef, self.over)

    @property
    def vanishes(self) -> bool:
        """Whether a derivative is identically zero."""
        # Compiled: otherwise a shared part is printed once per use.
        return str(self.coef.Compile()).strip().endswith("Step 0: ZeroCF")

    @property
    def follows_trial(self) -> bool:
        """Whether it still contains trial functions, if only in a condition."""
        return "trial-function" in str(self.coef.Compile())

    @property
    def integral(self) -> ngs.comp.SumOfIntegrals:
        """The compiled integral, for forms: shared parts are evaluated once."""
        return self.coef.Compile() * self.over


Terms: TypeAlias = list[WorkIntegral]


def terms(integrals: ngs.comp.SumOfIntegrals) -> Terms:
    """The parts of a sum of integrals."""
    return [WorkIntegral(integrals[i].coef, integrals[i].symbol) for i in range(len(integrals))]


def derivatives(
    parts: Iterable[WorkIntegral], variable: CoefficientFunction, direction: CoefficientFunction | None = None
) -> Terms:
    """Derivatives of several integrals, without those that vanish.

    Parameters
    ----------
    parts : iterable of WorkIntegral
    variable : CoefficientFunction
    direction : CoefficientFunction, optional

    Returns
    -------
    list of WorkIntegral
    """
    return [slope for part in parts if not (slope := part.derivative(variable, direction)).vanishes]


LONE = Layout(pressure=False, offset=False, cavities=0)


@dataclass(frozen=True)
class FieldState(LoadContext):
    """State of a body at which functionals are evaluated, optionally perturbed by numbers.

    Parameters
    ----------
    mesh, kinematics, factor, u, v, order
        See `LoadContext`.
    grad : CoefficientFunction
        Displacement gradient; F is 3×3.
    along : CoefficientFunction
        Tangential gradient on boundaries.
    rest : sequence of CoefficientFunction
        Pressure, contact offset and cavity pressures, as far as present.
    layout : Layout
    """

    grad: CoefficientFunction = None
    along: CoefficientFunction = None
    rest: Sequence[CoefficientFunction] = ()
    layout: Layout = LONE

    @property
    def F(self) -> CoefficientFunction:  # noqa: N802
        """Deformation gradient, 3×3."""
        return self.kinematics.gradient(self.u, self.grad)

    @property
    def p(self) -> CoefficientFunction | None:
        """Pressure (Pa) of mixed forms."""
        return self.rest[0] if self.layout.pressure else None

    @property
    def cavities(self) -> Sequence[CoefficientFunction]:
        """Pressures (Pa) of the loads that prescribe a volume."""
        return self.rest[self.layout.pressure + self.layout.offset :]

    @property
    def offset(self) -> CoefficientFunction:
        """Of contacts (m)."""
        return self.rest[int(self.layout.pressure)] if self.layout.offset else NO_OFFSET

    def gradient(self, u: CoefficientFunction) -> CoefficientFunction:
        """Gradient of a displacement along a boundary."""
        return self.along if u is self.u else super().gradient(u)


class StateView:
    """States of a `Problem` for functionals, perturbed by numbers."""

    def __init__(self, body: Problem) -> None:
        self.body = body

    def functional(self, integrand: Integrand, state: Motion, *along: Motion) -> Terms:
        """A functional ∫ q of a state, differentiated along motions.

        Parameters
        ----------
        integrand : callable
            From a `FieldState` to integrals.
        state : Motion
        *along : Motion
            One derivative along each.

        Returns
        -------
        list of WorkIntegral
        """
        at, numbers = self.perturb_state(state, along)
        return differentiate(terms(integrand(at)), numbers)

    def perturb_state(self, state: Motion, motions: Sequence[Motion]) -> tuple[FieldState, list[ngs.Parameter]]:
        """State perturbed by numbers times motions.

        Parameters
        ----------
        state : Motion
        motions : sequence of Motion
            The first one is the test function `v`.

        Returns
        -------
        state : FieldState
        numbers : list of ngsolve.Parameter
            All zero.
        """
        body, numbers = self.body, [ngs.Parameter(0.0) for _ in motions]
        states = self.parts(state)
        moves = [self.parts(motion) for motion in motions]

        def moved(of: Callable[[Sequence[Any]], CoefficientFunction]) -> CoefficientFunction:
            total = of(states)
            for number, move in zip(numbers, moves, strict=True):
                total = total + number * of(move)
            return total

        at = FieldState(
            body.mesh,
            body.kinematics,
            body.factor,
            u=moved(lambda f: f[0]),
            v=moves[0][0] if moves else None,
            order=body.element.order,
            grad=moved(lambda f: ngs.Grad(f[0])),
            along=moved(lambda f: ngs.Grad(f[0]).Trace()),
            rest=[moved(lambda f, i=i: f[i]) for i in range(1, len(states))],  # type: ignore[misc]
            layout=body.layout,
        )
        return at, numbers

    def parts(self, motion: Motion) -> Sequence[Any]:
        """Displacement, pressure and cavities' pressures of a function of the body's space."""
        if self.body.u is self.body.gfu:
            return [motion]
        return motion.components if isinstance(motion, ngs.GridFunction) else motion


class VirtualWork(StateView):
    """Virtual work of a `Problem` with all its loads, or with some of them.

    Parameters
    ----------
    body : Problem
    loads, contacts : sequence, optional
        Those included; all by default.

    Raises
    ------
    InputError
        With friction, self-contact or inertia.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> body = Problem(block((0.1,) * 3, 0.1), {".*": Material(NeoHooke(1e3), 5e3)}, {"bottom": 0}, element="P1")
    >>> v = ngs.GridFunction(body.fes); v.Set((0, 0, ngs.z))
    >>> work = VirtualWork(body)
    >>> round(sum(ngs.Integrate(term.integral, body.mesh) for term in work(body.gfu, v, v)), 6)  # (4/3 μ + K) V
    6.333333
    """

    def __init__(
        self, body: Problem, loads: Sequence[Load] | None = None, contacts: Sequence[WallContact] | None = None
    ) -> None:
        super().__init__(body)
        self._loads = body.loads if loads is None else loads
        self._contacts = body.contacts if contacts is None else contacts
        if body.friction.frictions or any(isinstance(contact, SelfContact) for contact in body.contacts):
            raise InputError("contacts", "with friction or self-contact", "others, for derivatives of an equilibrium")
        if body.inertia is not None:
            raise InputError("loads", "with Inertia", "none, for derivatives of an equilibrium")

    def __call__(self, state: Motion, virtual: Motion, *along: Motion) -> Terms:
        """R(state)[virtual], or its derivative along further motions."""
        at, numbers = self.perturb_state(state, (virtual, *along))
        body = self.body
        energies = [
            WorkIntegral(
                at.kinematics.weight() * m.energy(Deformation.from_gradient(at.F), at.p, at.factor),
                ngs.dx(definedon=body.mesh.Materials(pattern), intrules=body.tissue.rules),
            )
            for pattern, m in body.materials.items()
        ]
        stored, followers = acting(body, at, self._loads, self._contacts)
        return differentiate(derivatives(energies + stored, numbers[0]) + followers, numbers[1:])


def acting(
    body: Problem, at: FieldState, loads: Sequence[Load], contacts: Sequence[WallContact]
) -> tuple[Terms, Terms]:
    """Energies of loads and contacts of a body, and virtual work of loads without an energy; self-contact is left out.

    Parameters
    ----------
    body : Problem
    at : FieldState
    loads, contacts : sequence
        Those that count.

    Returns
    -------
    energies, works : list of WorkIntegral
    """
    energies, followers = list[WorkIntegral](), list[WorkIntegral]()
    weight, mine = at.kinematics.weight(), {id(load) for load in loads}
    for contact in contacts:
        if isinstance(contact, RigidContact):
            energies.append(WorkIntegral(weight * contact.energy(at.u, at.offset), contact.measure()))
        elif isinstance(contact, SlidingSupport):
            energies.append(WorkIntegral(weight * contact.energy(at.u), contact.measure(body.element.order)))
    cavities = iter(at.cavities)
    for load in body.loads:
        pressure = (next(cavities),) if isinstance(load, CavityVolume) else ()
        if id(load) not in mine:
            continue
        if isinstance(load, PressureLoad):
            followers += terms(load.work(at))
        else:
            energies += terms(load.energy(at, *pressure))
    return energies, followers


def differentiate(parts: Terms, numbers: Sequence[ngs.Parameter]) -> Terms:
    """Derivatives with respect to numbers, one after the other.

    Parameters
    ----------
    parts : list of WorkIntegral
    numbers : sequence of ngsolve.Parameter

    Returns
    -------
    list of WorkIntegral
    """
    for number in numbers:
        parts = derivatives(parts, number)
    return parts


def vector(space: ngs.FESpace, parts: Terms) -> Callable[[], Array]:
    """Assembler of the linear form of integrals with test functions.

    Parameters
    ----------
    space : FESpace
    parts : list of WorkIntegral

    Returns
    -------
    callable
        Gives the vector (ndof,).
    """
    form = ngs.LinearForm(space)
    for part in parts:
        form += part.integral

    def assembled() -> Array:
        if not parts:
            return np.zeros(space.ndof)
        form.Assemble()
        return np.array(form.vec.FV().NumPy())

    return assembled


def slope(body: Problem, parts: Terms) -> Callable[[], Array]:
    """Assembler of the derivative, at a body's state, of integrals with its trial functions.

    Parameters
    ----------
    body : Problem
    parts : list of WorkIntegral

    Returns
    -------
    callable
        Gives the vector (ndof,).
    """
    form = ngs.BilinearForm(body.fes)
    for part in parts:
        form += ngs.Variation(part.integral)
    found = body.gfu.vec.CreateVector()

    def applied() -> Array:
        form.Apply(body.gfu.vec, found)
        return np.array(found.FV().NumPy())

    return applied
