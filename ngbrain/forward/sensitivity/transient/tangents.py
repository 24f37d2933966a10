"""Solvers with a body's tangent at one state after another, of a run that is linearised: few factors for many steps."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np

from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.tangent import Solve, factor
from ngbrain.solvers.krylov import gmres

Array = np.ndarray
EXACT, MOST = 1e-11, 12
"""What is left of a correction when GMRES may stop, and iterations after which a new factor is made."""
FINER = 1e-13
"""The first of these for second derivatives, which come from solutions of solutions."""
FEW = 3
"""Right-hand sides at one state up to which an old factor is tried."""


class Tangents:
    """The tangent at whatever state the body stands; an older factor of it is GMRES's preconditioner as long as it will do.

    `factorisations` and `solves` count.
    """

    def __init__(self, body: Problem) -> None:
        self.body, self.factorisations, self.solves = body, 0, 0
        free = body.weights > 0
        self._free, self._scale = free.astype(float), np.sqrt(np.where(free, body.weights, 1.0))
        self._held = ngs.BitArray(free.tolist())
        self._vectors = body.gfu.vec.CreateVector(), body.gfu.vec.CreateVector()
        self._factor: Solve | None = None

    def here(self, sides: int, exact: float = EXACT) -> Solve:
        """A solver for so many right-hand sides, of use until the next is asked for."""
        flows = self.body.history.flows
        if flows:
            flows.stiffen()
        self.body.form.AssembleLinearization(self.body.gfu.vec)
        self._fresh, self._exact = False, exact
        if sides > FEW:
            self._renew()
        return self._solve

    def transposed(self, b: Array) -> Array:
        """K⁻ᵀ b: the tangent is symmetric."""
        return self._solve(b)

    def apply(self, x: Array) -> Array:
        """K x, one number for each unknown."""
        vector, image = self._vectors
        vector.FV().NumPy()[:] = x
        image.data = self.body.form.mat * vector
        return image.FV().NumPy().copy()

    def _solve(self, b: Array) -> Array:
        self.solves += 1
        if self._factor is not None and not self._fresh:
            first = self._factor(b)
            x, _, left = gmres(
                lambda y: self.apply(y) * self._free, self._factor, first, self._scale, self._exact, MOST
            )
            if left <= self._exact:
                return x
        if not self._fresh:
            self._renew()
        assert self._factor is not None
        return self._factor(b)

    def _renew(self) -> None:
        self._factor = None  # the old one's memory first
        self._factor = factor(self.body.form, self._held)
        self._fresh = True
        self.factorisations += 1
