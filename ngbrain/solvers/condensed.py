"""An assembled bilinear form as a linear map of arrays, with static condensation."""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ngs
import numpy as np

Array = np.ndarray
Core = Callable[[Array], Array]
"""r → S⁻¹ r over all degrees of freedom, with the condensed matrix S; zero on the others."""


class Condensed:
    """The condensed matrix S of an assembled form (the whole matrix without static condensation).

    Attributes
    ----------
    free : array of bool (ndof,)
        Degrees of freedom for which S is solved.
    fields : list of slice
        Degrees of freedom of each field.
    """

    def __init__(self, form: ngs.BilinearForm) -> None:
        self.form, self.matrix = form, form.mat
        self.free, self._condense = free(form), form.condense
        self.fields = fields(form.space)
        self._x, self._y = self.matrix.CreateRowVector(), self.matrix.CreateColVector()
        self._unfixed = np.fromiter(form.space.FreeDofs(), bool, len(self.free))

    def apply(self, x: Array) -> Array:
        """S x on the free degrees of freedom, for x that is zero elsewhere."""
        return self._times(self.matrix, x) * self.free

    def solve(self, core: Core, r: Array) -> Array:
        """M⁻¹ r of the whole matrix M, by a solver for the condensed matrix S.

        Parameters
        ----------
        core : callable
            r → S⁻¹ r.
        r : array (ndof,)
            Right-hand side.

        Returns
        -------
        array (ndof,)
            Solution, zero at fixed degrees of freedom.
        """
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
    """Degrees of freedom for which a form's condensed system is solved (ndof,)."""
    return np.fromiter(form.space.FreeDofs(form.condense), bool, form.space.ndof)


def fields(space: ngs.FESpace) -> list[slice]:
    """Slices of the degrees of freedom of each field of a space."""
    if space.type == "VectorH1" or not isinstance(space, ngs.ProductSpace):
        return [slice(0, space.ndof)]
    ranges = [space.Range(i) for i in range(len(space.components))]
    return [slice(part.start, part.stop) for part in ranges]
