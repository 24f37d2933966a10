"""Gauss-Newton Hessian H = JᵀWJ + Σ αR of any model by its products, and the metric of the regularisers that preconditions it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ngbrain.adjoint.reduced import Point
from ngbrain.errors import InputError, SolverError
from ngbrain.solvers.krylov import truncated_cg

Array = np.ndarray
TRACE_RTOL, TRACE_ITERATIONS = 1e-3, 200
"""Relative residual and maximum number of iterations of the solves by which traces are estimated."""
FORGETTING = 2.0
"""Factor by which an earlier curvature counts less at each new point. Fits of a small constant converge with 2 and with 4, in 16 to
28 steps; with 16 none does. Four Prony terms take a sixth fewer runs with 2 than with 1.
"""


class Metric:
    """Metric M = Σ αR, completed by the mean diagonal of H for unknowns without a regulariser.

    With M = Lᵀ'L' for a triangular L', the variables ξ = L'(x - x̄) are white: each is expected to be of size one, so that BFGS
    may start from the identity.

    Parameters
    ----------
    matrix : sparse array (n, n)
        M, symmetric positive definite.
    free : array (n,), optional
        Mean diagonal of H for unknowns without a regulariser, zero for the others.

    Raises
    ------
    SolverError
        If M is singular.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> metric = Metric(sp.csr_array(np.array([[4.0, 1.0], [1.0, 9.0]])))
    >>> np.allclose(metric.unwhiten(metric.unwhiten(np.eye(2)).T), metric.solve(np.eye(2)))
    True
    """

    def __init__(self, matrix: sp.csr_array, free: Array | None = None) -> None:
        self.matrix, self.free = matrix, free
        self.loose = np.zeros(matrix.shape[0], bool) if free is None else free > 0
        """Mask of the unknowns without a regulariser."""
        self._factor = _factorise_unpivoted(sp.csc_array(matrix), "MMD_AT_PLUS_A")
        self._order = np.argsort(self._factor.perm_r)
        root = self._factor.L @ sp.diags_array(np.sqrt(self._factor.U.diagonal()))
        self._lower = sp.csr_array(root)
        self._root = _factorise_unpivoted(sp.csc_array(root), "NATURAL")

    @staticmethod
    def from_point(point: Point, before: Metric | None = None) -> Metric:
        """Metric at a point with the current weights; takes one Hessian product per block without a regulariser.

        For these blocks the largest curvature so far is used, reduced by `FORGETTING` at each new point. A parameter that is
        so small that it has no influence then keeps a bounded step.

        Parameters
        ----------
        point : Point
            Point of the reduced objective.
        before : Metric, optional
            Metric of the previous point.

        Returns
        -------
        Metric

        Raises
        ------
        InputError
            If the data do not depend on an unknown without a regulariser.

        References
        ----------
        Scaling by the largest curvature so far, without forgetting: Moré 1978, 10.1007/BFb0067700.
        """
        reduced, free = point.reduced, np.zeros(len(point.x))
        loose = {name: block for name, block in reduced.unknowns.blocks.items() if name not in reduced.regularisers}
        probe = np.random.default_rng(0).choice([-1.0, 1.0], size=len(point.x))
        for name, block in loose.items():
            alone = np.zeros_like(probe)
            alone[block] = probe[block]
            free[block] = float(alone @ point.product(alone)) / (block.stop - block.start)
            if not free[block.start] > 0:
                raise InputError(
                    "unknowns",
                    f"{name}, which the data do not depend on",
                    "unknowns that they depend on, or a regulariser",
                )
        if before is not None and before.free is not None:
            free = np.maximum(free, before.free / FORGETTING)
        return Metric(sp.csr_array(point.regular_matrix + sp.diags_array(free)), free)

    def solve(self, b: Array) -> Array:
        """Solution M⁻¹ b."""
        return self._factor.solve(b)

    def unwhiten(self, xi: Array) -> Array:
        """x - x̄ of the white variables ξ."""
        x = np.empty_like(xi)
        x[self._order] = self._root.solve(xi, trans="T")
        return x

    def colour(self, white: Array) -> Array:
        """Random vector z with covariance M, from one with unit covariance."""
        z = np.empty_like(white)
        z[self._order] = self._lower @ white
        return z

    def whiten_gradient(self, gradient: Array) -> Array:
        """Gradient with respect to ξ from that with respect to x: the transpose of `unwhiten`."""
        return self._root.solve(gradient[self._order])


class GaussNewtonHessian:
    """Gauss-Newton Hessian H at a point, inverted by conjugate gradients with M⁻¹ as preconditioner.

    Nothing is factorised, so that problems may be of any size. Like the point, it is valid until the model moves on.

    Parameters
    ----------
    point : Point
        Point of the reduced objective.
    metric : Metric
        Metric M.
    """

    def __init__(self, point: Point, metric: Metric) -> None:
        self.point, self.metric = point, metric

    def apply(self, x: Array) -> Array:
        """Hessian-vector product H x."""
        return self.point.product(x)

    def solve(
        self, b: Array, damping: float = 0.0, rtol: float = TRACE_RTOL, max_iterations: int = TRACE_ITERATIONS
    ) -> Array:
        """Approximate (H + damping M)⁻¹ b by truncated conjugate gradients; a truncated step is still a descent direction.

        Parameters
        ----------
        b : array (n,)
            Right-hand side.
        damping : float
            Damping λ.
        rtol : float
            Relative residual.
        max_iterations : int
            Maximum number of iterations.

        Returns
        -------
        array (n,)
            The step.
        """

        def damped(x: Array) -> Array:
            return self.apply(x) + damping * (self.metric.matrix @ x)

        return truncated_cg(damped, self.metric.solve, b, rtol, max_iterations)[0]

    def data_share(self, direction: Array) -> float:
        """Share of the data in the curvature along a direction: 1 where it is measured, 0 where it is only assumed.

        Along a whole field it shows what the data leave undetermined: the bulk modulus of nearly incompressible tissue, or the
        common level of all moduli where a body at rest is driven by displacements only.
        """
        assumed, all_of_it = direction @ (self.point.regular_matrix @ direction), direction @ self.apply(direction)
        return float(1 - assumed / all_of_it)

    def effective_parameters(self, random: np.random.Generator) -> float:
        """Effective number of parameters that the data determine, n - tr(Σ αR H⁻¹), estimated with random probes."""
        blocks = self.point.reduced.unknowns.blocks
        regular = {name: self.point.regular_matrix for name in self.point.reduced.regularisers}
        held = self.effective_parameters_by_block({name: blocks[name] for name in regular}, regular, random)
        loose = sum(block.stop - block.start for name, block in blocks.items() if name not in regular)
        return loose + sum(held.values())

    def effective_parameters_by_block(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """Effective number of parameters of each block, with the regularisers of `metric`.

        Parameters
        ----------
        blocks : mapping of str to slice
            Name and place of each block in x.
        regular : mapping of str to sparse array
            Weighted regulariser matrix of each block.
        random : Generator
            Random probes.

        Returns
        -------
        dict of str to float
        """
        # tr(R H⁻¹) = E[z·H⁻¹z] with E[zzᵀ] = R: this symmetric form has a far smaller variance than e·RH⁻¹e with random signs e.
        coloured = self.metric.colour(random.choice([-1.0, 1.0], size=len(self.point.x)))
        found = {}
        for name in regular:
            block, probe = blocks[name], np.zeros_like(coloured)
            probe[block] = coloured[block]
            size = block.stop - block.start
            found[name] = float(np.clip(size - probe @ self.solve(probe), 0.0, size))
        return found


def _factorise_unpivoted(matrix: sp.csc_array, order: str) -> scipy.sparse.linalg.SuperLU:
    try:
        return scipy.sparse.linalg.splu(
            matrix, permc_spec=order, diag_pivot_thresh=0.0, options={"SymmetricMode": True, "Equil": False}
        )
    except RuntimeError as error:
        raise SolverError(
            "neither regularisers nor data determine some unknown at the current iterate; give it a regulariser, or bounds"
        ) from error
