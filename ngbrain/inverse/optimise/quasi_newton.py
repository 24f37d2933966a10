"""BFGS, L-BFGS and Newton-CG on the reduced objective, by values, gradients and Hessian products alone.

Unknowns are whitened by the regularisers, ξ = L(x - x₀) with LᵀL = Σ αR, so that the identity is a fair initial Hessian on any
mesh. An outer iteration minimises J at fixed weights, for at most `max_inner_iterations` or until the possible reduction is below
`GAIN` per datum; |∇_ξ J|² bounds it as long as the regulariser is the least of the curvature. Then the policy updates the weights,
with traces estimated by conjugate gradients. The optimisers see only `Reduced`, so that any model will do. They only descend: from
a distant initial guess they end in a local minimum.

References
----------
Nocedal and Wright 2006, Numerical Optimization, 10.1007/978-0-387-40065-5, algorithms 6.1, 7.2, 7.4, 7.5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import scipy

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.errors import ConvergenceError, SolverError
from ngbrain.inverse.optimise.gauss_newton_hessian import GaussNewtonHessian, Metric
from ngbrain.inverse.optimise.regularisation_weight import MisfitLevel, WeightPolicy
from ngbrain.inverse.optimise.result import Iteration, IterationLog, OptimisationResult, convergence_status

Array = np.ndarray
GAIN = 1e-4
MEMORY, MAX_ITERATIONS = 20, 16
UPHILL = 3.0
"""Slope beyond the domain of the model, relative to the slope of the descent before it: that of a parabola whose minimum is a
quarter of the step away. With a huge value instead, scipy's L-BFGS interpolates a step of zero length and gives up.
"""
ARMIJO, WOLFE = 1e-4, 0.9
UNDERFLOW = 1e-280
"""Squared gradient or step that is zero but for underflow."""
Callback = Callable[[Iteration], None]


def bfgs(
    reduced: Reduced,
    x: Array,
    policy: WeightPolicy | None = None,
    callback: Callback = lambda _: None,
    seed: int = 0,
    *,
    max_inner_iterations: int = 50,
    max_iterations: int = MAX_ITERATIONS,
) -> OptimisationResult:
    """Minimise the objective by BFGS with a dense matrix of n² numbers, for n ≲ 10 000.

    Parameters
    ----------
    reduced : Reduced
        Objective.
    x : array (n,)
        Initial guess of the unknowns.
    policy : WeightPolicy, optional
        Update of the regularisation weights. Default `Evidence`.
    callback : callable
        Called with each `Iteration`.
    seed : int
        Seed of the random probes that estimate traces.
    max_inner_iterations : int
        Maximum number of iterations at fixed weights.
    max_iterations : int
        Maximum number of outer iterations.

    Returns
    -------
    OptimisationResult

    Raises
    ------
    ConvergenceError
        If no step from `x` lowers J.

    Examples
    --------
    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 9).simulate_measurements(0.01).inversion()
    >>> before = 2 * inversion.reduced.evaluate(inversion.start).misfit
    >>> bfgs(inversion.reduced, inversion.start).level.misfit < 0.01 * before
    True
    """
    return _OuterLoop(reduced, policy, callback, seed, "bfgs").run(
        x, lambda objective: _dense_bfgs(objective, max_inner_iterations), max_iterations
    )


def l_bfgs(
    reduced: Reduced,
    x: Array,
    policy: WeightPolicy | None = None,
    callback: Callback = lambda _: None,
    seed: int = 0,
    *,
    max_inner_iterations: int = 50,
    max_iterations: int = MAX_ITERATIONS,
) -> OptimisationResult:
    """Minimise the objective by L-BFGS with the last `MEMORY` steps (scipy), for any n; converges more slowly than `bfgs`.

    Parameters
    ----------
    reduced, x, policy, callback, seed, max_inner_iterations, max_iterations
        As for `bfgs`.

    Returns
    -------
    OptimisationResult

    Raises
    ------
    ConvergenceError
        If no step from `x` lowers J.

    Examples
    --------
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
    return _OuterLoop(reduced, policy, callback, seed, "l-bfgs").run(
        x, lambda objective: _scipy(objective, "L-BFGS-B", options), max_iterations
    )


