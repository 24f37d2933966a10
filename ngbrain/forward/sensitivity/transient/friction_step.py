"""How friction's part of a time step changes with where the step begins, with the slip that it begins with, and with its end.

With the displacement y, the elastic slip e and the way r of a tool at the start of a step to x, the traction τ(x, y, e, r; θ) on
the wall and the slip e⁺ = E(x, y, e, r; θ), all that an adjoint needs is a derivative of one integral, with a motion λ of the
wall, σ of a tool's way, and weights M,

    ℓ = ∫ τ · (λ_t - σ b') + M · E dA ,

by x, y, e, r and θ; λ_t is what of λ is along the body's surface, b' how far that goes per metre of its way. Newton's method
takes pressure and normal as they are, its tangent is symmetric; here they change with x too, and the tangent does not stay so.
Second derivatives are those of ℓ' = dℓ along a way of all of them, by symbols.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import ngsolve as ngs
import numpy as np

from ngbrain.forward.contact.friction import Rub, Slipping
from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock
from ngbrain.forward.sensitivity.transient.quadrature_blocks import unknowns
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Terms, WorkIntegral, derivatives, vector

Array = np.ndarray


class CarriedGradients(NamedTuple):
    """By the step's end (n,), by its start (n,), by what was carried there (size,), and by θ."""

    by_end: Array
    by_start: Array
    by_carried: Array
    by_theta: Array


@dataclass(frozen=True)
class Shift:
    """A step's end and start, the slip and a tool's way there, moved along a change by a number that is zero."""

    number: ngs.Parameter
    end: Motion | None = None
    start: Motion | None = None
    slips: bool = False
    before: ngs.Parameter | float = 0.0


