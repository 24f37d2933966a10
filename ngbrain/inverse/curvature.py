"""The Gauss-Newton matrix H = JᵀWJ + Σ αR of any model, known by its products, and the metric that makes them few."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.solvers.krylov import truncated_cg

Array = np.ndarray
ROUGH, MOST = 1e-2, 200
"""Of the solutions by which traces are estimated."""


class Metric:
    """M = Σ αR, and 1 where no regulariser is: how far apart two x are before anything is measured.

    With M = Lᵀ'L' for a triangular L', ξ = L'(x - x̄) are white: all of them are expected to be of size one, so that BFGS may
    start with the identity.

    >>> import scipy.sparse as sp
    >>> metric = Metric(sp.csr_array(np.array([[4.0, 1.0], [1.0, 9.0]])))
    >>> metric.back(metric.back(np.eye(2)).T).round(12).tolist() == metric.solve(np.eye(2)).round(12).tolist()
    True
    """

    def __init__(self, matrix: sp.csr_array) -> None:
        self.matrix = matrix
        self._factor = _without_pivots(sp.csc_array(matrix), "MMD_AT_PLUS_A")
        self._order = np.argsort(self._factor.perm_r)
        root = self._factor.L @ sp.diags_array(np.sqrt(self._factor.U.diagonal()))
        self._root = _without_pivots(sp.csc_array(root), "NATURAL")

    @staticmethod
    def of(reduced: Reduced, x: Array) -> Metric:
        """At x, with the weights as they are."""
        free = np.ones(len(x))
        for name in reduced.regularisers:
            free[reduced.unknowns.blocks[name]] = 0
        return Metric(sp.csr_array(reduced.regular_matrix(x) + sp.diags_array(free)))

    def solve(self, b: Array) -> Array:
        """M⁻¹ b."""
        return self._factor.solve(b)

    def back(self, xi: Array) -> Array:
        """x - x̄ of ξ."""
        x = np.empty_like(xi)
        x[self._order] = self._root.solve(xi, trans="T")
        return x

    def slope(self, gradient: Array) -> Array:
        """The gradient by ξ of the gradient by x: the transpose of `back`."""
        return self._root.solve(gradient[self._order])


class Curvature:
    """H at a point, inverted by conjugate gradients with M⁻¹ as preconditioner: no factor, for problems of any size.

    It has to be asked before the model moves on, as the point has.
    """

    def __init__(self, point: Point, metric: Metric) -> None:
        self.point, self.metric = point, metric

    def apply(self, x: Array) -> Array:
        """H x."""
        return self.point.product(x)

    def solve(self, b: Array, damping: float = 0.0, rtol: float = ROUGH, most: int = MOST) -> Array:
        """(H + damping M)⁻¹ b, or a step on the way there that lowers its energy."""

        def damped(x: Array) -> Array:
            return self.apply(x) + damping * (self.metric.matrix @ x)

        return truncated_cg(damped, self.metric.solve, b, rtol, most)[0]

    def determined(self, random: np.random.Generator) -> float:
        """How many numbers the data determine, n - tr(Σ αR H⁻¹), estimated."""
        size = len(self.point.x)
        probe = random.choice([-1.0, 1.0], size=size)
        left = probe @ (self.point.regular_matrix @ self.solve(probe))
        return float(np.clip(size - left, 0.0, size))

    def determined_of(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """So of each block; R_b with its weight."""
        found = {}
        for name, matrix in regular.items():
            block, probe = blocks[name], np.zeros(len(self.point.x))
            size = block.stop - block.start
            probe[block] = random.choice([-1.0, 1.0], size=size)
            y = self.solve(probe)[block]
            found[name] = float(np.clip(size - probe[block] @ (matrix @ y), 0.0, size))
        return found


def _without_pivots(matrix: sp.csc_array, order: str) -> scipy.sparse.linalg.SuperLU:
    return scipy.sparse.linalg.splu(
        matrix, permc_spec=order, diag_pivot_thresh=0.0, options={"SymmetricMode": True, "Equil": False}
    )
