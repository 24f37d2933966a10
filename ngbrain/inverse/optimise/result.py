"""Where an inversion ended and how it went there, the same for all ways of going."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import InputError
from ngbrain.forward.common.solve_counts import spent_on
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.optimise.regularisation_weight import (
    EffectiveParameterCounter,
    Evidence,
    MisfitLevel,
    WeightPolicy,
)
from ngbrain.look import descent
from ngbrain.result import Result, Status

Array = np.ndarray
LOG = logging.getLogger(__name__)
SETTLED = 1e-3
"""Change of all fields (rms) at which the iteration ends, if the weights moved by less than `STEADY`."""
STEADY = 1.3
FAST = 0.5
"""Length of a step, as a share of the full one, down to which fields are still on their way: weights wait for them."""


@dataclass
class Iteration:
    """What one iteration did: 2Φ and where it is expected, the weights it used, change of x (rms), how far its step is
    to be trusted, CPU time, how many numbers of each field the data determine."""

    phase: str
    misfit: float
    expected: float
    weights: dict[str, float]
    change: float
    step: float
    cpu_s: float
    determined: dict[str, float] = field(default_factory=dict)

    @property
    def ratio(self) -> float:
        """See `Level`."""
        return MisfitLevel(self.misfit, self.expected).ratio

    def __str__(self) -> str:
        """A few words, for who waits."""
        start = {"waves": "measured waves", "fields": "descent"}.get(self.phase, self.phase)
        return f"{start}: misfit {self.ratio:.3g} times what is expected"


@dataclass(repr=False, eq=False)
class OptimisationResult(Result):
    """Where an inversion ended: converged if fields and weights had settled, stalled if no step lowered J any more.

    x          unknowns
    objective  J there, at `weights`
    level      misfit and its expected level
    count      how many real data there are
    history    an `Iteration` for each
    """

    x: Array
    objective: float
    level: MisfitLevel
    weights: dict[str, float]
    count: int

    @property
    def value(self) -> Array:
        """The unknowns."""
        return self.x

    @property
    def headline(self) -> str:
        """By its misfit."""
        return f"{len(self.x)} unknowns, misfit {self.level.ratio:.3g} times what is expected"

    @property
    def statistics(self) -> dict[str, float]:
        """Of all iterations."""
        return {"iterations": len(self.history)} | ({"cpu_s": self.history[-1].cpu_s} if self.history else {})

    def plot(self) -> Any:
        """The misfit over iterations."""
        return plot_misfit_history(self.history)

    @property
    def cross_validation(self) -> float:
        """2Φ n/(n - γ)², n data of which γ are used up: smaller for the better of two regularisers, whatever the noise."""
        return self.level.misfit * self.count / self.level.expected**2

    @property
    def score(self) -> float:
        """n ln of it: twice a logarithm of likelihoods, so that differences have a size."""
        return self.count * float(np.log(self.cross_validation))


def plot_misfit_history(history: list[Iteration]) -> Any:
    """The misfit over what is expected, iteration by iteration, as a matplotlib Figure."""
    return descent([each.ratio for each in history], "misfit over its expected level", 1.0)


def convergence_status(settled: bool, stuck: bool = False) -> Status:
    """Of an inversion whose fields and weights have settled, or that no step lowered any more, or that was stopped."""
    return Status.CONVERGED if settled else Status.STALLED if stuck else Status.STOPPED


class IterationLog:
    """Books of an inversion: levels and weights after each iteration.

    reduced  with a misfit that has a `count`
    policy   what changes the weights, see `weights`; by default `Evidence`
    callback     called with each `Iteration`
    seed     of the probes that estimate traces
    """

    def __init__(
        self,
        reduced: Reduced,
        policy: WeightPolicy | None = None,
        callback: Callable[[Iteration], None] = lambda _: None,
        seed: int = 0,
    ) -> None:
        if not isinstance(reduced.misfit, LeastSquares):
            raise InputError("misfit", type(reduced.misfit).__name__, "LeastSquares or one that is made of it")
        self.reduced, self.misfit = reduced, reduced.misfit
        self.policy, self.callback = policy or Evidence(), callback
        self._seed = seed
        self.begun = time.process_time()

    def enter(
        self,
        phase: str,
        x: Array,
        data: Array,
        factor: EffectiveParameterCounter,
        moved: Array,
        step: float,
        history: list[Iteration],
    ) -> bool:
        """One more iteration, which moved x by `moved`; new weights. True when all has settled.

        step  how far it is to be trusted: the cut of a step, or what it left of J; at `FAST` or less the weights wait
        """
        probes = np.random.default_rng(self._seed)  # the same each time: without, weights would have no fixed point
        misfit = self.misfit.weighted_squares(data)
        with spent_on(self.reduced.model, "traces"):
            level = MisfitLevel(misfit, self.misfit.count - factor.effective_parameters(probes))
        weights, change = dict(self.reduced.weights), float(np.sqrt(np.mean(moved**2)))
        cpu_s = time.process_time() - self.begun
        turned = np.inf
        if step > FAST:
            with spent_on(self.reduced.model, "traces"):
                turned = self.policy.update(self.reduced, x, level, factor, probes)
        determined = dict(self.policy.determined)
        history.append(Iteration(phase, misfit, level.expected, weights, change, step, cpu_s, determined))
        LOG.info("iteration %d: %s", len(history), history[-1])
        self.callback(history[-1])
        if (change < SETTLED and turned < STEADY) or (change < 10 * SETTLED and turned < 1.05):
            return True
        # Where data leave the level of fields open, these creep along what hardly changes the misfit.
        open_level = getattr(self.reduced.unknowns, "undetermined_direction", None) is not None
        return turned < STEADY and not open_level and _by_chance(history)


def _by_chance(history: list[Iteration]) -> bool:
    """Whether the last step down, at weights as before it, changed 2Φ by less than the numbers that the data determine scatter it.

    γ numbers scatter 2Φ by √(2γ), or as much more as the misfit is above its level. Where a model leaves much unexplained, steps
    of Gauss and Newton go on to change what hardly matters.
    """
    if len(history) < 2:
        return False
    before, now = history[-2:]
    numbers = sum(now.determined.values())
    if now.phase != before.phase or now.phase == "waves" or not numbers:
        return False
    steady = all(max(now.weights[name] / w, w / now.weights[name]) < STEADY for name, w in before.weights.items())
    chance = np.sqrt(2 * numbers) * max(1.0, now.misfit / now.expected)
    return steady and bool(abs(now.misfit - before.misfit) < chance)
