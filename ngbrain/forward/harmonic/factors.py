"""System matrices of a harmonic problem, one for each frequency, and their factorisations, which also serve adjoints.

Matrices are complex-symmetric, except about a body under a follower pressure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigs

from ngbrain.errors import InputError, SolverError
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.solvers.device import PIVOTED, CpuFactor, Device, Factor
from ngbrain.solvers.matrices import rows, to_scipy

if TYPE_CHECKING:
    from ngbrain.forward.harmonic.problem import HarmonicProblem

Array = np.ndarray
ROUGH = 1e-6
"""Residual, relative to the load, above which a factorisation is not usable."""
FINE = 1e-11
"""Residual, relative to the load, above which solutions take one step of iterative refinement. This happens with discontinuous
pressures, where round-off grows with K/μ (4e-8 at 10⁸)."""


class Factorised:
    """Matrices of a harmonic problem at its current moduli, one for each frequency, factorised on demand.

    Parameters
    ----------
    body : HarmonicProblem
    solves : Solves, optional
        Where factorisations and back-substitutions are counted.
    """

    def __init__(self, body: HarmonicProblem, solves: Solves | None = None) -> None:
        self.body, self.solves = body, Solves() if solves is None else solves
        matrices = body.matrices()
        self._matrices = {omega: matrices(omega) for omega in {wave.omega for wave in body.waves}}
        self._factors: dict[float, Factor] = {}
        self.refactored: set[float] = set()
        """Angular frequencies (rad/s) whose first factorisation was not usable."""
        self.improved: set[float] = set()
        """Angular frequencies (rad/s) at which solutions take one step of iterative refinement."""
        any_of_them = next(iter(self._matrices.values()))
        self._in, self._out = any_of_them.CreateColVector(), any_of_them.CreateColVector()

    def apply(self, number: int, x: Array, transposed: bool = False) -> Array:
        """A x, or Aᵀ x.

        Parameters
        ----------
        number : int
            Index of the wave.
        x : array (ndof,)
        transposed : bool

        Returns
        -------
        array (ndof,)
        """
        if transposed and not self.body.symmetric:
            return np.asarray(self.matrix(number).T @ x)
        self._in.FV().NumPy()[:] = x
        self._out.data = self._of(number) * self._in
        return self._out.FV().NumPy().copy()

    def reactions(self, number: int, x: Array, where: Array) -> Array:
        """Aᵀ x at some unknowns only, faster than `apply`.

        Parameters
        ----------
        number : int
            Index of the wave.
        x : array (ndof,)
        where : array of int
            Unknowns.

        Returns
        -------
        array
        """
        if not self.body.symmetric:
            return self.apply(number, x, transposed=True)[where]
        return np.asarray(rows(self._of(number), where) @ x)

    def matrix(self, number: int) -> sp.csr_array:
        """A of the wave."""
        return to_scipy(self._of(number))

    def solve(self, number: int, b: Array, purpose: str = "forward", transposed: bool = False) -> Array:
        """Solve A x = b, or Aᵀ x = b, for the free unknowns; x = 0 for the constrained ones.

        Parameters
        ----------
        number : int
            Index of the wave.
        b : array (ndof,)
        purpose : str
            A field of `Solves`.
        transposed : bool

        Returns
        -------
        array (ndof,)
        """
        x = self._back(number, b, purpose, transposed)
        if self.body.waves[number].omega in self.improved:
            x += self._back(number, b - self.apply(number, x, transposed), "refinements", transposed)
        return x

    def _of(self, number: int) -> ngs.BaseMatrix:
        return self._matrices[self.body.waves[number].omega]

    def _back(self, number: int, b: Array, purpose: str, transposed: bool = False) -> Array:
        omega = self.body.waves[number].omega
        if omega not in self._factors:
            self._factors[omega] = self._factor(omega, self.body.device)
        self.solves.count(purpose)
        factor = self._factors[omega]
        if transposed and not self.body.symmetric:
            assert isinstance(factor, CpuFactor)
            return factor.solve_transpose(b)
        return factor.solve(b)

    def _factor(self, omega: float, device: Device) -> Factor:
        what = f"the matrix of {omega / (2 * np.pi):g} Hz, as at a resonance without loss,"
        factor = device.factor(self._matrices[omega], self.body.free, what)
        self.solves.factorisations += 1
        return factor

    def solve_wave(self, number: int, g: Array) -> Array:
        """Solve for a wave with prescribed displacements and its own forces.

        The first factorisation does not pivot. Where its residual is too large, the matrix is factorised again with pivoting.

        Parameters
        ----------
        number : int
            Index of the wave.
        g : array (ndof,)
            Prescribed unknowns; zero elsewhere.

        Returns
        -------
        array (ndof,)

        Raises
        ------
        SolverError
            Without a usable factorisation, as at a resonance.
        """
        omega = self.body.waves[number].omega
        b = self.body.load_vector(number) - self.apply(number, g)
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
            raise SolverError(
                f"the matrix of {frequency:g} Hz has no usable factorisation, possibly at a resonance; add loss"
            )
        return x + g

    def _settled(self, number: int, b: Array, purpose: str) -> tuple[Array, float]:
        """A solution and its residual relative to the load."""
        x = self.solve(number, b, purpose)
        with np.errstate(invalid="ignore", over="ignore"):
            left = np.linalg.norm(np.where(self.body.fixed, 0, b - self.apply(number, x)))
            size = np.linalg.norm(np.where(self.body.fixed, 0, b))
        return x, float(left / size) if size else float(left)

    def detuning(self, number: int) -> float:
        """Relative distance to the nearest resonance, |ω_j - ω|/ω, with complex ω_j where there is loss.

        The response is about 1/(2 detuning) times that far from resonance, and near a resonance model errors are amplified.
        Raises `InputError` at 0 Hz.
        """
        body, omega = self.body, self.body.waves[number].omega
        if not omega:
            raise InputError("Wave.frequency", 0, "more than 0 Hz: a static problem has no resonance")
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
        start = np.where(body.fixed, 0, np.random.default_rng(0).normal(size=body.fes.ndof)).astype(complex)
        values = eigs(operator, k=1, v0=start, return_eigenvectors=False, tol=1e-8)
        return float(abs(np.sqrt(1 + 1 / (values[0] * omega**2)) - 1))
