"""BFGS, L-BFGS and Newton-CG on the reduced objective: an inversion by values, gradients and products alone.

All three take a `Reduced`, a start x, a policy of `weights` (by default the evidence), what to call with each `Iteration`, and
the seed of the probes that estimate traces, and differ in how a round goes down. They raise `ConvergenceError` when there is no
way down from x.

Unknowns are whitened by the regulariser, ξ = L(x - x₀) with LᵀL = Σ αR, so that the identity is a fair first guess of the
curvature, whatever the mesh. Each round goes down at fixed weights, `most` iterations or until no more than a part `GAIN` of a
unit of J for each datum can be gained, |∇_ξ J|² being a bound as long as the regulariser is the least of the curvature; then a
policy of `weights` changes the weights, its traces estimated by conjugate gradients. They see only `Reduced`, so any model will
do, and descend only: from a far start they end in a local minimum.

Sources: Nocedal and Wright 2006, Numerical Optimization, 10.1007/978-0-387-40065-5, algorithms 6.1, 7.2, 7.4, 7.5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import scipy.linalg
import scipy.optimize

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.errors import ConvergenceError, SolverError
from ngbrain.inverse.optimise.gauss_newton_hessian import GaussNewtonHessian, Metric
from ngbrain.inverse.optimise.regularisation_weight import MisfitLevel, WeightPolicy
from ngbrain.inverse.optimise.result import Iteration, IterationLog, OptimisationResult, convergence_status

Array = np.ndarray
GAIN = 1e-4
MEMORY, MAX_ITERATIONS = 20, 16
BACK = 3.0
"""Where a model has no solution, how much steeper it goes up than it went down before: that of a parabola whose least is a
quarter of the step away. A huge value instead, and scipy's L-BFGS interpolates a step of no length and gives up."""
ARMIJO, WOLFE = 1e-4, 0.9
NOTHING = 1e-280
"""A squared slope or step that is zero but for underflow."""
Tell = Callable[[Iteration], None]


def bfgs(
    reduced: Reduced,
    x: Array,
    policy: WeightPolicy | None = None,
    callback: Tell = lambda _: None,
    seed: int = 0,
    *,
    max_inner_iterations: int = 50,
    max_iterations: int = MAX_ITERATIONS,
) -> OptimisationResult:
    """Rounds of BFGS with a dense matrix: n² numbers, so for n ≲ 10 000.

    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 9).simulate_measurements(0.01).inversion()
    >>> before = 2 * inversion.reduced.evaluate(inversion.start).misfit
    >>> bfgs(inversion.reduced, inversion.start).level.misfit < 0.01 * before
    True
    """
    return _Rounds(reduced, policy, callback, seed, "bfgs").run(
        x, lambda way: _dense(way, max_inner_iterations), max_iterations
    )


def l_bfgs(
    reduced: Reduced,
    x: Array,
    policy: WeightPolicy | None = None,
    callback: Tell = lambda _: None,
    seed: int = 0,
    *,
    max_inner_iterations: int = 50,
    max_iterations: int = MAX_ITERATIONS,
) -> OptimisationResult:
    """Rounds of BFGS that remembers the last `MEMORY` steps (scipy), for any n; slower to arrive than `bfgs`.

    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 7).simulate_measurements(0.02).inversion()
    >>> l_bfgs(inversion.reduced, inversion.start, max_iterations=2).history[-1].phase
    'l-bfgs'
    """
    options = {
        "maxcor": MEMORY,
        "maxiter": max_inner_iterations,
        "maxfun": 10 * max_inner_iterations,
        "ftol": 0.0,
        "gtol": 0.0,
    }
    return _Rounds(reduced, policy, callback, seed, "l-bfgs").run(
        x, lambda way: _scipy(way, "L-BFGS-B", options), max_iterations
    )


