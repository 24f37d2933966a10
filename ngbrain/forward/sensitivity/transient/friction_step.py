"""Friction in one time step: derivatives with respect to start, initial slip and end.

With the displacement y, the elastic slip e and a tool's displacement r at the start of a step to x, the traction τ(x, y, e, r; θ)
and the new slip e⁺ = E(x, y, e, r; θ), an adjoint needs derivatives with respect to x, y, e, r and θ of one integral, with a
motion λ of the wall, σ of a tool, and weights M,

    ℓ = ∫ τ · (λ_t - σ b') + M · E dA .

λ_t is the tangential part of λ and b' the tool's tangential displacement per metre of its path. Newton's method keeps pressure and
normal fixed in friction's tangent, which is then symmetric; here they change with x too, and the tangent is not symmetric. Second
derivatives are those of ℓ', the derivative of ℓ along a direction of all of these, by symbols.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import ngsolve as ngs
import numpy as np

from ngbrain.forward.contact.friction import FrictionExpressions, FrictionFields
from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock
from ngbrain.forward.sensitivity.transient.quadrature_blocks import unknowns
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Terms, WorkIntegral, derivatives, vector

Array = np.ndarray


class CarriedGradients(NamedTuple):
    """Gradients of a step.

    Parameters
    ----------
    by_end, by_start : array (n,)
        By the step's end and start.
    by_carried : array (size,)
        By the variables carried from the step before.
    by_theta : array (θ,)
        By the parameters.
    """

    by_end: Array
    by_start: Array
    by_carried: Array
    by_theta: Array


@dataclass(frozen=True)
class StepPerturbation:
    """Perturbation of a step's end and start, of the slip and of a tool's displacement at the start.

    Parameters
    ----------
    number : Parameter
        The amplitude, zero.
    end, start : Motion, optional
        Changes of the state at end and start.
    slips : bool
        Whether slips change.
    before : Parameter or float
        Change of the tool's displacement at the start.
    """

    number: ngs.Parameter
    end: Motion | None = None
    start: Motion | None = None
    slips: bool = False
    before: ngs.Parameter | float = 0.0


class FrictionStep:
    """Derivatives of friction's part of a step, with the body at its end.

    Slips are one array (points · dim,), one friction law after the other; so are their weights, densities over the walls. With a
    force-controlled tool, states and motions have one more entry, the tool's displacement.

    Parameters
    ----------
    body : Problem
        Body with friction.
    parts : dict of str to ParameterBlock
        Blocks of θ, the tool's displacement last.
    """

    in_reactions = False
    """Whether reactions at supports include these forces."""

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
        """Gradients of ℓ with respect to the start, the slip and θ.

        Parameters
        ----------
        adjoint : array (n,)
            λ, and σ.
        weights : array (size,)
            M.

        Returns
        -------
        by_start : array (n,)
        by_slip : array (size,)
            A density.
        by_theta : array (θ,)
        """
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
        """Gradient with respect to the space's unknowns and, with a tool, its displacement."""
        return of_space() if self._way is None else np.append(of_space(), of_way())

    @cached_property
    def _by_start(self) -> Callable[[], Array]:
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, derivatives(self._work([StepPerturbation(self._y, start=test)]), self._y))

    @cached_property
    def _by_before(self) -> Callable[[], Array]:
        return self._number(derivatives(self._work([StepPerturbation(self._y, before=1.0)]), self._y))

    @cached_property
    def _by_end(self) -> Callable[[], Array]:
        """Of the slips alone: along a test function, with λ = 0."""
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, derivatives(self._slipped([StepPerturbation(self._x, end=test)]), self._x))

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
        """Derivative of the forces along changes of start, slip and θ.

        Parameters
        ----------
        start : array (n,)
            Change of the step's start.
        slips : array (size,)
            Change of the slip.
        theta : sequence of array
            Change of each parameter.

        Returns
        -------
        array (n,)
        """
        self.set_direction(None, start, slips, theta)
        return self._with_way(self._changed, lambda: self._felt_changed())

    def carried_derivative(self, end: Array) -> Array:
        """Derivative of E along a change of the end, with the last `residual_derivative`."""
        self._go(end)
        return np.concatenate([rub.at_points(change) for rub, change in zip(self._rubs, self._moved, strict=True)])

    def set_direction(self, end: Array | None, start: Array, slips: Array, theta: Sequence[Array]) -> None:
        """Set a direction.

        Parameters
        ----------
        end : array (n,) or None
            Change of the step's end; None: zero.
        start : array (n,)
            Change of its start.
        slips : array (size,)
            Change of the slip.
        theta : sequence of array
            Change of each parameter.
        """
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

    def _begun(self, number: ngs.Parameter, end: bool = False) -> StepPerturbation:
        """Perturbation along the direction that was set."""
        return StepPerturbation(number, self._moving if end else None, self._starting, True, self._before)

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

    def _turned(self, of: Callable[..., Terms], shift: StepPerturbation) -> Terms:
        """Derivative of integrals along a perturbation and along the direction of the parameters."""
        return derivatives(of(shift), shift.number) + [
            term for part in self._parts for term in part.directional_derivative(of())
        ]

    # Second derivatives.

    def gradient_derivatives(self, adjoint: Array, weights: Array) -> CarriedGradients:
        """Gradients of ℓ' along the direction that was set.

        Parameters
        ----------
        adjoint : array (n,)
            λ, and σ.
        weights : array (size,)
            M.

        Returns
        -------
        CarriedGradients
        """
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

        def bent(*more: StepPerturbation) -> Terms:
            return self._turned(lambda *shifts: self._work((*more, *shifts)), aimed)

        end, start = StepPerturbation(self._x, end=test), StepPerturbation(self._y, start=test)
        still, parts = bent(), self._parts
        return (
            vector(self.body.fes, derivatives(bent(end), self._x)),
            vector(self.body.fes, derivatives(bent(start), self._y)),
            self._number(derivatives(bent(StepPerturbation(self._y, before=1.0)), self._y))
            if self._way is not None
            else nothing,
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
        """Add the consistent tangent of friction, with changing pressure and normal, to a form."""
        trial, test = self.body.fes.TnT()
        for term in derivatives(self._tractions(test, [StepPerturbation(self._x, end=trial)]), self._x):
            form += term.integral

    @cached_property
    def tool_column(self) -> Callable[[], Array]:
        """Derivative of the forces with respect to the tool's displacement (ndof,)."""
        return vector(self.body.fes, derivatives(self._tractions(self.body.fes.TestFunction()), self._way))

    @cached_property
    def tool_row(self) -> Callable[[], Array]:
        """Derivative of the tool force with respect to x (ndof,)."""
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, derivatives(self._driving([StepPerturbation(self._x, end=test)]), self._x))

    @cached_property
    def tool_stiffness(self) -> Callable[[], Array]:
        """Derivative of the tool force with respect to its displacement."""
        return self._number(derivatives(self._driving(), self._way))

    # Expressions.

    def _slipping(
        self, rub: _Fields, shifts: Sequence[StepPerturbation] = (), slip: ngs.CoefficientFunction | None = None
    ) -> FrictionExpressions:
        """Friction at a perturbed state."""
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
        return FrictionExpressions(of.friction, u, offset, y, slip, start, way.MakeVariable() if moved else way)

    def _density(self, rub: _Fields, at: FrictionExpressions) -> ngs.CoefficientFunction:
        """Integrand of ℓ."""
        pushed = at.tangential(self.body.layout.fields(self._motion).u)
        if self._drives(rub):
            pushed = pushed - self._push * at.moves
        return ngs.InnerProduct(rub.weight, at.elastic) + ngs.InnerProduct(at.traction, pushed)

    def _drives(self, rub: _Fields) -> bool:
        return self._way is not None and rub.rub.friction.contact.way is self._way

    def _over(self, density: Callable[[_Fields], ngs.CoefficientFunction]) -> Terms:
        weight = self.body.kinematics.weight()
        return [WorkIntegral(weight * density(rub), rub.rub.measure) for rub in self._rubs]

    def _work(self, shifts: Sequence[StepPerturbation] = ()) -> Terms:
        """ℓ."""
        return self._over(lambda rub: self._density(rub, self._slipping(rub, shifts)))

    def _slipped(self, shifts: Sequence[StepPerturbation] = ()) -> Terms:
        """∫ M · E dA."""
        return self._over(lambda rub: ngs.InnerProduct(rub.weight, self._slipping(rub, shifts).elastic))

    def _tractions(self, test: Motion, shifts: Sequence[StepPerturbation] = ()) -> Terms:
        """∫ τ · λ_t dA of a test function."""

        def density(rub: _Fields) -> ngs.CoefficientFunction:
            at = self._slipping(rub, shifts)
            return ngs.InnerProduct(at.traction, at.tangential(self.body.layout.fields(test).u))

        return self._over(density)

    def _driving(self, shifts: Sequence[StepPerturbation] = ()) -> Terms:
        """Force of friction on the tool: -∫ τ · b' dA."""

        def density(rub: _Fields) -> ngs.CoefficientFunction:
            at = self._slipping(rub, shifts)
            return -ngs.InnerProduct(at.traction, at.moves) if self._drives(rub) else ngs.CF(0.0)

        return self._over(density)


class _Fields:
    """Weights and change of one friction law's slip at the points of its wall; `slip` is the variable for derivatives."""

    def __init__(self, rub: FrictionFields) -> None:
        self.rub = rub
        self.weight, self.change, self._found = (ngs.GridFunction(rub.slip.space) for _ in range(3))
        self.slip = ngs.CF(tuple(rub.slip[i] for i in range(rub.slip.dim))).MakeVariable()

    def at_points(self, function: ngs.CoefficientFunction) -> Array:
        """Values of a vector, one component after the other."""
        self._found.Interpolate(function, definedon=self.rub.on)
        return unknowns(self._found).copy()
