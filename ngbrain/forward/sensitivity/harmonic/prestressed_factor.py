"""The complex matrix of one wave on an equilibrium, and its factor."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import SolverError
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.harmonic.factors import FINE, ROUGH, sparse

Array = np.ndarray
UNUSABLE = "the matrix of a wave has no usable factor: a resonance? add loss"


class Factor:
    """A of one frequency and its factor, which chooses pivots where one without them leaves too much; counted in `solves`."""

    def __init__(self, pattern: ngs.BaseMatrix, entries: Array, free: Array, symmetric: bool, solves: Solves) -> None:
        self._mat = pattern.CreateMatrix()
        self._mat.AsVector().FV().NumPy()[:] = entries
        self.matrix, self._free, self._symmetric, self._solves = sparse(self._mat), free, symmetric, solves
        self._unknowns = ngs.BitArray(free.tolist())
        self._x, self._y = self._mat.CreateColVector(), self._mat.CreateColVector()
        self._inverse = self._made("sparsecholesky" if symmetric else "umfpack")
        self._pivots = not symmetric

    def solve(self, b: Array, purpose: str, transposed: bool = False) -> Array:
        """x with (A x - b) = 0, or (Aᵀ x - b) = 0, in the free unknowns and x = 0 in the held ones."""
        turned = transposed and not self._symmetric
        matrix, b = self.matrix.T if turned else self.matrix, np.where(self._free, b, 0)
        x, left = self._refined(matrix, b, turned, purpose)
        if not left <= ROUGH and not self._pivots:
            self._inverse, self._pivots = self._made("umfpack"), True
            x, left = self._refined(matrix, b, turned, "refinements")
        if not left <= ROUGH:
            raise SolverError(UNUSABLE)
        return x

    def _refined(self, matrix: sp.csr_array, b: Array, turned: bool, purpose: str) -> tuple[Array, float]:
        """A solution, improved once if it needs that, and the part of the load that it leaves."""
        size = np.linalg.norm(b) or 1.0
        with np.errstate(invalid="ignore", over="ignore"):
            x = self._back(b, turned, purpose)
            rest = np.where(self._free, b - matrix @ x, 0)
            if not np.linalg.norm(rest) <= FINE * size:
                x = x + self._back(rest, turned, "refinements")
                rest = np.where(self._free, b - matrix @ x, 0)
            return x, float(np.linalg.norm(rest) / size)

    def _back(self, b: Array, turned: bool, purpose: str) -> Array:
        self._solves.count(purpose)
        self._x.FV().NumPy()[:] = b
        self._y.data = (self._inverse.T if turned else self._inverse) * self._x
        return np.where(self._free, self._y.FV().NumPy(), 0)

    def _made(self, kind: str) -> ngs.BaseMatrix:
        self._solves.factorisations += 1
        try:
            return self._mat.Inverse(self._unknowns, inverse=kind)
        except Exception as error:  # NGSolve raises bare exceptions of several kinds here
            raise SolverError(UNUSABLE) from error