class FrictionStep:
    """Of all that rubs in a body, at the end of a step where it stands; parameters as `parts`, a tool's way the last of them.

    A change of slips is one array (points · dim,), one friction after the other; so are weights, as densities over the walls.
    Motions and changes of the unknowns have one number more with a tool of given force, that of its way.
    """

    in_reactions = False
    """What is seen of forces is the tissue's: a motion of it does not take part in friction."""

    def __init__(self, body: Problem, parts: Mapping[str, ParameterBlock]) -> None:
        self.body, self._parts, self._n = body, list(parts.values()), body.fes.ndof
        self._motion, self._moving, self._starting = (ngs.GridFunction(body.fes) for _ in range(3))
        self._x, self._y, self._s = (ngs.Parameter(0.0) for _ in range(3))
        self._push, self._before = ngs.Parameter(0.0), ngs.Parameter(0.0)
        self._rubs = [_Fields(rub) for rub in body.friction.rubs]
        sizes = [len(unknowns(rub.weight)) for rub in self._rubs]
        self._ends, self.size = np.cumsum(sizes)[:-1], int(sum(sizes))

    @property
    def _way(self) -> ngs.Parameter | None:
        return None if self.body.tool is None else self.body.tool.given.parameter

    # Backwards.

    def adjoint_gradients(self, adjoint: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Derivatives of ℓ by the step's start (n,), by e (a density) and by θ."""
        self._weigh(adjoint, weights)
        by_slip = np.concatenate(
            [rub.at_points(density) for rub, density in zip(self._rubs, self._by_slip, strict=True)]
        )
        by_start = self._with_way(self._by_start, lambda: self._by_before())
        return by_start, by_slip, np.concatenate([part() for part in self._by_theta])

    def carried_state_gradient(self, weights: Array) -> Array:
        """∂(∫ M · E dA)/∂x (n,)."""
        self._weigh(np.zeros(self._n), weights)
        return self._with_way(self._by_end, lambda: self._by_way())

    def _weigh(self, adjoint: Array, weights: Array) -> None:
        unknowns(self._motion)[:] = adjoint[: self._n]
        self._push.Set(float(adjoint[self._n]) if len(adjoint) > self._n else 0.0)
        for rub, part in zip(self._rubs, np.split(weights, self._ends), strict=True):
            unknowns(rub.weight)[:] = part

    def _with_way(self, of_space: Callable[[], Array], of_way: Callable[[], Array]) -> Array:
        """By unknowns in space, and by a tool's way if there is one."""
        return of_space() if self._way is None else np.append(of_space(), of_way())

    @cached_property
    def _by_start(self) -> Callable[[], Array]:
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, derivatives(self._work([Shift(self._y, start=test)]), self._y))

    @cached_property
    def _by_before(self) -> Callable[[], Array]:
        return self._number(derivatives(self._work([Shift(self._y, before=1.0)]), self._y))

    @cached_property
    def _by_end(self) -> Callable[[], Array]:
        """Of the slips alone: along a test function, with λ zero."""
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, derivatives(self._slipped([Shift(self._x, end=test)]), self._x))

    @cached_property
    def _by_way(self) -> Callable[[], Array]:
        return self._number(derivatives(self._slipped(), self._way))

    @cached_property
    def _by_slip(self) -> list[ngs.CoefficientFunction]:
        return [self._density(rub, self._slipping(rub, slip=rub.slip)).Diff(rub.slip).Compile() for rub in self._rubs]

    @cached_property
    def _by_theta(self) -> list[Callable[[], Array]]:
        return [part.gradient(self._work(), self.body.mesh) for part in self._parts]

    def _number(self, parts: Terms) -> Callable[[], Array]:
        integrals = [part.integral for part in parts]
        return lambda: np.array([sum(float(ngs.Integrate(part, self.body.mesh)) for part in integrals)], float)

    # Forwards.

    def residual_derivative(self, start: Array, slips: Array, theta: Sequence[Array]) -> Array:
        """How forces change with the step's start, e and θ (n,)."""
        self.set_direction(None, start, slips, theta)
        return self._with_way(self._changed, lambda: self._felt_changed())

    def carried_derivative(self, end: Array) -> Array:
        """How E changes with the step's end, and with what `residual_derivative` was last asked for."""
        self._go(end)
        return np.concatenate([rub.at_points(change) for rub, change in zip(self._rubs, self._moved, strict=True)])

    def set_direction(self, end: Array | None, start: Array, slips: Array, theta: Sequence[Array]) -> None:
        """Set a way of a step's end and start, of the slips there and of θ."""
        unknowns(self._starting)[:] = start[: self._n]
        self._before.Set(float(start[self._n]) if self._way is not None else 0.0)
        for rub, change in zip(self._rubs, np.split(slips, self._ends), strict=True):
            unknowns(rub.change)[:] = change
        for part, way in zip(self._parts, theta, strict=False):
            part.set_direction(way)
        self._go(np.zeros(len(start)) if end is None else end)

    def _go(self, end: Array) -> None:
        unknowns(self._moving)[:] = end[: self._n]
        if self._way is not None:
            self._parts[-1].set_direction(end[self._n :])

    def _begun(self, number: ngs.Parameter, end: bool = False) -> Shift:
        """Along what was aimed at."""
        return Shift(number, self._moving if end else None, self._starting, True, self._before)

    @cached_property
    def _changed(self) -> Callable[[], Array]:
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, self._turned(lambda *shifts: self._tractions(test, shifts), self._begun(self._y)))

    @cached_property
    def _felt_changed(self) -> Callable[[], Array]:
        return self._number(self._turned(lambda *shifts: self._driving(shifts), self._begun(self._y)))

    @cached_property
    def _moved(self) -> list[ngs.CoefficientFunction]:
        found = []
        for rub in self._rubs:
            over = rub.rub.measure
            change = self._turned(
                lambda *shifts, rub=rub, over=over: [WorkIntegral(self._slipping(rub, shifts).elastic, over)],
                self._begun(self._s, end=True),
            )
            found.append(sum((term.coef for term in change), 0 * rub.rub.slip).Compile())
        return found

    def _turned(self, of: Callable[..., Terms], shift: Shift) -> Terms:
        """The change of integrals along a shift and along the parameters' directions."""
        return derivatives(of(shift), shift.number) + [
            term for part in self._parts for term in part.directional_derivative(of())
        ]

    # Twice.

    def gradient_derivatives(self, adjoint: Array, weights: Array) -> CarriedGradients:
        """The derivatives of ℓ', with λ, σ and M, along what was aimed at."""
        self._weigh(adjoint, weights)
        by_slip = np.concatenate(
            [rub.at_points(density) for rub, density in zip(self._rubs, self._turned_by_slip, strict=True)]
        )
        end, start, before, way, by_theta = self._turned_slopes
        return CarriedGradients(
            self._with_way(end, way),
            self._with_way(start, before),
            by_slip,
            np.concatenate([part() for part in by_theta]),
        )

    @cached_property
    def _turned_slopes(self) -> tuple[Any, ...]:
        test, nothing = self.body.fes.TestFunction(), self._number([])
        aimed = self._begun(self._s, end=True)

        def bent(*more: Shift) -> Terms:
            return self._turned(lambda *shifts: self._work((*more, *shifts)), aimed)

        end, start = Shift(self._x, end=test), Shift(self._y, start=test)
        still, parts = bent(), self._parts
        return (
            vector(self.body.fes, derivatives(bent(end), self._x)),
            vector(self.body.fes, derivatives(bent(start), self._y)),
            self._number(derivatives(bent(Shift(self._y, before=1.0)), self._y)) if self._way is not None else nothing,
            self._number(derivatives(still, self._way)) if self._way is not None else nothing,
            [part.gradient(still, self.body.mesh) for part in parts],
        )

    @cached_property
    def _turned_by_slip(self) -> list[ngs.CoefficientFunction]:
        aimed, found = self._begun(self._s, end=True), []
        for rub in self._rubs:
            over = rub.rub.measure
            bent = self._turned(
                lambda *shifts, rub=rub, over=over: [
                    WorkIntegral(self._density(rub, self._slipping(rub, shifts, rub.slip)), over)
                ],
                aimed,
            )
            found.append(sum((term.coef.Diff(rub.slip) for term in bent), 0 * rub.rub.slip).Compile())
        return found

    # The tangent.

    def join_tangent(self, form: ngs.BilinearForm) -> None:
        """Add to a form how tractions change with x: pressures and normals with them."""
        trial, test = self.body.fes.TnT()
        for term in derivatives(self._tractions(test, [Shift(self._x, end=trial)]), self._x):
            form += term.integral

    @cached_property
    def tool_column(self) -> Callable[[], Array]:
        """How forces change with a tool's way (ndof,)."""
        return vector(self.body.fes, derivatives(self._tractions(self.body.fes.TestFunction()), self._way))

    @cached_property
    def tool_row(self) -> Callable[[], Array]:
        """How what a tool feels changes with x (ndof,)."""
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, derivatives(self._driving([Shift(self._x, end=test)]), self._x))

    @cached_property
    def tool_stiffness(self) -> Callable[[], Array]:
        """How what a tool feels changes with its way."""
        return self._number(derivatives(self._driving(), self._way))

    # Expressions.

    def _slipping(
        self, rub: _Fields, shifts: Sequence[Shift] = (), slip: ngs.CoefficientFunction | None = None
    ) -> Slipping:
        """A friction, moved."""
        body, layout, of = self.body, self.body.layout, rub.rub
        u, offset, y = body.u, body.offset, layout.fields(body.friction.start).u
        slip, start, way, moved = of.slip if slip is None else slip, 1.0 * of.start, of.way_gone, False
        for shift in shifts:
            if shift.end is not None:
                moves = layout.fields(shift.end)
                u, offset = u + shift.number * moves.u, offset + shift.number * moves.offset
            if shift.start is not None:
                y = y + shift.number * layout.fields(shift.start).u
            if shift.slips:
                slip = slip + shift.number * rub.change
            if self._way is not None and of.friction.contact.way is self._way:
                start, way, moved = start + shift.number * shift.before, way - shift.number * shift.before, True
        return Slipping(of.friction, u, offset, y, slip, start, way.MakeVariable() if moved else way)

    def _density(self, rub: _Fields, at: Slipping) -> ngs.CoefficientFunction:
        """Of ℓ."""
        pushed = at.tangential(self.body.layout.fields(self._motion).u)
        if self._drives(rub):
            pushed = pushed - self._push * at.moves
        return ngs.InnerProduct(rub.weight, at.elastic) + ngs.InnerProduct(at.traction, pushed)

    def _drives(self, rub: _Fields) -> bool:
        return self._way is not None and rub.rub.friction.contact.way is self._way

    def _over(self, density: Callable[[_Fields], ngs.CoefficientFunction]) -> Terms:
        weight = self.body.kinematics.weight()
        return [WorkIntegral(weight * density(rub), rub.rub.measure) for rub in self._rubs]

    def _work(self, shifts: Sequence[Shift] = ()) -> Terms:
        """ℓ."""
        return self._over(lambda rub: self._density(rub, self._slipping(rub, shifts)))

    def _slipped(self, shifts: Sequence[Shift] = ()) -> Terms:
        """∫ M · E dA."""
        return self._over(lambda rub: ngs.InnerProduct(rub.weight, self._slipping(rub, shifts).elastic))

    def _tractions(self, test: Motion, shifts: Sequence[Shift] = ()) -> Terms:
        """∫ τ · λ_t dA of a test function."""

        def density(rub: _Fields) -> ngs.CoefficientFunction:
            at = self._slipping(rub, shifts)
            return ngs.InnerProduct(at.traction, at.tangential(self.body.layout.fields(test).u))

        return self._over(density)

    def _driving(self, shifts: Sequence[Shift] = ()) -> Terms:
        """What a tool feels of it: -∫ τ · b' dA."""

        def density(rub: _Fields) -> ngs.CoefficientFunction:
            at = self._slipping(rub, shifts)
            return -ngs.InnerProduct(at.traction, at.moves) if self._drives(rub) else ngs.CF(0.0)

        return self._over(density)


class _Fields:
    """Weights and change of one friction's slip, at the points of its wall; `slip`, what derivatives by it are by."""

    def __init__(self, rub: Rub) -> None:
        self.rub = rub
        self.weight, self.change, self._found = (ngs.GridFunction(rub.slip.space) for _ in range(3))
        self.slip = ngs.CF(tuple(rub.slip[i] for i in range(rub.slip.dim))).MakeVariable()

    def at_points(self, function: ngs.CoefficientFunction) -> Array:
        """Values of a vector, one component after the other."""
        self._found.Interpolate(function, definedon=self.rub.on)
        return unknowns(self._found).copy()
