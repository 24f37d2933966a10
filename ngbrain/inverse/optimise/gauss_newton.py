"""Gauss-Newton inversion of plane wave problems; every step is one factorisation of the optimality conditions.

`from_waves` starts at measured waves, which need not satisfy the equation of motion for the fields. Each iteration is a linear
least-squares problem for both (an equation-error method in which every datum is weighted by its noise). `descend` starts at
fields, solves for their waves and lowers the objective J. From a distant initial guess it can end in a local minimum; after
`from_waves` it refines the result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.errors import ConvergenceError, InputError, SolverError
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY, WaveLinearisation, WaveModel
from ngbrain.inverse.objective.parameters import ParameterFields
from ngbrain.inverse.optimise.kkt import KKTSystem, elimination_order
from ngbrain.inverse.optimise.regularisation_weight import EffectiveParameterCounter, MisfitLevel, WeightPolicy
from ngbrain.inverse.optimise.result import Iteration, IterationLog, OptimisationResult, convergence_status

Array = np.ndarray
MAX_CHANGE = 1.0
"""Largest change of any unknown field in one step: a factor of e where its logarithm is the unknown."""
MIN_STEP = 1e-4
"""Step length at which the backtracking line search stops: without descent so close by, the point is a minimum up to round-off."""
MAX_ITERATIONS = 12
"""Maximum number of iterations of `from_waves`; `descend` may take four times as many."""


@dataclass(repr=False, eq=False)
class WaveInversionResult(OptimisationResult):
    """Result of an inversion with the waves (loads, ndof) at its end."""

    waves: Array = field(default_factory=lambda: np.empty((0, 0)))


class GaussNewton:
    """Gauss-Newton optimiser of a reduced objective whose model is a `WaveModel`.

    The boundary displacements are unknown too where `reduced.unknowns` has the block "boundary".

    Parameters
    ----------
    reduced : Reduced
        Objective; its unknowns are `ParameterFields`.
    policy : WeightPolicy, optional
        Update of the regularisation weights, see `regularisation_weight`. Default `Evidence`.
    callback : callable
        Called with each `Iteration`.
    seed : int
        Seed of the random probes that estimate traces.

    Raises
    ------
    InputError
        If the model is no `WaveModel` of a body at rest, or the unknowns are not `ParameterFields`.
    """

    def __init__(
        self,
        reduced: Reduced,
        policy: WeightPolicy | None = None,
        callback: Callable[[Iteration], None] = lambda _: None,
        seed: int = 0,
    ) -> None:
        model, unknowns = reduced.model, reduced.unknowns
        if (
            not isinstance(model, WaveModel)
            or model.body.state is not None
            or not isinstance(unknowns, ParameterFields)
        ):
            wanted = "a WaveModel of a body at rest, and ParameterFields; use l_bfgs for other models"
            raise InputError("reduced", type(model).__name__, wanted)
        self.reduced, self.model, self.unknowns = reduced, model, unknowns
        self._ledger = IterationLog(reduced, policy, callback, seed)
        self.misfit = self._ledger.misfit
        blocks = reduced.unknowns.blocks
        self._fields = [name for name in blocks if name != BOUNDARY]
        self._width = max(blocks[name].stop for name in self._fields)
        self._fixed = BOUNDARY not in blocks
        self._order: Array | None = None

    def from_waves(self, x: Array, waves: Array, max_iterations: int = MAX_ITERATIONS) -> WaveInversionResult:
        """Invert from measured waves to fields and waves that fit both the data and the equation of motion.

        Parameters
        ----------
        x : array (n,)
            Initial guess of the unknowns.
        waves : array (loads, ndof)
            Measured waves, as coefficients in the space of displacements and pressures.
        max_iterations : int
            Maximum number of iterations.

        Returns
        -------
        WaveInversionResult
        """
        history: list[Iteration] = []
        for _ in range(max_iterations):
            theta = self.reduced.unknowns.theta(x)
            state = self.model.linearise(theta, waves)
            balance = np.array(
                [self.model.body.load_vector(k) - state.factors.apply(k, u) for k, u in enumerate(waves)]
            )
            conditions, dx, du = self._step(x, state, balance)
            step = self._step_bound(dx)
            x, waves = self._apply_step(x, step * dx, waves + step * du)
            data = np.array([self.model.observe(u) for u in waves])
            settled = self._ledger.record("waves", x, data, conditions, step * dx, step, history)
            if settled:
                break
        return self._result(
            x, waves, self.model.linearise(self.reduced.unknowns.theta(x), waves).data, history, settled
        )

    def descend(self, x: Array, max_iterations: int = 4 * MAX_ITERATIONS) -> WaveInversionResult:
        """Minimise J from given fields, with weights that converge along with them.

        Parameters
        ----------
        x : array (n,)
            Initial guess of the unknowns.
        max_iterations : int
            Maximum number of iterations.

        Returns
        -------
        WaveInversionResult

        Raises
        ------
        ConvergenceError
            If no step from `x` lowers J.
        """
        return self._minimise(self.reduced.evaluate(x), max_iterations, [])

    def _minimise(
        self, point: Point, max_iterations: int, history: list[Iteration], settled: bool = False
    ) -> WaveInversionResult:
        stuck = False
        for _ in range(0 if settled else max_iterations):
            conditions, dx, du = self._step(point.x, self._state(point), None)
            step, lower = self._line_search(point, dx, du)
            if lower is None:
                stuck = True
                break
            point = lower
            moved = step * dx[: self._width]
            settled = self._ledger.record("fields", point.x, point.state.data, conditions, moved, step, history)
            settled = settled or self._is_stationary(history)
            self._write_checkpoint(point.x, history, settled)
            point = Point(self.reduced, point.x, point.state)  # with the new weights
            if settled:
                break
        if not history:
            raise ConvergenceError("no step lowers the objective from the initial guess: try another one")
        return self._result(point.x, self._state(point).waves, point.state.data, history, settled, stuck)

    def _is_stationary(self, history: list[Iteration]) -> bool:
        """Whether further iterations would change nothing that matters, though the fields still move."""
        return False

    def _write_checkpoint(self, x: Array, history: list[Iteration], settled: bool) -> None:
        """Write a checkpoint, in optimisers that have one."""

    @staticmethod
    def _state(point: Point) -> WaveLinearisation:
        assert isinstance(point.state, WaveLinearisation)
        return point.state

    def _step(
        self, x: Array, state: WaveLinearisation, balance: Array | None
    ) -> tuple[EffectiveParameterCounter, Array, Array]:
        reduced, width = self.reduced, self._width
        jacobian = reduced.unknowns.jacobian(x)[: self.model.blocks[BOUNDARY].start, :width]
        regular = reduced.regular_matrix(x)[:width, :width]
        level = None if self.unknowns.undetermined_direction is None else self.unknowns.undetermined_direction[:width]
        if self._order is None:
            self._order = elimination_order(self.model, jacobian, self._fixed, level is not None)
        weight = self.misfit.weight(state.data)
        conditions = KKTSystem(state, jacobian, regular, weight, self._fixed, level, self._order)
        residual = np.where(self.misfit.known, self.misfit.measured - state.data, 0)
        dx, du = conditions.step(reduced.regular_gradient(x)[:width], residual, balance)
        return conditions, dx, du

    def _apply_step(self, x: Array, dx: Array, waves: Array) -> tuple[Array, Array]:
        new = x.copy()
        new[: self._width] += dx
        if not self._fixed:
            driven = waves[:, self.model.driven_dofs]
            parts = np.concatenate([part for g in driven for part in (g.real, g.imag)])
            transform = self.unknowns.unknowns[BOUNDARY].transform
            new[self.reduced.unknowns.blocks[BOUNDARY]] = transform.inverse(parts)
        return new, waves

    def _line_search(self, point: Point, dx: Array, du: Array) -> tuple[float, Point | None]:
        step = self._step_bound(dx)
        while step >= MIN_STEP:
            x, _ = self._apply_step(point.x, step * dx, self._state(point).waves + step * du)
            try:
                tried = self.reduced.evaluate(x)
            except SolverError:
                tried = None
            if tried is not None and tried.value <= point.value * (1 + 1e-9):
                return step, tried
            step /= 2
        return step, None

    def _step_bound(self, dx: Array) -> float:
        # Bounded by values at the measurement points: coefficients of higher-order elements are not values.
        unknowns, blocks = self.unknowns.unknowns, self.reduced.unknowns.blocks
        values = [dx[blocks[name]] for name in self._fields if unknowns[name].basis is not None]
        values += [self._interpolation[name] @ dx[blocks[name]] for name in self._interpolation]
        return min(1.0, MAX_CHANGE / max(float(np.abs(np.concatenate(values)).max()), 1e-300))

    @cached_property
    def _interpolation(self) -> dict[str, sp.csr_array]:
        found, once = {}, dict[int, sp.csr_array]()
        for name in self._fields:
            if self.unknowns.unknowns[name].basis is None:
                space = self.model.fields[name].space
                if space.globalorder not in once:
                    once[space.globalorder] = evaluation(space, self.model.points)
                found[name] = once[space.globalorder]
        return found

    def _result(
        self, x: Array, waves: Array, data: Array, history: list[Iteration], settled: bool, stuck: bool = False
    ) -> WaveInversionResult:
        level, weights = (
            MisfitLevel(self.misfit.weighted_squares(data), history[-1].expected),
            dict(self.reduced.weights),
        )
        value = self.misfit.value(data) + self.reduced.regular(x)
        status = convergence_status(settled, stuck)
        return WaveInversionResult(x, value, level, weights, self.misfit.count, waves, status=status, history=history)
