"""Levenberg-Marquardt on the reduced objective: Gauss-Newton with adaptive damping.

A step solves (H + λM) δ = -∇J with H = JᵀWJ + Σ αR and M the metric of the regularisers, so that the damping is independent of
the mesh and of the size of the moduli. With ρ the ratio of actual to predicted reduction of J, λ → λ max(1/3, 1 - (2ρ - 1)³)
after a successful step, and λ → 2λ, 4λ, 8λ … after a failed one.

References
----------
Marquardt 1963, 10.1137/0111030; Nielsen 1999, Damping parameter in Marquardt's method (IMM-REP-1999-05).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.errors import ConvergenceError, SolverError
from ngbrain.inverse.optimise.gauss_newton_hessian import GaussNewtonHessian, Metric
from ngbrain.inverse.optimise.regularisation_weight import MisfitLevel, WeightPolicy
from ngbrain.inverse.optimise.result import (
    CONVERGED_CHANGE,
    Iteration,
    IterationLog,
    OptimisationResult,
    convergence_status,
)

Array = np.ndarray
DENSE = 2000
"""Number of unknowns up to which the Jacobian is a dense matrix."""
INITIAL_DAMPING, LIGHT_DAMPING = 1.0, 0.1
"""Initial damping: in this metric as much as all regularisers; and a tenth of the mean curvature where some unknown has no
regulariser, whose steps are bounded anyway (relaxing bodies: 6 Jacobians for 9 and 17 for 18; the same with 0.01).
"""
INITIAL_MAX_CHANGE, MAX_CHANGE = 1.0, 3.0
"""A step changes no unknown by more than the second value, for logarithms a factor of 20. Unknowns without a regulariser initially
change by no more than the first, a factor of e: otherwise a parameter that the data hardly determine is lost at once, at values
where the data no longer depend on it.
"""
MAX_DAMPING = 1e12
MAX_ITERATIONS = 60
CG_RTOL, MAX_CG_ITERATIONS = 0.01, 200
"""Relative residual and maximum number of iterations of steps by conjugate gradients."""
ROUND_OFF = 1e-9


def levenberg_marquardt(
    reduced: Reduced,
    x: Array,
    policy: WeightPolicy | None = None,
    callback: Callable[[Iteration], None] = lambda _: None,
    seed: int = 0,
    *,
    max_dense: int = DENSE,
    max_iterations: int = MAX_ITERATIONS,
    initial_damping: float | None = None,
) -> OptimisationResult:
    """Minimise the objective by Levenberg-Marquardt; the policy updates the weights after every successful step.

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
    max_dense : int
        Number of unknowns up to which H is a dense matrix (one solve per unknown and load); beyond, conjugate gradients.
    max_iterations : int
        Maximum number of iterations.
    initial_damping : float, optional
        Initial damping. Default `INITIAL_DAMPING`, or `LIGHT_DAMPING` where some unknown has no regulariser. With a tiny value
        the steps are those of Gauss-Newton, damped where one does not lower J.

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
    >>> found = levenberg_marquardt(inversion.reduced, inversion.start)
    >>> found.converged and found.level.ratio < 1.3
    True
    """
    ledger = IterationLog(reduced, policy, callback, seed)
    history: list[Iteration] = []
    point, settled, stalled, longest = reduced.evaluate(x), False, False, INITIAL_MAX_CHANGE
    metric = Metric.from_point(point)
    damping = (
        initial_damping if initial_damping is not None else LIGHT_DAMPING if metric.loose.any() else INITIAL_DAMPING
    )
    for step_number in range(max_iterations):
        metric = Metric.from_point(point, metric) if step_number else metric
        H: GaussNewtonHessian = (
            DenseGaussNewtonHessian(point, metric) if len(x) <= max_dense else GaussNewtonHessian(point, metric)
        )
        gradient = point.gradient()
        growth = 2.0
        while damping < MAX_DAMPING:
            step = -H.solve(gradient, damping, CG_RTOL, MAX_CG_ITERATIONS)
            size = float(np.max(np.abs(step[metric.loose]), initial=0.0))
            if not (size <= longest and np.abs(step).max() <= MAX_CHANGE):  # beyond the range of the quadratic model
                damping, growth = damping * growth, 2 * growth
                continue
            predicted = -float(step @ gradient) - 0.5 * float(step @ H.apply(step))
            lower = _evaluate(reduced, point.x + step)
            fall = point.value - lower.value if lower is not None else -np.inf
            if fall > 0 or abs(fall) <= ROUND_OFF * point.value:
                stretch = (
                    1 + damping
                )  # an undamped step is at most so many times as long: a short step is no convergence yet
                rho = min(1.0, fall / max(predicted, 1e-300))  # the prediction may be zero
                damping *= max(1 / 3, 1 - (2 * rho - 1) ** 3) if fall > 0 else 1.0
                longest = next_step_bound(longest, size, rho)
                break
            damping, growth = damping * growth, 2 * growth
        else:
            stalled = True
            break
        assert lower is not None
        H = DenseGaussNewtonHessian(lower, metric) if len(x) <= max_dense else GaussNewtonHessian(lower, metric)
        settled = ledger.record("levenberg-marquardt", lower.x, lower.state.data, H, step, 1.0, history)
        settled = settled and stretch * history[-1].change < 10 * CONVERGED_CHANGE
        point = Point(reduced, lower.x, lower.state)  # with the new weights
        if settled:
            break
    if not history:
        raise ConvergenceError("no step lowers the objective from the initial guess: try another one")
    level = MisfitLevel(2 * point.misfit, history[-1].expected)
    status, weights = convergence_status(settled, stalled), dict(reduced.weights)
    return OptimisationResult(point.x, point.value, level, weights, ledger.misfit.count, status=status, history=history)


def next_step_bound(longest: float, size: float, gain: float) -> float:
    """Bound of the next step: doubled after a step near the bound whose reduction was as predicted, halved after a poor one.

    Parameters
    ----------
    longest : float
        Current bound.
    size : float
        Largest change of an unknown in the step.
    gain : float
        Ratio of actual to predicted reduction.

    Returns
    -------
    float

    Examples
    --------
    >>> next_step_bound(1.0, 0.9, 0.95), next_step_bound(2.0, 1.6, 0.1), next_step_bound(1.0, 0.2, 0.95)
    (2.0, 0.8, 1.0)
    """
    if gain < 0.25:
        return max(size / 2, 1e-3)
    return min(2 * longest, MAX_CHANGE) if gain > 0.75 and size > longest / 2 else longest


class DenseGaussNewtonHessian(GaussNewtonHessian):
    """Gauss-Newton Hessian as a dense matrix: exact traces, and any damping for one Cholesky factorisation.

    Parameters
    ----------
    point : Point
        Point of the reduced objective.
    metric : Metric
        Metric M.
    """

    def __init__(self, point: Point, metric: Metric) -> None:
        super().__init__(point, metric)
        misfit, state = point.reduced.misfit, point.state
        columns = [state.jvp(np.asarray(point.jacobian[:, [i]].todense()).ravel()) for i in range(len(point.x))]
        changes = np.array([c.ravel() for c in columns])
        weighted = np.array([misfit.gauss_newton_product(state.data, c).ravel() for c in columns])
        data = changes.real @ weighted.real.T + changes.imag @ weighted.imag.T
        self.matrix = data + point.regular_matrix.toarray()

    def apply(self, x: Array) -> Array:
        """Hessian-vector product H x."""
        return self.matrix @ x

    def solve(self, b: Array, damping: float = 0.0, rtol: float = 0.0, max_iterations: int = 0) -> Array:
        """Solution (H + damping M)⁻¹ b by a direct solver; the tolerances are ignored.

        Parameters
        ----------
        b : array (n,)
            Right-hand side.
        damping : float
            Damping λ.
        rtol, max_iterations : float, int
            Not used.

        Returns
        -------
        array (n,)
        """
        return scipy.linalg.solve(self.matrix + damping * self.metric.matrix.toarray(), b, assume_a="pos")

    def effective_parameters(self, random: np.random.Generator) -> float:
        """Effective number of parameters n - tr(Σ αR H⁻¹), less those that neither data nor regularisers determine."""
        inverse, free = self._inverse
        return float(len(inverse) - free - (self.point.regular_matrix @ inverse).trace())

    def effective_parameters_by_block(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """Effective number of parameters of each block, exact.

        Parameters
        ----------
        blocks : mapping of str to slice
            Name and place of each block in x.
        regular : mapping of str to sparse array
            Weighted regulariser matrix of each block.
        random : Generator
            Not used.

        Returns
        -------
        dict of str to float
        """
        inverse, _ = self._inverse
        return {
            name: float(matrix.shape[0] - (matrix @ inverse[blocks[name], blocks[name]]).trace())
            for name, matrix in regular.items()
        }

    @cached_property
    def _inverse(self) -> tuple[Array, int]:
        """(Pseudo-)inverse of H, and the dimension of its null space."""
        try:
            return np.linalg.inv(self.matrix), 0
        except np.linalg.LinAlgError:  # the data do not depend on a parameter without a regulariser at some trial
            rank = int(np.linalg.matrix_rank(self.matrix, hermitian=True))
            return np.linalg.pinv(self.matrix, hermitian=True), len(self.matrix) - rank


def _evaluate(reduced: Reduced, x: Array) -> Point | None:
    try:
        return reduced.evaluate(x)
    except SolverError:
        return None
