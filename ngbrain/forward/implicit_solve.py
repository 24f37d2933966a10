"""K⁻¹ and K⁻ᵀ of a body's tangent at its state."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ngbrain.errors import SolverError
from ngbrain.forward.loads import Pressure
from ngbrain.forward.static import Static
from ngbrain.solvers.condensed import free as free_of
from ngbrain.solvers.linear import Direct, Iterative, Solve

Array = np.ndarray
TIGHT = 1e-12
"""Where an iterative solver stops: derivatives are as exact as it is."""


class Inverses:
    """Of the tangent at a body's state, made new; of use as long as the body's form is assembled there.

    Raises `SolverError` where the tangent is singular.
    """

    def __init__(self, body: Static) -> None:
        self.symmetric = not any(isinstance(load, Pressure) for load in body.loads)
        try:
            solve = body.tangent()
        except FloatingPointError as error:
            raise SolverError(f"equilibrium has no derivative: {error}") from error
        self.plain, self.solve, self._body, self._form = solve, _refined(solve), body, body._form

    def assemble(self) -> None:
        """Make the form what it was, at the body's state."""
        self._form.AssembleLinearization(self._body.gfu.vec)

    def transposed(self, r: Array) -> Array:
        """K⁻ᵀ r."""
        return self.solve(r) if self.symmetric else self._turned(r)

    @cached_property
    def _turned(self) -> Solve:
        """The same with all of it turned: M⁻¹ = (1 + E) S⁻¹ (1 + E') + D with what condensation leaves, S."""
        form, free = self._form, free_of(self._form)
        unfixed = np.fromiter(form.space.FreeDofs(), bool, len(free))
        inverse = form.mat.Inverse(form.space.FreeDofs(form.condense), inverse="umfpack").T
        vec = form.mat.CreateColVector()

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


def _refined(solve: Solve) -> Solve:
    """The same to the last digits: a factor without pivots, or with a pressure, leaves some of them to one refinement."""
    if isinstance(solve, Iterative):
        return replace(solve, rtol=TIGHT)
    if not isinstance(solve, Direct):
        return solve
    condensed, core = solve.condensed, solve.core

    def twice(r: Array) -> Array:
        x = core(r)
        return x + core(r * condensed.free - condensed.apply(x))

    return lambda r: condensed.solve(twice, r)
