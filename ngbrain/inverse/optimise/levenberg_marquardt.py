"""Levenberg's and Marquardt's steps on the reduced objective: Gauss-Newton with a damping that its own success steers.

A step solves (H + λM) δ = -∇J with H = JᵀWJ + Σ αR and M the regularisers' metric, so that damping means the same on every mesh
and for moduli of any size. With ρ the fall of J over the fall that H foretells, λ → λ max(1/3, 1 - (2ρ - 1)³) after a step
that falls, and λ → 2λ, 4λ, 8λ … after one that does not.

Sources: Marquardt 1963, 10.1137/0111030; Nielsen 1999, Damping parameter in Marquardt's method (IMM-REP-1999-05).
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
from ngbrain.inverse.optimise.result import SETTLED, Iteration, IterationLog, OptimisationResult, convergence_status

Array = np.ndarray
DENSE = 2000
"""Unknowns up to which the Jacobian is a matrix."""
FIRST, LIGHT = 1.0, 0.1
"""Damping to begin with: in this metric as much as all regularisers; and a tenth of the mean curvature where none holds some
unknown, whose steps are bounded anyway (relaxing bodies: 6 Jacobians for 9 and 17 for 18; by .01 the same)."""
SHORT, MAX_CHANGE = 1.0, 3.0
"""A step changes no unknown by more than the second, of logarithms a factor of 20, and one that no regulariser holds at first by no
more than the other, a factor of e: else one of which data tell little is lost at once, and they tell nothing of it from there."""
HEAVY = 1e12
MAX_ITERATIONS = 60
ROUGH, MOST = 0.01, 200
"""Of steps by conjugate gradients."""
NOTHING = 1e-9


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
    """From x down, the weights changed by `policy` after every step that falls.

    dense  unknowns up to which H is a matrix (one solve for each of them and each load); beyond, conjugate gradients
    first  damping to begin with (None: `FIRST`, or `LIGHT` where no regulariser holds some unknown); hardly any: steps of Gauss
           and Newton, damped where one does not lower J

    Raises `ConvergenceError` when no step from x lowers J.

    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 9).simulate_measurements(0.01).inversion()
    >>> found = levenberg_marquardt(inversion.reduced, inversion.start)
    >>> found.converged and found.level.ratio < 1.3
    True
    """
    ledger = IterationLog(reduced, policy, callback, seed)
    history: list[Iteration] = []
    point, settled, stuck, longest = reduced.evaluate(x), False, False, SHORT
    metric = Metric.from_point(point)
    damping = initial_damping if initial_damping is not None else LIGHT if metric.loose.any() else FIRST
    for step_number in range(max_iterations):
        metric = Metric.from_point(point, metric) if step_number else metric
        H: GaussNewtonHessian = (
            DenseGaussNewtonHessian(point, metric) if len(x) <= max_dense else GaussNewtonHessian(point, metric)
        )
        gradient = point.gradient()
        growth = 2.0
        while damping < HEAVY:
            step = -H.solve(gradient, damping, ROUGH, MOST)
            size = float(np.max(np.abs(step[metric.loose]), initial=0.0))
            if not (size <= longest and np.abs(step).max() <= MAX_CHANGE):  # beyond what second order can foretell
                damping, growth = damping * growth, 2 * growth
                continue
            foretold = -float(step @ gradient) - 0.5 * float(step @ H.apply(step))
            lower = _tried(reduced, point.x + step)
            fall = point.value - lower.value if lower is not None else -np.inf
            if fall > 0 or abs(fall) <= NOTHING * point.value:
                longer = (
                    1 + damping
                )  # times as long, at most, a step without damping would be: a short one is no end yet
                rho = min(1.0, fall / max(foretold, 1e-300))  # foretold may be nothing
                damping *= max(1 / 3, 1 - (2 * rho - 1) ** 3) if fall > 0 else 1.0
                longest = next_step_bound(longest, size, rho)
                break
            damping, growth = damping * growth, 2 * growth
        else:
            stuck = True
            break
        assert lower is not None
        H = DenseGaussNewtonHessian(lower, metric) if len(x) <= max_dense else GaussNewtonHessian(lower, metric)
        settled = ledger.enter("levenberg-marquardt", lower.x, lower.state.data, H, step, 1.0, history)
        settled = settled and longer * history[-1].change < 10 * SETTLED
        point = Point(reduced, lower.x, lower.state)  # at the new weights
        if settled:
            break
    if not history:
        raise ConvergenceError("no step lowers the objective from where it starts: try another start")
    level = MisfitLevel(2 * point.misfit, history[-1].expected)
    status, weights = convergence_status(settled, stuck), dict(reduced.weights)
    return OptimisationResult(point.x, point.value, level, weights, ledger.misfit.count, status=status, history=history)


def next_step_bound(longest: float, size: float, gain: float) -> float:
    """The bound of the next step: twice as much where a step that came near it fell as foretold, half where it fell far less.

    >>> next_step_bound(1.0, 0.9, 0.95), next_step_bound(2.0, 1.6, 0.1), next_step_bound(1.0, 0.2, 0.95)
    (2.0, 0.8, 1.0)
    """
    if gain < 0.25:
        return max(size / 2, 1e-3)
    return min(2 * longest, MAX_CHANGE) if gain > 0.75 and size > longest / 2 else longest


class DenseGaussNewtonHessian(GaussNewtonHessian):
    """H as a matrix: exact traces, and any damping for one more Cholesky factor."""

    def __init__(self, point: Point, metric: Metric) -> None:
        super().__init__(point, metric)
        misfit, state = point.reduced.misfit, point.state
        columns = [state.jvp(np.asarray(point.jacobian[:, [i]].todense()).ravel()) for i in range(len(point.x))]
        changes = np.array([c.ravel() for c in columns])
        bent = np.array([misfit.gauss_newton_product(state.data, c).ravel() for c in columns])
        data = changes.real @ bent.real.T + changes.imag @ bent.imag.T
        self.matrix = data + point.regular_matrix.toarray()

    def apply(self, x: Array) -> Array:
        """H x."""
        return self.matrix @ x

    def solve(self, b: Array, damping: float = 0.0, rtol: float = 0.0, max_iterations: int = 0) -> Array:
        """(H + damping M)⁻¹ b, to the last digits."""
        return scipy.linalg.solve(self.matrix + damping * self.metric.matrix.toarray(), b, assume_a="pos")

    def effective_parameters(self, random: np.random.Generator) -> float:
        """n - tr(Σ αR H⁻¹), n less what neither data nor regularisers hold."""
        inverse, free = self._inverse
        return float(len(inverse) - free - (self.point.regular_matrix @ inverse).trace())

    def effective_parameters_by_block(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """So of each block."""
        inverse, _ = self._inverse
        return {
            name: float(matrix.shape[0] - (matrix @ inverse[blocks[name], blocks[name]]).trace())
            for name, matrix in regular.items()
        }

    @cached_property
    def _inverse(self) -> tuple[Array, int]:
        """H⁻¹ where it is held, and along how many directions it is not."""
        try:
            return np.linalg.inv(self.matrix), 0
        except np.linalg.LinAlgError:  # at some trial data say nothing of a number that nothing else holds
            held = int(np.linalg.matrix_rank(self.matrix, hermitian=True))
            return np.linalg.pinv(self.matrix, hermitian=True), len(self.matrix) - held


def _tried(reduced: Reduced, x: Array) -> Point | None:
    try:
        return reduced.evaluate(x)
    except SolverError:
        return None