def newton_cg(
    reduced: Reduced,
    x: Array,
    policy: WeightPolicy | None = None,
    callback: Callback = lambda _: None,
    seed: int = 0,
    *,
    max_inner_iterations: int = 20,
    max_iterations: int = MAX_ITERATIONS,
) -> OptimisationResult:
    """Minimise the objective by trust-region Gauss-Newton-CG (scipy).

    It takes the fewest iterations, with two solves in each of their conjugate-gradient iterations.

    Parameters
    ----------
    reduced, x, policy, callback, seed, max_inner_iterations, max_iterations
        As for `bfgs`.

    Returns
    -------
    OptimisationResult

    Raises
    ------
    ConvergenceError
        If no step from `x` lowers J.

    Examples
    --------
    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 9).simulate_measurements(0.01).inversion()
    >>> newton_cg(inversion.reduced, inversion.start).level.ratio < 1.3
    True
    """
    options = {"maxiter": max_inner_iterations, "gtol": 0.0, "initial_trust_radius": 1.0, "max_trust_radius": 1e6}
    return _OuterLoop(reduced, policy, callback, seed, "newton-cg").run(
        x, lambda objective: _scipy(objective, "trust-ncg", options), max_iterations
    )


class _WhitenedObjective:
    """J in white variables around x₀, with the last point that was evaluated."""

    def __init__(self, reduced: Reduced, x: Array, gain: float) -> None:
        self.reduced, self.origin, self.gain = reduced, x, gain
        self._at, self._point = np.zeros(len(x)), reduced.evaluate(x)
        self.metric = Metric.from_point(self._point)
        self._slope: Array | None = None
        self._solved: tuple[Array, float, Array]

    def point(self, xi: Array) -> Point:
        """Point at ξ; evaluated again if the model has been elsewhere since."""
        if not np.array_equal(xi, self._at):
            self._point = self.reduced.evaluate(self.origin + self.metric.unwhiten(xi))
            self._at, self._slope = np.array(xi), None
        return self._point

    def value(self, xi: Array) -> tuple[float, Array]:
        """J and its gradient with respect to ξ."""
        try:
            point = self.point(xi)
            if self._slope is None:
                self._slope = self.metric.whiten_gradient(point.gradient())
        except SolverError:
            self._at = np.full_like(xi, np.nan)
            return self._beyond_domain(xi)
        self._solved = np.array(xi), point.value, self._slope
        return point.value, self._slope

    def _beyond_domain(self, xi: Array) -> tuple[float, Array]:
        """Substitute where the model has no solution: increases from the last solved point; at that point, its values."""
        last, value, slope = self._solved
        step = xi - last
        if (square := float(step @ step)) < UNDERFLOW:
            return value, slope
        rise = abs(float(slope @ step))
        return value + rise, UPHILL * rise / square * step

    def product(self, xi: Array, direction: Array) -> Array:
        """Gauss-Newton Hessian-vector product with respect to ξ."""
        return self.metric.whiten_gradient(self.point(xi).product(self.metric.unwhiten(direction)))

    def has_converged(self, slope: Array) -> bool:
        """Whether the possible reduction is negligible."""
        return float(slope @ slope) <= self.gain


class _OuterLoop:
    def __init__(
        self, reduced: Reduced, policy: WeightPolicy | None, callback: Callback, seed: int, phase: str
    ) -> None:
        self.reduced, self.phase = reduced, phase
        self.ledger = IterationLog(reduced, policy, callback, seed)

    def run(self, x: Array, down: Callable[[_WhitenedObjective], Array], max_iterations: int) -> OptimisationResult:
        history: list[Iteration] = []
        settled = False
        for _ in range(max_iterations):
            objective = _WhitenedObjective(self.reduced, x, GAIN * self.ledger.misfit.count)
            before, xi = objective.value(np.zeros(len(x)))[0], down(objective)
            moved = objective.metric.unwhiten(xi)
            if not history and not np.any(moved):
                raise ConvergenceError("no step lowers the objective from the initial guess: try another one")
            x = x + moved
            point = self.reduced.evaluate(x)
            curvature = GaussNewtonHessian(point, Metric.from_point(point))
            settled = self.ledger.record(
                self.phase, x, point.state.data, curvature, moved, point.value / before, history
            )
            if settled:
                break
        misfit = 2 * point.misfit
        value, weights = point.misfit + self.reduced.regular(x), dict(self.reduced.weights)
        level = MisfitLevel(misfit, history[-1].expected)
        count, status = self.ledger.misfit.count, convergence_status(settled)
        return OptimisationResult(x, value, level, weights, count, status=status, history=history)