def newton_cg(
    reduced: Reduced,
    x: Array,
    policy: WeightPolicy | None = None,
    callback: Tell = lambda _: None,
    seed: int = 0,
    *,
    max_inner_iterations: int = 20,
    max_iterations: int = MAX_ITERATIONS,
) -> OptimisationResult:
    """Rounds of Gauss-Newton steps in a trust region, by conjugate gradients (scipy): fewest iterations, two solves in each of
    theirs.

    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 9).simulate_measurements(0.01).inversion()
    >>> newton_cg(inversion.reduced, inversion.start).level.ratio < 1.3
    True
    """
    options = {"maxiter": max_inner_iterations, "gtol": 0.0, "initial_trust_radius": 1.0, "max_trust_radius": 1e6}
    return _Rounds(reduced, policy, callback, seed, "newton-cg").run(
        x, lambda way: _scipy(way, "trust-ncg", options), max_iterations
    )


class _Way:
    """J in white variables around x₀, with the last point asked for and the best one."""

    def __init__(self, reduced: Reduced, x: Array, gain: float) -> None:
        self.reduced, self.origin, self.gain = reduced, x, gain
        self._at, self._point = np.zeros(len(x)), reduced.evaluate(x)
        self.metric = Metric.from_point(self._point)
        self._slope: Array | None = None
        self._solved: tuple[Array, float, Array]

    def point(self, xi: Array) -> Point:
        """At ξ; the model is asked anew if it was elsewhere meanwhile."""
        if not np.array_equal(xi, self._at):
            self._point = self.reduced.evaluate(self.origin + self.metric.unwhiten(xi))
            self._at, self._slope = np.array(xi), None
        return self._point

    def value(self, xi: Array) -> tuple[float, Array]:
        """J and its gradient by ξ."""
        try:
            point = self.point(xi)
            if self._slope is None:
                self._slope = self.metric.whiten_gradient(point.gradient())
        except SolverError:
            self._at = np.full_like(xi, np.nan)
            return self._turned_back(xi)
        self._solved = np.array(xi), point.value, self._slope
        return point.value, self._slope

    def _turned_back(self, xi: Array) -> tuple[float, Array]:
        """Where there is no solution: uphill from the last point that had one; there, what it had."""
        last, value, slope = self._solved
        step = xi - last
        if (square := float(step @ step)) < NOTHING:
            return value, slope
        rise = abs(float(slope @ step))
        return value + rise, BACK * rise / square * step

    def product(self, xi: Array, direction: Array) -> Array:
        """The Gauss-Newton matrix by ξ times a direction."""
        return self.metric.whiten_gradient(self.point(xi).product(self.metric.unwhiten(direction)))

    def near(self, slope: Array) -> bool:
        """Whether hardly anything is left to be gained."""
        return float(slope @ slope) <= self.gain


class _Rounds:
    def __init__(self, reduced: Reduced, policy: WeightPolicy | None, callback: Tell, seed: int, phase: str) -> None:
        self.reduced, self.phase = reduced, phase
        self.ledger = IterationLog(reduced, policy, callback, seed)

    def run(self, x: Array, down: Callable[[_Way], Array], max_iterations: int) -> OptimisationResult:
        history: list[Iteration] = []
        settled = False
        for _ in range(max_iterations):
            way = _Way(self.reduced, x, GAIN * self.ledger.misfit.count)
            before, xi = way.value(np.zeros(len(x)))[0], down(way)
            moved = way.metric.unwhiten(xi)
            if not history and not np.any(moved):
                raise ConvergenceError("no step lowers the objective from where it starts: try another start")
            x = x + moved
            point = self.reduced.evaluate(x)
            curvature = GaussNewtonHessian(point, Metric.from_point(point))
            settled = self.ledger.enter(
                self.phase, x, point.state.data, curvature, moved, point.value / before, history
            )
            if settled:
                break
        misfit = 2 * point.misfit
        value, weights = point.misfit + self.reduced.regular(x), dict(self.reduced.weights)
        level = MisfitLevel(misfit, history[-1].expected)
        count, status = self.ledger.misfit.count, convergence_status(settled)
        return OptimisationResult(x, value, level, weights, count, status=status, history=history)


