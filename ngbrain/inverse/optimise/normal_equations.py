"""Gauss-Newton step in the fields alone by conjugate gradients, for 3-D problems whose factors fill the memory.

The Hessian H = JᵀWJ + Σ αR is never assembled: a product takes two solves per load with the factor of the wave operator. See
`preconditioners` for its preconditioner.
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
"""Relative residual of a step, in the norm of the preconditioner."""
PROBE_RTOL = 0.03
"""Relative residual of a sample that estimates the effective number of parameters."""
MAX_CG_ITERATIONS, MAX_PROBE_ITERATIONS = 40, 60
"""Maximum number of iterations of a step and of a sample. A truncated step is still a descent direction, and what 40 iterations
leave is a few hundredths of the possible reduction. A truncated sample overestimates: in a block of 4 cm with unknown boundary
displacements, 60 iterations give 1.5 to 1.7 times the number, 90 give 1.2 to 1.3 times.
"""
GROUND = 1e-9
"""Share of the diagonal that is added to a singular regulariser to draw samples from it."""


class NormalEquations:
    """Gauss-Newton normal equations at a point.

    Parameters
    ----------
    point : Point
        Point of the reduced objective.
    counted : list of int, optional
        List to which the iterations of each solve are appended.
    forcing : float
        Relative residual at which conjugate gradients stop.
    max_cg_iterations : int
        Maximum number of iterations.
    directions : QuasiNewtonPreconditioner, optional
        Search directions of solves at nearby points, which improve the preconditioner; new ones are added.
    extensions : BoundaryExtensionPreconditioner, optional
        Preconditioner of the boundary displacements, where it exists already.
    """

    def __init__(
        self,
        point: Point,
        counted: list[int] | None = None,
        forcing: float = FORCING,
        max_cg_iterations: int = MAX_CG_ITERATIONS,
        directions: QuasiNewtonPreconditioner | None = None,
        extensions: BoundaryExtensionPreconditioner | None = None,
    ) -> None:
        self.point, self.forcing, self.max_cg_iterations = point, forcing, max_cg_iterations
        self.directions = QuasiNewtonPreconditioner() if directions is None else directions
        self.iterations: list[int] = [] if counted is None else counted
        self._cached: tuple[float, dict[str, float]] | None = None
        self._regular = point.reduced.regular_matrix(point.x)
        self._jacobian = point.reduced.unknowns.jacobian(point.x)
        self.precondition = block_preconditioner(
            diagonal_block_inverses(point, extensions or BoundaryExtensionPreconditioner()), point.reduced
        )

    def product(self, direction: Array) -> Array:
        """Hessian-vector product H δx."""
        state = self.point.state
        change = state.jvp(self._jacobian @ direction)
        back = state.vjp(self.point.reduced.misfit.gauss_newton_product(state.data, change))
        return self._jacobian.T @ back + self._regular @ direction

    def gradient(self) -> Array:
        """Gradient ∇J, by the same matrices as the products."""
        reduced, state = self.point.reduced, self.point.state
        slope = state.vjp(reduced.misfit.gradient(state.data))
        return self._jacobian.T @ slope + reduced.regular_gradient(self.point.x)

    def solve(self, b: Array, forcing: float | None = None, max_cg_iterations: int | None = None) -> Array:
        """Approximate H⁻¹ b by preconditioned conjugate gradients.

        Parameters
        ----------
        b : array (n,)
            Right-hand side.
        forcing : float, optional
            Relative residual.
        max_cg_iterations : int, optional
            Maximum number of iterations.

        Returns
        -------
        array (n,)

        Raises
        ------
        SolverError
            If H or its preconditioner is not positive definite.
        """
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
        """Effective number of real data that the unknowns use up, tr(H⁻¹JᵀWJ), from one sample."""
        return self._sample(random)[0]

    def effective_parameters_by_block(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """Effective number of parameters of each block, tr(1 - αR H⁻¹) of the block, for all blocks by one solve.

        A field w drawn from the prior, with covariance (αR)⁻¹, and noise ξ of the data are inverted together:
        x̂ = w - H⁻¹(αRw - Jᵀ√W ξ). The energy x̂·αRx̂ is an unbiased estimate with a standard error of the square root of the
        number. The effect of noise on the boundary displacements, a hundred times that on the fields, does not enter. Truncated
        iterations retain too much of w and overestimate. The sample is drawn once per point.

        Parameters
        ----------
        blocks : mapping of str to slice
            Name and place of each block in x.
        regular : mapping of str to sparse array
            Weighted regulariser matrix of each block; only its keys are used.
        random : Generator
            Random numbers of the sample.

        Returns
        -------
        dict of str to float
        """
        known = self._sample(random)[1]
        return {name: known[name] for name in regular}

    def _sample(self, random: np.random.Generator) -> tuple[float, dict[str, float]]:
        """Effective numbers of all data and of each block, from one sample; computed once."""
        if self._cached is not None:
            return self._cached
        reduced, state = self.point.reduced, self.point.state
        blocks = {name: reduced.unknowns.blocks[name] for name in reduced.regularisers}
        root = np.sqrt(reduced.misfit.weight(state.data))  # type: ignore[attr-defined]
        noise = root * (random.normal(size=root.shape) + 1j * random.normal(size=root.shape))
        noise_gradient = self._jacobian.T @ state.vjp(noise)
        sample, right_side = np.zeros_like(noise_gradient), -noise_gradient
        for block in blocks.values():
            drawn, sample[block] = sample_prior_field(self._regular[block, block], random)
            right_side[block] += drawn
        correction = self.solve(right_side, PROBE_RTOL, MAX_PROBE_ITERATIONS)
        found, known = sample - correction, {}
        for name, block in blocks.items():
            energy = found[block] @ (self._regular[block, block] @ found[block])
            known[name] = float(np.clip(energy, 0.0, block.stop - block.start))
        self._cached = float(np.clip(-noise_gradient @ correction, 0.0, len(noise_gradient))), known
        return self._cached


def sample_prior_field(matrix: sp.csr_array, random: np.random.Generator) -> tuple[Array, Array]:
    """Draw w with covariance A⁻¹.

    Parameters
    ----------
    matrix : sparse array (n, n)
        A, symmetric positive (semi-)definite.
    random : Generator
        Random numbers.

    Returns
    -------
    image : array (n,)
        A w.
    sample : array (n,)
        w.
    """
    factor = factorise_quasidefinite(sp.csc_array(matrix + GROUND * sp.diags_array(matrix.diagonal())))
    pivots = factor.U.diagonal()
    white = np.sqrt(pivots) * random.normal(size=len(pivots))
    drawn = (factor.L @ white)[factor.perm_r]
    return drawn, factor.solve(drawn)
