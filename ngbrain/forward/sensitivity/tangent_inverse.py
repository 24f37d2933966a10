"""Solves with the tangent stiffness K of a body at equilibrium, and with its transpose."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ngbrain.errors import SolverError
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.solid.problem import Problem
from ngbrain.solvers import linear
from ngbrain.solvers.condensed import free as free_of
from ngbrain.solvers.linear import DirectSolver, KrylovSolver, Solve

Array = np.ndarray
TIGHT = 1e-11
"""Relative tolerance of iterative solvers: derivatives are as accurate as these solves."""
FEW, AT_MOST = 2, 20
"""In 3-D displacement forms: number of solves preconditioned by Newton's last factorisation before a new one is made, and
iterations of each. Measured with 14 739 unknowns: 6 to 11 iterations, half the time of a factorisation. With pressures it takes
more than 20."""


class TangentInverse:
    """K⁻¹ and K⁻ᵀ at a body's state, valid as long as the body's form is assembled there.

    Parameters
    ----------
    body : Problem
        The body, at equilibrium.
    solves : Solves
        Counter of factorisations.
    quadratic : bool
        Whether the tangent is the same at all states. The factor of Newton's method is then reused.

    Raises
    ------
    SolverError
        By the solves, where the tangent is singular.
    """

    def __init__(self, body: Problem, solves: Solves, quadratic: bool) -> None:
        self.body, self._form, self._solves = body, body.form, solves
        self._symmetric = body.symmetric
        worth = self._symmetric and (quadratic or (body.mesh.dim == 3 and body.element.pressure is None))
        self._old = body.last_factor if worth else None
        self._few = FEW
        self.factor = self._old if quadratic and body.factored else None
        """The factorisation, once computed."""
        if not (quadratic and body.assembled):
            self.assemble()

    def assemble(self) -> None:
        """Assemble the form at the body's state again."""
        self._form.AssembleLinearization(self.body.gfu.vec)

    def solve(self, r: Array) -> Array:
        """K⁻¹ r."""
        if self.factor is None and self._old is not None and self._few:
            self._few -= 1
            if solve := linear.reuse_factor(self._form, self._old, r, TIGHT, AT_MOST):
                return solve(r)
        return self._refined(r)

    def solve_transpose(self, r: Array) -> Array:
        """K⁻ᵀ r."""
        return self.solve(r) if self._symmetric else self._transposed_solver(r)

    @cached_property
    def _refined(self) -> Solve:
        """Solve with one step of iterative refinement, which a factor without pivoting or with a pressure needs."""
        solve = self.factor = self.factor or self._made()
        if isinstance(solve, KrylovSolver):
            return replace(solve, rtol=TIGHT)
        if not isinstance(solve, DirectSolver):
            return solve
        condensed, core = solve.condensed, solve.core

        def twice(r: Array) -> Array:
            x = core(r)
            return x + core(r * condensed.free - condensed.apply(x))

        return lambda r: condensed.solve(twice, r)

    def _made(self) -> Solve:
        self._solves.factorisations += 1
        try:
            return self.body.new_factor()
        except FloatingPointError:
            return self._with_pivots()

    def _with_pivots(self) -> Solve:
        try:
            return linear.prepare("umfpack", self._form)()
        except FloatingPointError as error:
            raise SolverError(f"the equilibrium has no derivative: {error}") from error

    @cached_property
    def _transposed_solver(self) -> Solve:
        """Transpose of static condensation, M⁻¹ = (1 + E) S⁻¹ (1 + E') + D with the condensed matrix S."""
        form, free = self._form, free_of(self._form)
        unfixed = np.fromiter(form.space.FreeDofs(), bool, len(free))
        inverse = form.mat.Inverse(form.space.FreeDofs(form.condense), inverse="umfpack").T
        vec = form.mat.CreateColVector()
        self._solves.factorisations += 1

        def times(matrix: ngs.BaseMatrix, x: Array) -> Array:
            vec.FV().NumPy()[:] = x
            return np.array((matrix * vec).Evaluate().FV().NumPy())

        def solve(r: Array) -> Array:
            r = r * unfixed
            if not form.condense:
                return times(inverse, r) * free
            x = times(inverse, (r + times(form.harmonic_extension.T, r)) * free) * free
            return (x + times(form.harmonic_extension_trans.T, x) + times(form.inner_solve.T, r)) * unfixed

        return solve
