"""Result and iteration log of an inversion, shared by all optimisers."""

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
from ngbrain.look import BriefText, descent
from ngbrain.result import Result, Status

Array = np.ndarray
LOG = logging.getLogger(__name__)
CONVERGED_CHANGE = 1e-3
"""Root-mean-square change of all fields at which the iterations end, if the weights changed by less than `CONVERGED_FACTOR`."""
CONVERGED_FACTOR = 1.3
FULL_STEP_SHARE = 0.5
"""Relative step length up to which the weights are not updated: the fields are still far from their minimum."""


@dataclass(repr=False)
class Iteration(BriefText):
    """Record of one iteration.

    Parameters
    ----------
    phase : str
        Phase of the inversion, "waves", "fields" or the name of the optimiser.
    misfit : float
        2Φ.
    expected : float
        Expected value of 2Φ.
    weights : dict of str to float
        Weights that were used.
    change : float
        Root-mean-square change of x.
    step : float
        Relative step length.
    cpu_s : float
        CPU time since the start (s).
    determined : dict of str to float
        Effective number of parameters of each field.
    """

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
        """Misfit over its expected value, see `MisfitLevel`."""
        return MisfitLevel(self.misfit, self.expected).ratio

    def __str__(self) -> str:
        """Progress message."""
        start = {"waves": "measured waves", "fields": "descent"}.get(self.phase, self.phase)
        return f"{start}: misfit {self.ratio:.3g} times its expected value"


@dataclass(repr=False, eq=False)
class OptimisationResult(Result):
    """Result of an inversion: converged, stalled (no step lowered J) or stopped.

    Parameters
    ----------
    x : array (n,)
        Unknowns.
    objective : float
        J at x with `weights`.
    level : MisfitLevel
        Misfit and its expected value.
    weights : dict of str to float
        Regularisation weights.
    count : int
        Number of real data.
    history : list of Iteration
        All iterations.
    """

    x: Array
    objective: float
    level: MisfitLevel
    weights: dict[str, float]
    count: int

    @property
    def value(self) -> Array:
        """Unknowns x."""
        return self.x

    @property
    def headline(self) -> str:
        """Summary by the misfit."""
        return f"{len(self.x)} unknowns, misfit {self.level.ratio:.3g} times its expected value"

    @property
    def statistics(self) -> dict[str, float]:
        """Number of iterations and CPU time."""
        return {"iterations": len(self.history)} | ({"cpu_s": self.history[-1].cpu_s} if self.history else {})

    def plot(self) -> Any:
        """Figure of the misfit over the iterations."""
        return plot_misfit_history(self.history)

    @property
    def cross_validation(self) -> float:
        """Generalised cross-validation 2Φ n/(n - γ)², with n data and γ effective parameters; smaller for the better regulariser.

        It does not depend on the noise level.
        """
        return self.level.misfit * self.count / self.level.expected**2

    @property
    def score(self) -> float:
        """n ln(cross-validation): twice a log-likelihood, so that differences have a scale."""
        return self.count * float(np.log(self.cross_validation))


def plot_misfit_history(history: list[Iteration]) -> Any:
    """Figure (matplotlib) of the misfit over its expected value, by iteration."""
    return descent([each.ratio for each in history], "misfit over its expected level", 1.0)


def convergence_status(settled: bool, stuck: bool = False) -> Status:
    """Status of an inversion: converged, stalled where no step lowered J, else stopped.

    Parameters
    ----------
    settled : bool
        Whether fields and weights have converged.
    stuck : bool
        Whether no step lowered J.

    Returns
    -------
    Status
    """
    return Status.CONVERGED if settled else Status.STALLED if stuck else Status.STOPPED


class IterationLog:
    """Log of an inversion: misfit level, weights and convergence after each iteration.

    Parameters
    ----------
    reduced : Reduced
        Objective, whose misfit has a `count`.
    policy : WeightPolicy, optional
        Update of the regularisation weights. Default `Evidence`.
    callback : callable
        Called with each `Iteration`.
    seed : int
        Seed of the random probes that estimate traces.

    Raises
    ------
    InputError
        If the misfit is not derived from `LeastSquares`.
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
        self.started_s = time.process_time()

    def record(
        self,
        phase: str,
        x: Array,
        data: Array,
        counter: EffectiveParameterCounter,
        moved: Array,
        step: float,
        history: list[Iteration],
    ) -> bool:
        """Record one iteration and update the weights.

        Parameters
        ----------
        phase : str
            Phase of the inversion.
        x : array (n,)
            Unknowns after the iteration.
        data : array (loads, n, dim)
            Predicted data.
        counter : EffectiveParameterCounter
            Gauss-Newton curvature.
        moved : array (n,)
            Change of x.
        step : float
            Relative step length, or the share of J that a step left. At `FULL_STEP_SHARE` or less the weights are not updated.
        history : list of Iteration
            History, appended to.

        Returns
        -------
        bool
            Whether fields and weights have converged.
        """
        probes = np.random.default_rng(self._seed)  # the same probes each time, so that the weights have a fixed point
        misfit = self.misfit.weighted_squares(data)
        with spent_on(self.reduced.model, "traces"):
            level = MisfitLevel(misfit, self.misfit.count - counter.effective_parameters(probes))
        weights, change = dict(self.reduced.weights), float(np.sqrt(np.mean(moved**2)))
        cpu_s = time.process_time() - self.started_s
        weight_change = np.inf
        if step > FULL_STEP_SHARE:
            with spent_on(self.reduced.model, "traces"):
                weight_change = self.policy.update(self.reduced, x, level, counter, probes)
        determined = dict(self.policy.determined)
        history.append(Iteration(phase, misfit, level.expected, weights, change, step, cpu_s, determined))
        LOG.info("iteration %d: %s", len(history), history[-1])
        self.callback(history[-1])
        if (change < CONVERGED_CHANGE and weight_change < CONVERGED_FACTOR) or (
            change < 10 * CONVERGED_CHANGE and weight_change < 1.05
        ):
            return True
        # Along a direction that the data leave undetermined, fields keep changing while the misfit hardly does.
        undetermined = getattr(self.reduced.unknowns, "undetermined_direction", None) is not None
        return weight_change < CONVERGED_FACTOR and not undetermined and _within_noise(history)


def _within_noise(history: list[Iteration]) -> bool:
    """Whether the last decrease of 2Φ, at unchanged weights, is within the scatter caused by noise.

    γ effective parameters scatter 2Φ by √(2γ), times the ratio of the misfit to its level where that is larger. Where the model
    leaves much unexplained, Gauss-Newton steps would otherwise keep changing what hardly matters.
    """
    if len(history) < 2:
        return False
    before, now = history[-2:]
    numbers = sum(now.determined.values())
    if now.phase != before.phase or now.phase == "waves" or not numbers:
        return False
    steady = all(
        max(now.weights[name] / w, w / now.weights[name]) < CONVERGED_FACTOR for name, w in before.weights.items()
    )
    chance = np.sqrt(2 * numbers) * max(1.0, now.misfit / now.expected)
    return steady and bool(abs(now.misfit - before.misfit) < chance)
