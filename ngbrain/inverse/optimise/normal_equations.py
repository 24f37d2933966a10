"""One Gauss-Newton step in the fields alone, by conjugate gradients: for problems in space, whose factors fill the memory.

The matrix H = JᵀWJ + Σ α R is never formed: a product takes two solves for each load with the factor of the waves. See
`blocks` for what it is preconditioned with.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp

from ngbrain.adjoint.reduced import Point
from ngbrain.errors import SolverError
from ngbrain.inverse.optimise.preconditioners import (
    BoundaryExtensionPreconditioner,
    block_preconditioner,
    diagonal_block_inverses,
    factorise_quasidefinite,
)
from ngbrain.solvers.krylov import truncated_cg
from ngbrain.solvers.quasi_newton_preconditioner import QuasiNewtonPreconditioner

Array = np.ndarray
FORCING = 0.03
"""Residual of a step, in the norm of the preconditioner, as a part of its start."""
PROBED = 0.03
"""The same of a sample that counts what data determine."""
MOST, MOST_PROBED = 40, 60
"""Iterations at most, of a step and of a sample: a truncated step still goes down, and what 40 leave is a few hundredths of what it
can lower. A truncated sample counts too much: in a block of 4 cm whose boundary is unknown, 60 give 1.5 to 1.7 times the number,
90 give 1.2 to 1.3 times."""
GROUND = 1e-9
"""Of its diagonal, what is added to a regulariser that leaves something free, to draw from it."""


class NormalEquations:
    """The normal equations around a point.

    counted         list that the iterations of each solve are added to
    forcing, most   where conjugate gradients stop
    directions      of solves around points near by, which make these shorter; it learns from these too
    extensions      preconditioners of held displacements, where they are made already
    """

    def __init__(
        self,
        point: Point,
        counted: list[int] | None = None,
        forcing: float = FORCING,
        max_cg_iterations: int = MOST,
        directions: QuasiNewtonPreconditioner | None = None,
        extensions: BoundaryExtensionPreconditioner | None = None,
    ) -> None:
        self.point, self.forcing, self.max_cg_iterations = point, forcing, max_cg_iterations
        self.directions = QuasiNewtonPreconditioner() if directions is None else directions
        self.iterations: list[int] = [] if counted is None else counted
        self._drawn: tuple[float, dict[str, float]] | None = None
        self._regular = point.reduced.regular_matrix(point.x)
        self._jacobian = point.reduced.unknowns.jacobian(point.x)
        self.precondition = block_preconditioner(
            diagonal_block_inverses(point, extensions or BoundaryExtensionPreconditioner()), point.reduced
        )

    def product(self, direction: Array) -> Array:
        """H times a direction."""
        state = self.point.state
        change = state.jvp(self._jacobian @ direction)
        back = state.vjp(self.point.reduced.misfit.gauss_newton_product(state.data, change))
        return self._jacobian.T @ back + self._regular @ direction

    def gradient(self) -> Array:
        """∇J, by the matrices that products use."""
        reduced, state = self.point.reduced, self.point.state
        slope = state.vjp(reduced.misfit.gradient(state.data))
        return self._jacobian.T @ slope + reduced.regular_gradient(self.point.x)

    def solve(self, b: Array, forcing: float | None = None, max_cg_iterations: int | None = None) -> Array:
        """About H⁻¹ b; `SolverError` where H or its preconditioner is not positive definite."""
        forcing, max_cg_iterations = forcing or self.forcing, max_cg_iterations or self.max_cg_iterations
        precondition = self.directions.correct(self.precondition, lambda s: self._regular @ s)

        def learn(s: Array, image: Array) -> None:
            self.directions.add(s, image - self._regular @ s)

        try:
            x, iterations, _ = truncated_cg(self.product, precondition, b, forcing, max_cg_iterations, learn)
        except FloatingPointError as error:
            raise SolverError(f"the normal equations cannot be solved: {error}") from error
        self.iterations.append(iterations)
        return x

    def effective_parameters(self, random: np.random.Generator) -> float:
        """How many of the real data the unknowns use up, tr (H⁻¹ Jᵀ W J), by the sample of `determined_of`."""
        return self._sample(random)[0]

    def effective_parameters_by_block(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """For each block how many of its numbers the data determine, tr (1 - α R H⁻¹) of the block, all by one solve.

        A field w that the regulariser takes for likely, with covariance (αR)⁻¹, and noise ξ of the data are inverted together:
        x̂ = w - H⁻¹(αRw - Jᵀ√W ξ). Its energy x̂·αRx̂ is right in the mean, and right within its root when the number is large.
        What the noise does to held displacements, a hundred times the fields' share, does not enter. Iterations that are cut
        short leave too much of w, and count too much. The first call draws; later ones tell the same sample.
        """
        known = self._sample(random)[1]
        return {name: known[name] for name in regular}

    def _sample(self, random: np.random.Generator) -> tuple[float, dict[str, float]]:
        """Numbers of all data that are used up, and block → numbers determined; drawn once."""
        if self._drawn is not None:
            return self._drawn
        reduced, state = self.point.reduced, self.point.state
        blocks = {name: reduced.unknowns.blocks[name] for name in reduced.regularisers}
        root = np.sqrt(reduced.misfit.weight(state.data))  # type: ignore[attr-defined]
        noise = root * (random.normal(size=root.shape) + 1j * random.normal(size=root.shape))
        told = self._jacobian.T @ state.vjp(noise)
        likely, asked = np.zeros_like(told), -told
        for block in blocks.values():
            drawn, likely[block] = sample_prior_field(self._regular[block, block], random)
            asked[block] += drawn
        left = self.solve(asked, PROBED, MOST_PROBED)
        found, known = likely - left, {}
        for name, block in blocks.items():
            energy = found[block] @ (self._regular[block, block] @ found[block])
            known[name] = float(np.clip(energy, 0.0, block.stop - block.start))
        self._drawn = float(np.clip(-told @ left, 0.0, len(told))), known
        return self._drawn


def sample_prior_field(matrix: sp.csr_array, random: np.random.Generator) -> tuple[Array, Array]:
    """A w, drawn with the covariance A⁻¹ of a sparse positive (semi)definite matrix A, after A w."""
    factor = factorise_quasidefinite(sp.csc_array(matrix + GROUND * sp.diags_array(matrix.diagonal())))
    pivots = factor.U.diagonal()
    white = np.sqrt(pivots) * random.normal(size=len(pivots))
    drawn = (factor.L @ white)[factor.perm_r]
    return drawn, factor.solve(drawn)
