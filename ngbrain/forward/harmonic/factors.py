"""Matrices of a harmonic body, one for each frequency, and their factors: complex-symmetric, so that one serves adjoints too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
from ngsolve import CoefficientFunction
from scipy.sparse.linalg import LinearOperator, eigs

from ngbrain.errors import InputError, SolverError
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.solvers.condensed import rows, sparse
from ngbrain.solvers.device import PIVOTED, Device, Factor

if TYPE_CHECKING:
    from ngbrain.forward.harmonic.problem import Harmonic

Array = np.ndarray
ROUGH = 1e-6
"""A residual larger than this part of the load: the factor is of no use."""
FINE = 1e-11
"""A residual larger than this part: solutions are improved once, by that of their residual. So with discontinuous
pressures, where round-off grows with K/μ (4e-8 at 10⁸)."""


class Factorised:
    """A body's matrices at its present moduli, one for each frequency: complex-symmetric, all unknowns; factors on demand.

    solves  where they and their back-substitutions are counted
    """

    def __init__(self, body: Harmonic, solves: Solves | None = None) -> None:
        self.body, self.solves = body, Solves() if solves is None else solves
        trial, test = body.fes.TnT()
        self._forms: dict[float, ngs.BilinearForm] = {}
        self._factors: dict[float, Factor] = {}
        self.refactored: set[float] = set()
        """Angular frequencies (rad/s) whose first factor was of no use."""
        self.improved: set[float] = set()
        """Those at which every solution is improved once."""
        for omega in {wave.omega for wave in body.waves}:
            form = ngs.BilinearForm(body.fes)
            form += body.terms(omega, trial, test, _same)
            form.Assemble()
            self._forms[omega] = form
        self._in, self._out = form.mat.CreateColVector(), form.mat.CreateColVector()

    def apply(self, number: int, x: Array) -> Array:
        """A x of the wave's matrix."""
        self._in.FV().NumPy()[:] = x
        self._out.data = self._forms[self.body.waves[number].omega].mat * self._in
        return self._out.FV().NumPy().copy()

    def reactions(self, number: int, x: Array, where: Array) -> Array:
        """A x at some unknowns (indices): of a few, in a fraction of the time of `apply`."""
        return np.asarray(rows(self._forms[self.body.waves[number].omega].mat, where) @ x)

    def matrix(self, number: int) -> sp.csr_array:
        """A of the wave."""
        return sparse(self._forms[self.body.waves[number].omega].mat)

    def solve(self, number: int, b: Array, purpose: str = "forward") -> Array:
        """x with (A x - b) = 0 in the free unknowns and x = 0 in the held ones; `purpose` as `Solves` has them."""
        x = self._back(number, b, purpose)
        if self.body.waves[number].omega in self.improved:
            x += self._back(number, b - self.apply(number, x), "refinements")
        return x

    def _back(self, number: int, b: Array, purpose: str) -> Array:
        omega = self.body.waves[number].omega
        if omega not in self._factors:
            self._factors[omega] = self._factor(omega, self.body.device)
        self.solves.count(purpose)
        return self._factors[omega].solve(b)

    def _factor(self, omega: float, device: Device) -> Factor:
        factor = device.factor(self._forms[omega].mat, self.body.free, "the harmonic matrix")
        self.solves.factorisations += 1
        return factor

    def driven(self, number: int, g: Array) -> Array:
        """The wave with held unknowns g and its own forces; `SolverError` if no factor solves for it.

        The first factor chooses no pivots. Where it leaves too much, the matrix is factorised once more with pivots.
        """
        omega = self.body.waves[number].omega
        b = self.body.pushed(number) - self.apply(number, g)
        x, left = self._settled(number, b, "forward")
        if not left <= FINE and omega not in self.improved:
            self.improved.add(omega)
            x, left = self._settled(number, b, "refinements")
        if not left <= ROUGH and omega not in self.refactored:
            self._factors[omega] = self._factor(omega, PIVOTED)
            self.refactored.add(omega)
            x, left = self._settled(number, b, "refinements")
        if not left <= ROUGH:
            frequency = self.body.waves[number].frequency
            raise SolverError(f"the matrix of {frequency:g} Hz has no usable factor: a resonance? add loss")
        return x + g

    def _settled(self, number: int, b: Array, purpose: str) -> tuple[Array, float]:
        """A solution and the part of the load that it leaves."""
        x = self.solve(number, b, purpose)
        with np.errstate(invalid="ignore", over="ignore"):
            left = np.linalg.norm(np.where(self.body.held, 0, b - self.apply(number, x)))
            size = np.linalg.norm(np.where(self.body.held, 0, b))
        return x, float(left / size) if size else float(left)

    def detuning(self, number: int) -> float:
        """How far the nearest resonance is: |ω_j - ω|/ω, with ω_j complex where there is loss.

        Half its inverse is about how much larger the response is than far from resonance; data near one magnify every
        error of the model. Raises `InputError` at 0 Hz.
        """
        body, omega = self.body, self.body.waves[number].omega
        if not omega:
            raise InputError("Wave.frequency", 0, "more than 0 Hz: what does not oscillate has no resonance")
        trial, test = body.fes.TnT()
        mass = ngs.BilinearForm(body.fes)
        weighed = body.kinematics.weight() * body.inertia(body.split(trial)[0], body.split(test)[0])
        mass += weighed * ngs.dx(intrules=body.rules)
        mass.Assemble()
        x, y = mass.mat.CreateColVector(), mass.mat.CreateColVector()

        def inverted(v: Array) -> Array:
            x.FV().NumPy()[:] = np.ravel(v)
            y.data = mass.mat * x
            return self.solve(number, y.FV().NumPy(), "checks")

        operator = LinearOperator((body.fes.ndof,) * 2, matvec=inverted, dtype=complex)
        start = np.where(body.held, 0, np.random.default_rng(0).normal(size=body.fes.ndof)).astype(complex)
        values = eigs(operator, k=1, v0=start, return_eigenvectors=False, tol=1e-8)
        return float(abs(np.sqrt(1 + 1 / (values[0] * omega**2)) - 1))


def _same(work: CoefficientFunction) -> CoefficientFunction:
    return work
