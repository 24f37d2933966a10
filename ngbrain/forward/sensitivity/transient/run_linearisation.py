"""A run at one θ, and products with its first and second derivatives; see `run_model`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ngbrain.errors import ConvergenceError, InputError, check_shape
from ngbrain.forward.sensitivity.parameter_blocks import PrescribedDisplacement
from ngbrain.forward.sensitivity.transient.replay import ReplayStep
from ngbrain.forward.sensitivity.transient.tangents import FINE_RTOL, RTOL
from ngbrain.forward.solid.tangent import Solve
from ngbrain.look import BriefText

if TYPE_CHECKING:
    from ngbrain.forward.sensitivity.transient.run_model import RunModel

Array = np.ndarray
TOGETHER = 40
"""Length of θ up to which the columns of J are computed together, with one factorisation a step."""


@dataclass(repr=False)
class CarriedState(BriefText):
    """What a step passes on to the next one: changes of it (tangent), or the gradient with respect to it (adjoint).

    Parameters
    ----------
    end : array (n,)
        Degrees of freedom.
    history : array (size, points)
        Internal variables of the tissue.
    carried : list of array
        Internal variables of friction and inertia.
    """

    end: Array
    history: Array
    carried: list[Array]

    @classmethod
    def zeros(cls, model: RunModel) -> CarriedState:
        """Zero: before the first step, or after the last one."""
        history = np.zeros((model.forms.size, len(model.forms.quadrature)))
        return cls(np.zeros(model.n), history, [np.zeros(each.size) for each in model.carried])


class RunLinearisation:
    """The run at one θ: `data` (times, numbers), and products with its derivatives. Valid until the model is evaluated again."""

    def __init__(self, model: RunModel) -> None:
        self.model = model
        self.data = np.zeros((len(model.times), model.observables.size))

        def record(step: ReplayStep) -> None:
            if step.n in model.row:
                self.data[model.row[step.n]] = model.observables.value()

        try:
            with np.errstate(divide="raise", over="raise", invalid="raise"):
                model.replay.run(record)
        except FloatingPointError as error:
            raise ConvergenceError(f"the run failed at these parameters: {error}") from error

    def jvp(self, direction: Array) -> Array:
        """Jacobian-vector product J δθ, with the shape of `data`."""
        if self.model.size > TOGETHER:
            return self._products(direction[None])[0]
        return np.tensordot(direction, self.jacobian, 1)

    def vjp(self, w: Array) -> Array:
        """Vector-Jacobian product Jᵀ w, by the columns of J where θ is short."""
        return self.gradient(w) if self.model.size > TOGETHER else np.asarray(np.tensordot(self.jacobian, w, 2))

    @cached_property
    def jacobian(self) -> Array:
        """J (θ, times, numbers)."""
        return self._products(np.eye(self.model.size))

    def gradient(self, w: Array) -> Array:
        """Jᵀ w by one adjoint solve a step, or from J where that is known."""
        check_shape("w", np.shape(w), self.data.shape)
        if "jacobian" in vars(self):
            return np.asarray(np.tensordot(self.jacobian, w, 2))
        return np.asarray(self.gradients([w])[0])

    def gradients(self, weights: Sequence[Array]) -> Array:
        """Jᵀ w for several w (number, size), with one factorisation a step for all of them."""
        for w in weights:
            check_shape("w", np.shape(w), self.data.shape)
        later = [CarriedState.zeros(self.model) for _ in weights]
        total = np.zeros((len(weights), self.model.size))
        for step in self.model.replay.backwards():
            self._prepare(step, len(weights))
            for i, w in enumerate(weights):
                adjoint, motion, shown = self._adjoint(step, w, later[i])
                later[i], by_theta = self._previous_state_gradient(step, adjoint, motion, later[i])
                total[i] += by_theta + shown
        return total

    def hvp(self, w: Array, direction: Array) -> Array:
        """Product of the second derivative of w · data with a direction.

        With w the derivative of a misfit, it is what the misfit's Hessian has beside the Gauss-Newton matrix.

        Parameters
        ----------
        w : array (times, numbers)
            Weights of the data.
        direction : array (size,)
            δθ.

        Returns
        -------
        array (size,)
            (w · data)'' δθ.

        Raises
        ------
        InputError
            For self-contact and for node positions.
        """
        for name in self.model.shapes:
            raise InputError(f"parameters.{name}", "of type NodePositions", "one with second derivatives")
        check_shape("w", np.shape(w), self.data.shape)
        model, second_derivatives = self.model, self.model.curvature
        total, later, hessian_state, n = (
            np.zeros(model.size),
            CarriedState.zeros(model),
            CarriedState.zeros(model),
            model.body.fes.ndof,
        )
        for step, x, before in self._changes_backwards(direction):
            self._prepare(step, 1, FINE_RTOL)
            adjoint, motion, _ = self._adjoint(step, w, later)
            theta = model.split(direction) | ({} if len(x) == n else {model.tool_block: x[n:]})
            model.observables.set_weights(self._data_weights(step, w))
            second_derivatives.set_direction(x, before.history, theta)
            second = second_derivatives(adjoint, (adjoint + motion)[:n], later.history)
            forces, slopes = np.append(second.by_state, second.by_theta[model.size :]), second.by_theta[: model.size]
            second_state = CarriedState(np.zeros(model.n), second.by_history, [])
            for each, carried, weights in zip(model.carried, before.carried, later.carried, strict=True):
                each.set_direction(x, before.end, carried, list(theta.values()))
                of = each.gradient_derivatives(adjoint + motion if each.in_reactions else adjoint, weights)
                forces, slopes = forces + of.by_end, slopes + of.by_theta[: model.size]
                second_state.end += of.by_start
                second_state.carried.append(of.by_carried)
            b = forces + self._carried_gradient(hessian_state)
            change = -model.tangents.solve_transpose(b)
            total += self._prescribed_gradient(step, b, change)
            hessian_state, hessian_theta = self._previous_state_gradient(step, change, np.zeros(model.n), hessian_state)
            hessian_state.end, hessian_state.history = (
                hessian_state.end + second_state.end,
                hessian_state.history + second_state.history,
            )
            hessian_state.carried = [a + b for a, b in zip(hessian_state.carried, second_state.carried, strict=True)]
            later, _ = self._previous_state_gradient(step, adjoint, motion, later)
            total += slopes + hessian_theta
        return total

    def _adjoint(self, step: ReplayStep, w: Array, later: CarriedState) -> tuple[Array, Array, Array]:
        """λ and Zᵀw of a step, after `_prepare`, and the gradient of the observables at its end, without the tissue's forces."""
        model = self.model
        row, shown = self._data_weights(step, w), np.zeros(model.size)
        b, motion = self._carried_gradient(later), np.zeros(model.n)
        if row.any():
            n, by_theta = model.body.fes.ndof, model.observables.parameter_gradient(row)
            b[:n] += model.observables.state_gradient(row, model.tangents.apply)
            shown, b[n:], motion[:n] = (
                by_theta[: model.size],
                b[n:] + by_theta[model.size :],
                model.observables.motions.T @ row,
            )
        adjoint = -model.tangents.solve_transpose(b)
        return adjoint, motion, shown + self._prescribed_gradient(step, b, adjoint)

    def _prescribed_gradient(self, step: ReplayStep, b: Array, adjoint: Array) -> Array:
        """Gradient with respect to prescribed displacements: the adjoint's residual there (size,)."""
        found = np.zeros(self.model.size)
        if self.model.prescribed_blocks:
            left = self.model.replay.load_factor(step) * (b + self.model.tangents.multiply_transpose(adjoint))
            for part, where in self.model.prescribed_blocks:
                found[where] = left[part.dofs]
        return found

    def _carried_gradient(self, later: CarriedState) -> Array:
        """Gradient of later data with respect to the end of a step."""
        model, found = self.model, later.end.copy()
        found[: model.body.fes.ndof] += model.forms.history_state_gradient(later.history)
        return found + sum(
            (each.carried_state_gradient(of) for each, of in zip(model.carried, later.carried, strict=True)), 0.0
        )

    def _previous_state_gradient(
        self, step: ReplayStep, adjoint: Array, motion: Array, later: CarriedState
    ) -> tuple[CarriedState, Array]:
        """Gradient of later data with respect to the start of a step, and with respect to θ."""
        model, n = self.model, self.model.body.fes.ndof
        moved = (adjoint + motion)[:n]
        shifts = {name: shapes.adjoint_gradient(moved, later.history) for name, shapes in model.shapes.items()}
        history, slopes = model.forms.adjoint_gradients(moved, later.history)
        slopes |= shifts | {
            name: part.value * 0 for name, part in model.parts.items() if isinstance(part, PrescribedDisplacement)
        }
        model.contacts.set_adjoint(adjoint)
        total = (
            np.concatenate([slopes[name] for name in model.parts]) + model.contacts.parameter_gradient()[: model.size]
        )
        before = CarriedState(np.zeros(model.n), history, [])
        for each, weights in zip(model.carried, later.carried, strict=True):
            by_start, carried, by_theta = each.adjoint_gradients(
                adjoint + motion if each.in_reactions else adjoint, weights
            )
            before.end, total = before.end + by_start, total + by_theta[: model.size]
            before.carried.append(carried)
        return before, total - sum(adjoint[n:]) * model.prescribed_force_gradient(step)

    def _data_weights(self, step: ReplayStep, w: Array) -> Array:
        """Weights of the data at the end of a step."""
        return np.asarray(w[self.model.row[step.n]] if step.n in self.model.row else np.zeros(w.shape[1]))

    def _changes_backwards(self, direction: Array) -> Iterator[tuple[ReplayStep, Array, CarriedState]]:
        """From the last step to the first: changes of its end and of its start, along a direction of θ.

        Changes of histories are stored at the checkpoints only, all others at every step.
        """
        model, replay, forms = self.model, self.model.replay, self.model.forms
        before, theta, kept, changes = (
            CarriedState.zeros(model),
            model.split(direction),
            dict[int, Array](),
            list[CarriedState](),
        )
        history = before.history
        for step in replay.forwards():
            if step.n % replay.every == 0:
                kept[step.n] = before.history
            before, _ = self._state_change(
                step, self._prepare(step, 1, FINE_RTOL), self._columns(step), direction, before
            )
            changes.append(CarriedState(before.end, np.empty(0), before.carried))
        at_rest = CarriedState.zeros(model)
        for steps in replay.segments():
            histories = [kept[steps[0].n]]
            for step in map(replay.restore, steps[:-1]):
                self._set(step)
                forms.set_direction(histories[-1], theta)
                histories.append(forms.history_derivative(changes[step.n].end[: model.body.fes.ndof]))
            for step, history in zip(map(replay.restore, reversed(steps)), reversed(histories), strict=True):
                last = changes[step.n - 1] if step.n else at_rest
                yield step, changes[step.n].end, CarriedState(last.end, history, last.carried)

    def _products(self, directions: Array) -> Array:
        """J times several directions, with one factorisation a step."""
        model, n = self.model, self.model.body.fes.ndof
        data = np.zeros((len(directions), *self.data.shape))
        before = [CarriedState.zeros(model) for _ in directions]
        for step in model.replay.forwards():
            solve, columns = self._prepare(step, len(directions)), self._columns(step)
            row = model.row.get(step.n)
            by_state, by_theta = model.observables.rows(model.tangents.apply) if row is not None else (np.empty(0),) * 2
            for i, direction in enumerate(directions):
                before[i], r = self._state_change(step, solve, columns, direction, before[i])
                if row is not None:
                    x = before[i].end
                    data[i, row] = (
                        by_state @ x[:n] + model.observables.motions @ r + by_theta @ np.append(direction, x[n:])
                    )
        return data

    def _state_change(
        self, step: ReplayStep, solve: Solve, columns: sp.csr_array, direction: Array, before: CarriedState
    ) -> tuple[CarriedState, Array]:
        """Changes at the end of a step, from those at its start and of θ, and the change of the tissue's forces (ndof,)."""
        model, theta, n = self.model, self.model.split(direction), self.model.body.fes.ndof
        r, outer = np.zeros(model.n), columns @ direction
        r[:n] = model.forms.residual_derivative(before.history, theta)
        for name, shapes in model.shapes.items():
            r[:n] += shapes.force_jacobian() @ theta[name]
        for each, carried in zip(model.carried, before.carried, strict=True):
            change = each.residual_derivative(before.end, carried, list(theta.values()))
            r, outer = (r + change, outer) if each.in_reactions else (r, outer + change)
        driven = np.zeros(model.n)
        for part, where in model.prescribed_blocks:
            driven[part.dofs] = model.replay.load_factor(step) * direction[where]
        if model.prescribed_blocks:
            outer = outer + model.tangents.multiply(driven)
        x = driven - solve(r + outer)
        history = model.forms.history_derivative(x[:n])
        for name, shapes in model.shapes.items():
            history += shapes.history_derivative(theta[name])
        return CarriedState(x, history, [each.carried_derivative(x) for each in model.carried]), r[:n]

    def _columns(self, step: ReplayStep) -> sp.csr_array:
        """Derivative of contact and load forces with respect to θ, and of the tool's force balance."""
        model = self.model
        columns = model.contacts.parameter_jacobian()[:, : model.size]
        if model.body.tool is None:
            return columns
        felt = model.contacts.tool_force_parameter_gradient()[: model.size] - model.prescribed_force_gradient(step)
        return sp.csr_array(sp.vstack([columns, sp.csr_array(felt[None])]))

    def _prepare(self, step: ReplayStep, n_rhs: int, rtol: float = RTOL) -> Solve:
        """Prepare forms and tangent of a step at whose end the body is."""
        self._set(step)
        return self.model.tangents.prepare(n_rhs, rtol)

    def _set(self, step: ReplayStep) -> None:
        grid = self.model.replay.grid
        self.model.forms.begin(step.start.internal, grid[step.n + 1] - grid[step.n])
