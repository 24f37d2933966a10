"""The Gauss-Newton matrix H = JᵀWJ + Σ αR of any model, known by its products, and the metric that makes them few."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ngbrain.adjoint.reduced import Point
from ngbrain.errors import InputError, SolverError
from ngbrain.solvers.krylov import truncated_cg

Array = np.ndarray
ROUGH, MOST = 1e-3, 200
"""Of the solutions by which traces are estimated."""
FORGOTTEN = 2.0
"""Fits of a small constant arrive by 2 and by 4, in 16 to 28 steps, by 16 none does; four Prony terms take a sixth fewer runs by 2
than by 1.
"""


class Metric:
    """M = Σ αR, and the mean diagonal of H where no regulariser is: how far apart two x are before anything is measured.

    With M = Lᵀ'L' for a triangular L', ξ = L'(x - x̄) are white: all of them are expected to be of size one, so that BFGS may
    start with the identity.

    >>> import scipy.sparse as sp
    >>> metric = Metric(sp.csr_array(np.array([[4.0, 1.0], [1.0, 9.0]])))
    >>> np.allclose(metric.unwhiten(metric.unwhiten(np.eye(2)).T), metric.solve(np.eye(2)))
    True
    """

    def __init__(self, matrix: sp.csr_array, free: Array | None = None) -> None:
        self.matrix, self.free = matrix, free
        self.loose = np.zeros(matrix.shape[0], bool) if free is None else free > 0
        """Unknowns that no regulariser holds."""
        self._factor = _without_pivots(sp.csc_array(matrix), "MMD_AT_PLUS_A")
        self._order = np.argsort(self._factor.perm_r)
        root = self._factor.L @ sp.diags_array(np.sqrt(self._factor.U.diagonal()))
        self._lower = sp.csr_array(root)
        self._root = _without_pivots(sp.csc_array(root), "NATURAL")

    @staticmethod
    def from_point(point: Point, before: Metric | None = None) -> Metric:
        """At a point, with the weights as they are; by one product where there are unknowns that no regulariser holds.

        Of these the largest so far counts, less by `FORGOTTEN` with each point since, with the metric of a point `before`: one that
        has become so small that it changes nothing is then not drawn on for that (Moré 1978, 10.1007/BFb0067700, without less).
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
                    "unknowns", f"{name}, of which data tell nothing", "those that they tell of, or a regulariser"
                )
        if before is not None and before.free is not None:
            free = np.maximum(free, before.free / FORGOTTEN)
        return Metric(sp.csr_array(point.regular_matrix + sp.diags_array(free)), free)

    def solve(self, b: Array) -> Array:
        """M⁻¹ b."""
        return self._factor.solve(b)

    def unwhiten(self, xi: Array) -> Array:
        """x - x̄ of ξ."""
        x = np.empty_like(xi)
        x[self._order] = self._root.solve(xi, trans="T")
        return x

    def colour(self, white: Array) -> Array:
        """A vector z with E[z zᵀ] = M, of one with E = 1."""
        z = np.empty_like(white)
        z[self._order] = self._lower @ white
        return z

    def whiten_gradient(self, gradient: Array) -> Array:
        """The gradient by ξ of the gradient by x: the transpose of `back`."""
        return self._root.solve(gradient[self._order])


class GaussNewtonHessian:
    """H at a point, inverted by conjugate gradients with M⁻¹ as preconditioner: no factor, for problems of any size.

    It has to be asked before the model moves on, as the point has.
    """

    def __init__(self, point: Point, metric: Metric) -> None:
        self.point, self.metric = point, metric

    def apply(self, x: Array) -> Array:
        """H x."""
        return self.point.product(x)

    def solve(self, b: Array, damping: float = 0.0, rtol: float = ROUGH, max_iterations: int = MOST) -> Array:
        """(H + damping M)⁻¹ b, or a step on the way there that lowers its energy."""

        def damped(x: Array) -> Array:
            return self.apply(x) + damping * (self.metric.matrix @ x)

        return truncated_cg(damped, self.metric.solve, b, rtol, max_iterations)[0]

    def data_share(self, direction: Array) -> float:
        """Of what holds x along a direction, how much is data: 1 where it is measured, 0 where it is merely assumed.

        Asked along a whole field it finds what the data leave open: the bulk modulus of nearly incompressible tissue; the level
        of all moduli where nothing but displacements drives a body at rest.
        """
        assumed, all_of_it = direction @ (self.point.regular_matrix @ direction), direction @ self.apply(direction)
        return float(1 - assumed / all_of_it)

    def effective_parameters(self, random: np.random.Generator) -> float:
        """How many numbers the data determine, n - tr(Σ αR H⁻¹), estimated."""
        blocks = self.point.reduced.unknowns.blocks
        regular = {name: self.point.regular_matrix for name in self.point.reduced.regularisers}
        held = self.effective_parameters_by_block({name: blocks[name] for name in regular}, regular, random)
        loose = sum(block.stop - block.start for name, block in blocks.items() if name not in regular)
        return loose + sum(held.values())

    def effective_parameters_by_block(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """So of each block; the regularisers as they were for `metric`."""
        # tr(R H⁻¹) = E[z·H⁻¹z] with E[zzᵀ] = R: a symmetric form varies far less than e·RH⁻¹e of signs e.
        coloured = self.metric.colour(random.choice([-1.0, 1.0], size=len(self.point.x)))
        found = {}
        for name in regular:
            block, probe = blocks[name], np.zeros_like(coloured)
            probe[block] = coloured[block]
            size = block.stop - block.start
            found[name] = float(np.clip(size - probe @ self.solve(probe), 0.0, size))
        return found


def _without_pivots(matrix: sp.csc_array, order: str) -> scipy.sparse.linalg.SuperLU:
    try:
        return scipy.sparse.linalg.splu(
            matrix, permc_spec=order, diag_pivot_thresh=0.0, options={"SymmetricMode": True, "Equil": False}
        )
    except RuntimeError as error:
        raise SolverError(
            "neither regularisers nor data hold some unknown where the search went; give it a regulariser, or bounds"
        ) from error