def _scipy(way: _Way, method: str, options: dict[str, float]) -> Array:
    def stop(intermediate_result: scipy.optimize.OptimizeResult) -> None:
        if way.near(way.value(intermediate_result.x)[1]):
            raise StopIteration

    given = {"hessp": way.product} if method == "trust-ncg" else {}
    zero = np.zeros(len(way.origin))
    found = scipy.optimize.minimize(way.value, zero, jac=True, method=method, callback=stop, options=options, **given)
    return np.asarray(found.x)


def _dense(way: _Way, max_inner_iterations: int) -> Array:
    xi = np.zeros(len(way.origin))
    if way.near(way.value(xi)[1]):
        return xi
    for number, lower, _ in bfgs_iterations(way.value, xi):
        xi = lower
        if number == max_inner_iterations or way.near(way.value(xi)[1]):
            break
    return xi


def bfgs_iterations(function: Callable[[Array], tuple[float, Array]], x: Array) -> Iterator[tuple[int, Array, float]]:
    """BFGS in the variables as they are, iteration by iteration: number, x, value; to where no step goes down.

    Its update takes n² operations, where scipy's takes n³.

    >>> [round(float(x[0]), 6) for _, x, _ in bfgs_iterations(lambda x: (float(x @ x), 2 * x), np.array([3.0]))][-1]
    0.0
    """
    value, slope = function(x)
    inverse, number = np.eye(len(x)), 0
    while float(slope @ slope) > NOTHING:
        direction = -(inverse @ slope) if number else -slope * min(1.0, 1 / float(np.abs(slope).max()))
        found = line_search(partial(_along, function, x, direction), value, slope, direction)
        if found is None:
            return
        step, value, new = found
        change, bend = step * direction, new - slope
        if not number:  # Oren and Spedicato's scale, once there is a curvature to take it from
            inverse *= float(change @ bend) / float(bend @ bend)
        update_inverse_hessian(inverse, change, bend)
        x, slope, number = x + change, new, number + 1
        yield number, x, value


def _along(
    function: Callable[[Array], tuple[float, Array]], x: Array, direction: Array, step: float
) -> tuple[float, Array]:
    return function(x + step * direction)


def update_inverse_hessian(inverse: Array, change: Array, bend: Array) -> None:
    """BFGS's update of the inverse of a Hessian in place, by a step and the change of the gradient along it."""
    curvature = float(change @ bend)
    if not curvature > 0:
        return
    y = inverse @ bend
    a = change * ((1 + float(bend @ y) / curvature) / curvature) - y / curvature
    # += np.outer(a, change) - np.outer(change, y) / curvature, without another matrix
    scipy.linalg.blas.dger(1.0, change, a, a=inverse.T, overwrite_a=1)
    scipy.linalg.blas.dger(-1 / curvature, y, change, a=inverse.T, overwrite_a=1)


def line_search(
    along: Callable[[float], tuple[float, Array]],
    value: float,
    slope: Array,
    direction: Array,
    max_inner_iterations: int = 30,
) -> tuple[float, float, Array] | None:
    """Step, value and gradient where both of Wolfe's conditions hold, by bisection and doubling; None if there is no such step.

    `along` gives value and gradient at a step. Source: Nocedal and Wright, algorithm 3.5, with bisection.

    >>> line_search(lambda a: ((a - 3.0) ** 2, np.array([2 * (a - 3.0)])), 9.0, np.array([-6.0]), np.array([1.0]))[0]
    1.0
    """
    start = float(slope @ direction)
    low, high, step = 0.0, np.inf, 1.0
    for _ in range(max_inner_iterations):
        now, gradient = along(step)
        if not now <= value + ARMIJO * step * start:
            high = step
        elif float(gradient @ direction) < WOLFE * start:
            low = step
        else:
            return step, now, gradient
        step = 2 * step if high == np.inf else 0.5 * (low + high)
    return None