def _scipy(objective: _WhitenedObjective, method: str, options: dict[str, float]) -> Array:
    def stop(intermediate_result: scipy.optimize.OptimizeResult) -> None:
        if objective.has_converged(objective.value(intermediate_result.x)[1]):
            raise StopIteration

    extra = {"hessp": objective.product} if method == "trust-ncg" else {}
    zero = np.zeros(len(objective.origin))
    found = scipy.optimize.minimize(
        objective.value, zero, jac=True, method=method, callback=stop, options=options, **extra
    )
    return np.asarray(found.x)


def _dense_bfgs(objective: _WhitenedObjective, max_inner_iterations: int) -> Array:
    xi = np.zeros(len(objective.origin))
    if objective.has_converged(objective.value(xi)[1]):
        return xi
    for number, lower, _ in bfgs_iterations(objective.value, xi):
        xi = lower
        if number == max_inner_iterations or objective.has_converged(objective.value(xi)[1]):
            break
    return xi


def bfgs_iterations(function: Callable[[Array], tuple[float, Array]], x: Array) -> Iterator[tuple[int, Array, float]]:
    """Iterate BFGS on a function until no step lowers it.

    The update takes n² operations, where scipy's takes n³.

    Parameters
    ----------
    function : callable
        x ↦ value and gradient.
    x : array (n,)
        Initial guess.

    Yields
    ------
    number, x, value : int, array (n,), float
        Iteration number, iterate and its value.

    Examples
    --------
    >>> [round(float(x[0]), 6) for _, x, _ in bfgs_iterations(lambda x: (float(x @ x), 2 * x), np.array([3.0]))][-1]
    0.0
    """
    value, slope = function(x)
    inverse, number = np.eye(len(x)), 0
    while float(slope @ slope) > UNDERFLOW:
        direction = -(inverse @ slope) if number else -slope * min(1.0, 1 / float(np.abs(slope).max()))
        found = line_search(partial(_along_direction, function, x, direction), value, slope, direction)
        if found is None:
            return
        step, value, new = found
        change, bend = step * direction, new - slope
        if not number:  # Oren and Spedicato's scale, once there is a curvature to take it from
            inverse *= float(change @ bend) / float(bend @ bend)
        update_inverse_hessian(inverse, change, bend)
        x, slope, number = x + change, new, number + 1
        yield number, x, value


def _along_direction(
    function: Callable[[Array], tuple[float, Array]], x: Array, direction: Array, step: float
) -> tuple[float, Array]:
    return function(x + step * direction)


def update_inverse_hessian(inverse: Array, change: Array, bend: Array) -> None:
    """BFGS update of the inverse Hessian, in place; skipped where the curvature is not positive.

    Parameters
    ----------
    inverse : array (n, n)
        Inverse Hessian, changed in place.
    change : array (n,)
        Step of x.
    bend : array (n,)
        Change of the gradient along the step.
    """
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
    max_iterations: int = 30,
) -> tuple[float, float, Array] | None:
    """Find a step that satisfies both Wolfe conditions, by bisection and doubling.

    Parameters
    ----------
    along : callable
        Step length ↦ value and gradient.
    value : float
        Value at zero step.
    slope : array (n,)
        Gradient at zero step.
    direction : array (n,)
        Search direction.
    max_iterations : int
        Maximum number of evaluations.

    Returns
    -------
    step, value, gradient : float, float, array (n,)
        None if there is no such step.

    References
    ----------
    Nocedal and Wright 2006, algorithm 3.5, with bisection.

    Examples
    --------
    >>> line_search(lambda a: ((a - 3.0) ** 2, np.array([2 * (a - 3.0)])), 9.0, np.array([-6.0]), np.array([1.0]))[0]
    1.0
    """
    start = float(slope @ direction)
    low, high, step = 0.0, np.inf, 1.0
    for _ in range(max_iterations):
        now, gradient = along(step)
        if not now <= value + ARMIJO * step * start:
            high = step
        elif float(gradient @ direction) < WOLFE * start:
            low = step
        else:
            return step, now, gradient
        step = 2 * step if high == np.inf else 0.5 * (low + high)
    return None
