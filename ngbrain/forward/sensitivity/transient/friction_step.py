"""Friction in one time step: derivatives with respect to start, initial slip and end.

With the displacement y, the elastic slip e and a tool's displacement r at the start of a step to x, the traction τ(x, y, e, r; θ)
and the new slip e⁺ = E(x, y, e, r; θ), an adjoint needs derivatives with respect to x, y, e, r and θ of one integral, with a
motion λ of the wall, σ of a tool, and weights M,

    ℓ = ∫ τ · (λ_t - σ b') + M · E dA .

λ_t is the tangential part of λ and b' the tool's tangential displacement per metre of its path. Newton's method keeps pressure and
normal fixed in friction's tangent, which is then symmetric; here they change with x too, and the tangent is not symmetric. Second
derivatives are those of ℓ', the derivative of ℓ along a direction of all of these, symbolic.
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
        With respect to the step's end and start.
    by_carried : array (size,)
        With respect to the internal variables at the start.
    by_theta : array (θ,)
        With respect to the parameters.
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
        self._motion, self._end_change, self._start_change = (ngs.GridFunction(body.fes) for _ in range(3))
        self._x, self._y, self._s = (ngs.Parameter(0.0) for _ in range(3))
        self._tool_motion, self._tool_change = ngs.Parameter(0.0), ngs.Parameter(0.0)
        self._walls = [_WallFields(fields) for fields in body.friction.walls]
        sizes = [len(unknowns(wall.weight)) for wall in self._walls]
        self._ends, self.size = np.cumsum(sizes)[:-1], int(sum(sizes))

    @property
    def _travel(self) -> ngs.Parameter | None:
        return None if self.body.tool is None else self.body.tool.prescribed.parameter

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
        self._set_adjoint(adjoint, weights)
        by_slip = np.concatenate(
            [wall.at_points(density) for wall, density in zip(self._walls, self._by_slip, strict=True)]
        )
        by_start = self._with_travel(self._by_start, lambda: self._by_before())
        return by_start, by_slip, np.concatenate([part() for part in self._by_theta])

    def carried_state_gradient(self, weights: Array) -> Array:
        """∂(∫ M · E dA)/∂x (n,)."""
        self._set_adjoint(np.zeros(self._n), weights)
        return self._with_travel(self._by_end, lambda: self._by_travel())

    def _set_adjoint(self, adjoint: Array, weights: Array) -> None:
        unknowns(self._motion)[:] = adjoint[: self._n]
        self._tool_motion.Set(float(adjoint[self._n]) if len(adjoint) > self._n else 0.0)
        for wall, part in zip(self._walls, np.split(weights, self._ends), strict=True):
            unknowns(wall.weight)[:] = part

    def _with_travel(self, of_space: Callable[[], Array], of_travel: Callable[[], Array]) -> Array:
        """Gradient with respect to the space's unknowns and, with a tool, its displacement."""
        return of_space() if self._travel is None else np.append(of_space(), of_travel())

    @cached_property
    def _by_start(self) -> Callable[[], Array]:
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, derivatives(self._work([StepPerturbation(self._y, start=test)]), self._y))

    @cached_property
    def _by_before(self) -> Callable[[], Array]:
        return self._number(derivatives(self._work([StepPerturbation(self._y, before=1.0)]), self._y))

    @cached_property
    def _by_end(self) -> Callable[[], Array]:
        """Gradient of the slips alone, with λ = 0."""
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, derivatives(self._weighted_slip([StepPerturbation(self._x, end=test)]), self._x))

    @cached_property
    def _by_travel(self) -> Callable[[], Array]:
        return self._number(derivatives(self._weighted_slip(), self._travel))

    @cached_property
    def _by_slip(self) -> list[ngs.CoefficientFunction]:
        return [
            self._density(wall, self._friction_at(wall, slip=wall.slip)).Diff(wall.slip).Compile()
            for wall in self._walls
        ]

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
        return self._with_travel(self._residual_change, lambda: self._tool_force_change())

    def carried_derivative(self, end: Array) -> Array:
        """Derivative of E along a change of the end, with the last `residual_derivative`."""
        self._set_end_direction(end)
        return np.concatenate(
            [wall.at_points(change) for wall, change in zip(self._walls, self._slip_change, strict=True)]
        )

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
        unknowns(self._start_change)[:] = start[: self._n]
        self._tool_change.Set(float(start[self._n]) if self._travel is not None else 0.0)
        for wall, change in zip(self._walls, np.split(slips, self._ends), strict=True):
            unknowns(wall.change)[:] = change
        for part, change in zip(self._parts, theta, strict=False):
            part.set_direction(change)
        self._set_end_direction(np.zeros(len(start)) if end is None else end)

    def _set_end_direction(self, end: Array) -> None:
        unknowns(self._end_change)[:] = end[: self._n]
        if self._travel is not None:
            self._parts[-1].set_direction(end[self._n :])

    def _perturbation(self, number: ngs.Parameter, end: bool = False) -> StepPerturbation:
        """Perturbation along the direction that was set."""
        return StepPerturbation(number, self._end_change if end else None, self._start_change, True, self._tool_change)

    @cached_property
    def _residual_change(self) -> Callable[[], Array]:
        test = self.body.fes.TestFunction()
        return vector(
            self.body.fes,
            self._directional_derivative(lambda *shifts: self._tractions(test, shifts), self._perturbation(self._y)),
        )

    @cached_property
    def _tool_force_change(self) -> Callable[[], Array]:
        return self._number(
            self._directional_derivative(lambda *shifts: self._tool_force(shifts), self._perturbation(self._y))
        )

    @cached_property
    def _slip_change(self) -> list[ngs.CoefficientFunction]:
        found = []
        for wall in self._walls:
            over = wall.fields.measure
            change = self._directional_derivative(
                lambda *shifts, wall=wall, over=over: [WorkIntegral(self._friction_at(wall, shifts).elastic, over)],
                self._perturbation(self._s, end=True),
            )
            found.append(sum((term.coef for term in change), 0 * wall.fields.slip).Compile())
        return found

    def _directional_derivative(self, of: Callable[..., Terms], shift: StepPerturbation) -> Terms:
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
        self._set_adjoint(adjoint, weights)
        by_slip = np.concatenate(
            [
                wall.at_points(density)
                for wall, density in zip(self._walls, self._second_derivatives_by_slip, strict=True)
            ]
        )
        end, start, before, travel, by_theta = self._second_derivatives
        return CarriedGradients(
            self._with_travel(end, travel),
            self._with_travel(start, before),
            by_slip,
            np.concatenate([part() for part in by_theta]),
        )

    @cached_property
    def _second_derivatives(self) -> tuple[Any, ...]:
        test, nothing = self.body.fes.TestFunction(), self._number([])
        direction = self._perturbation(self._s, end=True)

        def derivative(*more: StepPerturbation) -> Terms:
            return self._directional_derivative(lambda *shifts: self._work((*more, *shifts)), direction)

        end, start = StepPerturbation(self._x, end=test), StepPerturbation(self._y, start=test)
        still, parts = derivative(), self._parts
        return (
            vector(self.body.fes, derivatives(derivative(end), self._x)),
            vector(self.body.fes, derivatives(derivative(start), self._y)),
            self._number(derivatives(derivative(StepPerturbation(self._y, before=1.0)), self._y))
            if self._travel is not None
            else nothing,
            self._number(derivatives(still, self._travel)) if self._travel is not None else nothing,
            [part.gradient(still, self.body.mesh) for part in parts],
        )

    @cached_property
    def _second_derivatives_by_slip(self) -> list[ngs.CoefficientFunction]:
        direction, found = self._perturbation(self._s, end=True), []
        for wall in self._walls:
            over = wall.fields.measure
            derivative = self._directional_derivative(
                lambda *shifts, wall=wall, over=over: [
                    WorkIntegral(self._density(wall, self._friction_at(wall, shifts, wall.slip)), over)
                ],
                direction,
            )
            found.append(sum((term.coef.Diff(wall.slip) for term in derivative), 0 * wall.fields.slip).Compile())
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
        return vector(self.body.fes, derivatives(self._tractions(self.body.fes.TestFunction()), self._travel))

    @cached_property
    def tool_row(self) -> Callable[[], Array]:
        """Derivative of the tool force with respect to x (ndof,)."""
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, derivatives(self._tool_force([StepPerturbation(self._x, end=test)]), self._x))

    @cached_property
    def tool_stiffness(self) -> Callable[[], Array]:
        """Derivative of the tool force with respect to its displacement."""
        return self._number(derivatives(self._tool_force(), self._travel))

    # Expressions.

    def _friction_at(
        self, wall: _WallFields, shifts: Sequence[StepPerturbation] = (), slip: ngs.CoefficientFunction | None = None
    ) -> FrictionExpressions:
        """Friction at a perturbed state."""
        body, layout, of = self.body, self.body.layout, wall.fields
        u, offset, y = body.u, body.offset, layout.fields(body.friction.start).u
        slip, start, travel, moved = of.slip if slip is None else slip, 1.0 * of.start, of.travel_increment, False
        for shift in shifts:
            if shift.end is not None:
                moves = layout.fields(shift.end)
                u, offset = u + shift.number * moves.u, offset + shift.number * moves.offset
            if shift.start is not None:
                y = y + shift.number * layout.fields(shift.start).u
            if shift.slips:
                slip = slip + shift.number * wall.change
            if self._travel is not None and of.friction.contact.travel is self._travel:
                start, travel = start + shift.number * shift.before, travel - shift.number * shift.before
                moved = True
        return FrictionExpressions(of.friction, u, offset, y, slip, start, travel.MakeVariable() if moved else travel)

    def _density(self, wall: _WallFields, at: FrictionExpressions) -> ngs.CoefficientFunction:
        """Integrand of ℓ."""
        motion = at.tangential(self.body.layout.fields(self._motion).u)
        if self._moves_with_tool(wall):
            motion = motion - self._tool_motion * at.moves
        return ngs.InnerProduct(wall.weight, at.elastic) + ngs.InnerProduct(at.traction, motion)

    def _moves_with_tool(self, wall: _WallFields) -> bool:
        return self._travel is not None and wall.fields.friction.contact.travel is self._travel

    def _over(self, density: Callable[[_WallFields], ngs.CoefficientFunction]) -> Terms:
        weight = self.body.kinematics.weight()
        return [WorkIntegral(weight * density(wall), wall.fields.measure) for wall in self._walls]

    def _work(self, shifts: Sequence[StepPerturbation] = ()) -> Terms:
        """ℓ."""
        return self._over(lambda wall: self._density(wall, self._friction_at(wall, shifts)))

    def _weighted_slip(self, shifts: Sequence[StepPerturbation] = ()) -> Terms:
        """∫ M · E dA."""
        return self._over(lambda wall: ngs.InnerProduct(wall.weight, self._friction_at(wall, shifts).elastic))

    def _tractions(self, test: Motion, shifts: Sequence[StepPerturbation] = ()) -> Terms:
        """∫ τ · λ_t dA of a test function."""

        def density(wall: _WallFields) -> ngs.CoefficientFunction:
            at = self._friction_at(wall, shifts)
            return ngs.InnerProduct(at.traction, at.tangential(self.body.layout.fields(test).u))

        return self._over(density)

    def _tool_force(self, shifts: Sequence[StepPerturbation] = ()) -> Terms:
        """Force of friction on the tool: -∫ τ · b' dA."""

        def density(wall: _WallFields) -> ngs.CoefficientFunction:
            at = self._friction_at(wall, shifts)
            return -ngs.InnerProduct(at.traction, at.moves) if self._moves_with_tool(wall) else ngs.CF(0.0)

        return self._over(density)


class _WallFields:
    """Weights and change of one friction law's slip at the points of its wall; `slip` is the variable for derivatives."""

    def __init__(self, fields: FrictionFields) -> None:
        self.fields = fields
        self.weight, self.change, self._found = (ngs.GridFunction(fields.slip.space) for _ in range(3))
        self.slip = ngs.CF(tuple(fields.slip[i] for i in range(fields.slip.dim))).MakeVariable()

    def at_points(self, function: ngs.CoefficientFunction) -> Array:
        """Values of a vector, one component after the other."""
        self._found.Interpolate(function, definedon=self.fields.on)
        return unknowns(self._found).copy()
