"""An assembled form as a map of arrays, with static condensation around a solver for what it leaves."""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ngs
import numpy as np

Array = np.ndarray
Core = Callable[[Array], Array]
"""r ↦ S⁻¹r over all unknowns, with S the matrix on those that condensation leaves; zero on the others."""


class Condensed:
    """The matrix S of an assembled form on the unknowns that static condensation leaves (all of them without it).

    free   which unknowns S is to be solved for
    fields slices of the unknowns of each field
    """

    def __init__(self, form: ngs.BilinearForm) -> None:
        self.form, self.matrix = form, form.mat
        self.free, self._condense = free(form), form.condense
        self.fields = fields(form.space)
        self._x, self._y = self.matrix.CreateRowVector(), self.matrix.CreateColVector()
        self._unfixed = np.fromiter(form.space.FreeDofs(), bool, len(self.free))

    def apply(self, x: Array) -> Array:
        """Sx on the free unknowns, for x that is zero on the others."""
        return self._times(self.matrix, x) * self.free

    def solve(self, core: Core, r: Array) -> Array:
        """M⁻¹r by S⁻¹: the right-hand side condensed, S solved, and what was condensed found from it."""
        r = r * self._unfixed
        if not self._condense:
            return core(r)
        x = core((r + self._times(self.form.harmonic_extension_trans, r)) * self.free)
        return (
            x + self._times(self.form.harmonic_extension, x) + self._times(self.form.inner_solve, r)
        ) * self._unfixed

    def _times(self, matrix: ngs.BaseMatrix, x: Array) -> Array:
        self._x.FV().NumPy()[:] = x
        self._y.data = matrix * self._x
        return self._y.FV().NumPy().copy()


def free(form: ngs.BilinearForm) -> Array:
    """Which unknowns of a form are to be solved for together."""
    return np.fromiter(form.space.FreeDofs(form.condense), bool, form.space.ndof)


def fields(space: ngs.FESpace) -> list[slice]:
    """Where the unknowns of each field are."""
    if space.type == "VectorH1" or not isinstance(space, ngs.ProductSpace):
        return [slice(0, space.ndof)]
    ranges = [space.Range(i) for i in range(len(space.components))]
    return [slice(part.start, part.stop) for part in ranges]
