"""Gauss-Newton inversion of plane problems: every step by one factorisation of the optimality conditions.

`from_waves` starts at measured waves, which need not fit the fields: each of its rounds is a linear least-squares problem for
both (an equation-error method in which every datum counts by its noise). `descend` starts at fields, solves for their waves
and goes down in J; from a far start it can end in a local minimum, from where `from_waves` ends it polishes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.errors import ConvergenceError, SolverError
from ngbrain.forward.sensitivity import BOUNDARY, Linearised, WaveModel
from ngbrain.inverse.optimality import Optimality
from ngbrain.inverse.weights import Determined, Evidence, Level, Policy

Array = np.ndarray
LONGEST = 1.0
"""Change of any unknown field in one step: by a factor of e where its logarithm is looked for."""
SHORTEST = 1e-4
SETTLED = 1e-3
"""Change of all fields (rms) at which the iteration ends, if the weights moved by less than `STEADY`."""
STEADY = 1.3
ROUNDS = 12


@dataclass
class Iteration:
    """What one iteration did."""

    phase: str
    misfit: float
    expected: float
    weights: dict[str, float]
    change: float
    step: float
    cpu_s: float


@dataclass
class Found:
    """Where an inversion ended.

    x, waves   unknowns and waves (loads, ndof)
    value      J there, at `weights`
    level      misfit and its expected level
    history    an `Iteration` for each
    converged  whether fields and weights had settled
    """

    x: Array
    waves: Array
    value: float
    level: Level
    weights: dict[str, float]
    converged: bool
    history: list[Iteration] = field(default_factory=list)

    @property
    def cross_validation(self) -> float:
        """2Φ n/(n - γ)², n data of which γ are used up: smaller for the better of two regularisers, whatever the noise."""
        return self.level.misfit * self._count / self.level.expected**2

    _count: int = 1


class GaussNewton:
    """Steps of `reduced` whose model is a `WaveModel`.

    policy   what changes the weights, see `weights`
    tell     called with each `Iteration`
    seed     of the probes that estimate traces

    The boundary's displacements are unknown too where `reduced.unknowns` has the block "boundary".
    """

    def __init__(
        self,
        reduced: Reduced,
        policy: Policy | None = None,
        tell: Callable[[Iteration], None] = lambda _: None,
        seed: int = 0,
    ) -> None:
        self.reduced, self.policy, self.tell = reduced, policy or Evidence(), tell
        self.model: WaveModel = reduced.model  # type: ignore[assignment]
        self._random = np.random.default_rng(seed)
        blocks = reduced.unknowns.blocks
        self._fields = [name for name in blocks if name != BOUNDARY]
        self._width = max(blocks[name].stop for name in self._fields)
        self._fixed = BOUNDARY not in blocks
        self._begun = time.process_time()

    def from_waves(self, x: Array, waves: Array, rounds: int = ROUNDS) -> Found:
        """From waves (loads, ndof), measured ones, to fields and waves that fit both data and equation of motion."""
        history: list[Iteration] = []
        for _ in range(rounds):
            theta = self.reduced.unknowns.theta(x)
            state = self.model.around(theta, waves)
            balance = np.array([self.model.body.pushed(k) - state.factors.apply(k, u) for k, u in enumerate(waves)])
            conditions, dx, du = self._step(x, state, balance)
            step = self._bounded(dx)
            x, waves = self._moved(x, step * dx, waves + step * du)
            data = np.array([self.model.observed(u) for u in waves])
            change, settled = self._account("waves", x, data, conditions, dx, step, history)
            if settled:
                break
        return self._found(x, waves, self.model.around(self.reduced.unknowns.theta(x), waves).data, history, settled)

    def descend(self, x: Array, rounds: int = 4 * ROUNDS) -> Found:
        """From fields down to a minimum of J, at weights that settle with it."""
        return self._down(x, rounds, [])

    def _down(self, x: Array, rounds: int, history: list[Iteration]) -> Found:
        point = self.reduced.at(x)
        settled = False
        for _ in range(rounds):
            state: Linearised = point.state  # type: ignore[assignment]
            conditions, dx, du = self._step(point.x, state, None)
            step, lower = self._lower(point, dx, du)
            if lower is None:
                break
            point = lower
            _, settled = self._account("fields", point.x, point.state.data, conditions, dx, step, history)
            point = Point(self.reduced, point.x, point.state)  # at the new weights
            if settled:
                break
        if not history:
            raise ConvergenceError("no step lowers the objective from where it starts: try another start")
        return self._found(point.x, point.state.waves, point.state.data, history, settled)  # type: ignore[attr-defined]

    def _step(self, x: Array, state: Linearised, balance: Array | None) -> tuple[Determined, Array, Array]:
        reduced, width = self.reduced, self._width
        jacobian = reduced.unknowns.jacobian(x)[: self.model.blocks[BOUNDARY].start, :width]
        regular = reduced.regular_matrix(x)[:width, :width]
        conditions = Optimality(state, jacobian, regular, reduced.misfit.weight(state.data), self._fixed)  # type: ignore[attr-defined]
        self.model.solves.factorisations += 1
        measured = reduced.misfit.measured - state.data  # type: ignore[attr-defined]
        residual = np.where(reduced.misfit.known, measured, 0)  # type: ignore[attr-defined]
        dx, du = conditions.step(reduced.regular_slope(x)[:width], residual, balance)
        return conditions, dx, du

    def _moved(self, x: Array, dx: Array, waves: Array) -> tuple[Array, Array]:
        new = x.copy()
        new[: self._width] += dx
        if not self._fixed:
            driven = waves[:, self.model.driving]
            parts = np.concatenate([part for g in driven for part in (g.real, g.imag)])
            transform = self.reduced.unknowns.unknowns[BOUNDARY].transform  # type: ignore[attr-defined]
            new[self.reduced.unknowns.blocks[BOUNDARY]] = transform.inverse(parts)
        return new, waves

    def _lower(self, point: Point, dx: Array, du: Array) -> tuple[float, Point | None]:
        step = self._bounded(dx)
        while step >= SHORTEST:
            x, _ = self._moved(point.x, step * dx, point.state.waves + step * du)  # type: ignore[attr-defined]
            try:
                tried = self.reduced.at(x)
            except SolverError:
                tried = None
            if tried is not None and tried.value <= point.value * (1 + 1e-9):
                return step, tried
            step /= 2
        return step, None

    def _bounded(self, dx: Array) -> float:
        return min(1.0, LONGEST / max(float(np.abs(dx).max()), 1e-300))

    def _account(
        self,
        phase: str,
        x: Array,
        data: Array,
        conditions: Determined,
        dx: Array,
        step: float,
        history: list[Iteration],
    ) -> tuple[float, bool]:
        reduced = self.reduced
        misfit = 2 * reduced.misfit.value(data)
        level = Level(misfit, reduced.misfit.count - conditions.determined(self._random))  # type: ignore[attr-defined]
        weights = dict(reduced.weights)
        moved = self.policy.update(reduced, x, level, conditions, self._random) if step > 0.5 else LARGE
        change = float(np.sqrt(np.mean(dx**2))) * step
        history.append(
            Iteration(phase, misfit, level.expected, weights, change, step, time.process_time() - self._begun)
        )
        self.tell(history[-1])
        return change, bool(change < SETTLED and moved < STEADY) or bool(change < 10 * SETTLED and moved < 1.05)

    def _found(self, x: Array, waves: Array, data: Array, history: list[Iteration], settled: bool) -> Found:
        misfit = self.reduced.misfit.value(data)
        level = Level(2 * misfit, history[-1].expected)
        found = Found(x, waves, misfit + self.reduced.regular(x), level, dict(self.reduced.weights), settled, history)
        found._count = self.reduced.misfit.count  # type: ignore[attr-defined]
        return found


LARGE = 1e9
