"""Factorised tangent of a body: as a whole, or renewed only where it changes."""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ngs
import numpy as np

from ngbrain.errors import Breakdown

Solve = Callable[[np.ndarray], np.ndarray]
"""r ↦ M⁻¹r, numpy arrays over all unknowns, zero where they are fixed."""

ROUGH = 0.4
"""Relative error of a solution above which a partial factorisation is not used."""


def factor(form: ngs.BilinearForm, free: ngs.BitArray) -> Solve:
    """Factorise an assembled symmetric, quasi-definite matrix, without pivoting.

    Parameters
    ----------
    form : BilinearForm
    free : BitArray
        Free unknowns.

    Returns
    -------
    callable
        r ↦ M⁻¹ r, zero at constrained unknowns.

    Raises
    ------
    Breakdown
        If the factorisation fails.
    """
    try:
        inverse = form.mat.Inverse(free, inverse="sparsecholesky")
    except Exception as error:  # NGSolve raises bare exceptions of several kinds here
        raise Breakdown(f"the tangent cannot be factorised: {error}") from error
    right, left = form.mat.CreateColVector(), form.mat.CreateColVector()
    where = np.fromiter(free, bool, right.size)

    def solve(r: np.ndarray) -> np.ndarray:
        right.FV().NumPy()[:] = r
        left.data = inverse * right
        return left.FV().NumPy() * where

    return solve


class Tangent:
    """Factorised tangent K of a form, renewed as a whole or only in the part of the body where it changes most.

    Elements far from a retractor are most of a head, and their tangent hardly changes. With the factor M₀ of the whole, of an
    earlier state, and the factor M₁ of the current K on the unknowns inside the part, a solve is x = M₁⁻¹r, x += M₀⁻¹(r - K x),
    x += M₁⁻¹(r - K x): a symmetric multiplicative Schwarz method. It is exact if nothing outside the part has changed;
    `refresh` measures the remaining error.

    Parameters
    ----------
    whole : BilinearForm
        The form to be factorised.
    free : BitArray
        Its free unknowns.
    weights : array (n,)
        Diagonal of the inner product that measures solutions.
    part : BilinearForm, optional
        Form over the same space with the part that changes.
    inside : BitArray, optional
        Free unknowns of the part's elements alone.
    """

    def __init__(
        self,
        whole: ngs.BilinearForm,
        free: ngs.BitArray,
        weights: np.ndarray,
        part: ngs.BilinearForm | None = None,
        inside: ngs.BitArray | None = None,
    ) -> None:
        self.whole, self.free, self.weights, self.part, self.inside = whole, free, weights, part, inside
        self._kept: Solve | None = None

    def renew(self, at: ngs.BaseVector) -> Solve:
        """Factorise the whole."""
        self._kept = None  # frees the memory of the old one first
        self.whole.AssembleLinearization(at)
        if self.part is not None:
            self.part.AssembleLinearization(at)
            values = self.part.mat.AsVector()
            self._before = values.CreateVector()
            self._before.data = values
        self._kept = factor(self.whole, self.free)
        return self._kept

    def refresh(self, at: ngs.BaseVector, r: np.ndarray | None = None) -> Solve | None:
        """Factorise the part, beside the earlier factorisation of the whole.

        Parameters
        ----------
        at : BaseVector
            Current unknowns.
        r : array (n,), optional
            Residual with which the accuracy is tested.

        Returns
        -------
        callable or None
            None without a factorisation, or if the solution for r is too inaccurate.
        """
        if self.part is None or self._kept is None:
            return None
        self.part.AssembleLinearization(at)
        change = self.part.mat.CreateMatrix()
        change.AsVector().data = self.part.mat.AsVector() - self._before
        local, kept, free = factor(self.part, self.inside), self._kept, np.fromiter(self.free, bool, at.size)
        x, product = at.CreateVector(), at.CreateVector()

        def left(r: np.ndarray, solution: np.ndarray) -> np.ndarray:
            x.FV().NumPy()[:] = solution
            product.data = self.whole.mat * x
            product.data += change * x
            return (r - product.FV().NumPy()) * free

        def solve(r: np.ndarray) -> np.ndarray:
            y = local(r)
            y = y + kept(left(r, y))
            return y + local(left(r, y))

        if r is not None:
            solution = solve(r)
            if not self._size(kept(left(r, solution))) < ROUGH * self._size(solution):
                return None
        return solve

    def _size(self, x: np.ndarray) -> float:
        return float(np.sqrt(self.weights @ (x * x)))
