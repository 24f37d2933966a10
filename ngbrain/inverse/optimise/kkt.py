"""One Gauss-Newton step with waves and fields as unknowns together, by one sparse factorisation.

Around fields x and waves u the step (δx, δu) minimises

    ½ |W^½ (B (u + δu) - m)|² + ½ (x + δx - x̄)·R (x + δx - x̄)    subject to    A (u + δu) + (∂A/∂x u) δx = f

with W the weights of the data. Its optimality conditions are sparse and symmetric, and their factor also tells how many
numbers the data determine. The waves need not satisfy the equation of motion to begin with: started from measured waves the
first step is a linear least-squares problem, which has no local minima to fall into.

For plane problems: the factor of a problem in space does not fit.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp

from ngbrain.errors import SolverError
from ngbrain.forward.sensitivity.harmonic.at_rest import FieldSensitivity
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveLinearisation
from ngbrain.inverse.optimise.gauss_newton_hessian import Metric
from ngbrain.solvers.matrices import to_ngsolve

Array = np.ndarray
SHIFT = 1e-8
"""Added to the diagonal, negative for the equations: then any order of elimination is stable without pivots (Vanderbei 1995,
10.1137/0805005), and refinement takes it off again."""
TIED = 1e-6
"""Weight, in squared deviations of the data, of changes on the boundary: an edge between points is held by little else."""
FAINT = 1e-3
"""The same of a component that is never measured: with 2 % noise a change as large as the waves costs as much as a few data."""
SEEN = 1e-12
"""Share of the largest squared value at the data below which an unknown counts as not seen: at a node, or beside it by as much as
single precision rounds, functions of other nodes are nothing but round-off."""
REFINEMENTS = 6
ROUGH = 1e-6


class KKTSystem:
    """The conditions around one state, factorised.

    state     fields and waves that the problem is linearised around
    jacobian  ∂θ/∂x of the fields' unknowns (rows in θ before the boundary's)
    regular   R, with its weights
    weight    W (loads, n, dim), 0 where nothing is measured
    fixed     whether the held displacements are known exactly; else they are unknowns as all others, held by the data
    level     a direction of x that δx shall have no part of. At rest the equation of motion is fulfilled best by moduli of
              nothing, whatever the waves: their common factor has to be left where it is

    Raises `SolverError` when the conditions are singular.
    """

    def __init__(
        self,
        state: WaveLinearisation,
        jacobian: sp.csr_array,
        regular: sp.csr_array,
        weight: Array,
        fixed: bool,
        fixed_direction: Array | None = None,
    ) -> None:
        body, fields = state.model.body, state.sensitivity
        assert isinstance(fields, FieldSensitivity)
        self.state, self.loads, self.size = state, len(body.waves), regular.shape[0]
        self.free = ~body.held
        self.active = self.free if fixed else np.ones_like(self.free)
        observe = state.model.observation_matrix
        self.observe = observe[:, self.active]
        self._root = [np.sqrt(part.T.ravel()) for part in weight]
        hessians: list[sp.csr_array] = [regular]
        rows: list[list[sp.csr_array | None]] = []
        self._columns, self._rows = [], []
        for k, root in enumerate(self._root):
            seen = sp.csr_array(sp.diags_array(root) @ self.observe)
            square = sp.csr_array(seen.T @ seen)
            matrix = state.factors.matrix(k)[self.free][:, self.active]
            column = _column_scale(square, matrix)
            tied = sp.diags_array(np.where(self.free, 0.0, self._ties(weight[k]))[self.active])
            matrix = matrix @ sp.diags_array(column)
            row = 1 / np.sqrt(np.asarray(abs(matrix).power(2).sum(axis=1)).ravel())
            matrix = sp.diags_array(row) @ matrix
            change = sp.diags_array(row) @ (fields.matrices[k] @ jacobian)[self.free]
            square = sp.csr_array(sp.diags_array(column) @ square @ sp.diags_array(column) + tied)
            hessians += [square, square]
            before, after = [None] * (2 * k), [None] * (2 * (self.loads - 1 - k))
            rows.append([change.real, *before, matrix.real, -matrix.imag, *after])
            rows.append([change.imag, *before, matrix.imag, matrix.real, *after])
            self._columns.append(column)
            self._rows.append(row)
        self._levels = 0 if fixed_direction is None else 1
        if fixed_direction is not None:
            rows.append(
                [sp.csr_array(fixed_direction[None] / np.linalg.norm(fixed_direction)), *[None] * (2 * self.loads)]
            )
        constraint = sp.csr_array(sp.block_array(rows))
        whole = sp.csr_array(sp.block_array([[sp.block_diag(hessians), constraint.T], [constraint, None]]))
        self._matrix = whole
        equations = constraint.shape[0]
        shift = np.concatenate([np.full(whole.shape[0] - equations, SHIFT), np.full(equations, -SHIFT)])
        self._shifted = to_ngsolve(whole + sp.diags_array(shift))
        self._factor = body.device.factor(self._shifted, what="the optimality conditions")
        state.model.solves.factorisations += 1

    def _ties(self, weight: Array) -> Array:
        """Of each of a wave's unknowns, were it on the boundary."""
        ties = np.full(len(self.free), TIED)
        body = self.state.model.body
        moved = body.displacement.ndof
        ties[:moved].reshape(weight.shape[1], -1)[~np.any(weight > 0, axis=0)] = FAINT  # components one after the other
        return ties

    def step(self, slope: Array, residual: Array, imbalance: Array | None = None) -> tuple[Array, Array]:
        """δx and δu (loads, ndof).

        slope      gradient of the regularisers at x
        residual   m - B u (loads, n, dim), 0 where nothing is measured
        imbalance  f - A u (loads, ndof); None: the waves satisfy the equation of motion
        """
        pulls = [root * part.T.ravel() for root, part in zip(self._root, residual, strict=True)]
        return self._solve(-slope, pulls, imbalance)

    def effective_parameters(self, random: np.random.Generator) -> float:
        """How many of the real data the fitted unknowns use up: an estimate of the trace of the influence matrix."""
        probes = [random.choice([-1.0, 1.0], size=(len(root), 2)) @ [1, 1j] for root in self._root]
        _, waves = self._solve(
            np.zeros(self.size), [np.where(r > 0, z, 0) for z, r in zip(probes, self._root, strict=True)]
        )
        used = 0.0
        for root, probe, u in zip(self._root, probes, waves, strict=True):
            used += float(np.sum(np.conj(np.where(root > 0, probe, 0)) * (root * (self.observe @ u[self.active]))).real)
        return used

    def effective_parameters_by_block(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """For each block how many of its numbers the data determine: n - tr(R_b H⁻¹), estimated; R_b with its weight."""
        # tr(R H⁻¹) = E[z·H⁻¹z] with E[zzᵀ] = R: a symmetric form varies far less than e·RH⁻¹e of signs e.
        found = {}
        for name, matrix in regular.items():
            block, probe = blocks[name], np.zeros(self.size)
            size = block.stop - block.start
            probe[block] = Metric(matrix).colour(random.choice([-1.0, 1.0], size=size))
            y, _ = self._solve(probe, [np.zeros(len(root)) for root in self._root])
            found[name] = float(np.clip(size - probe @ y, 0.0, size))
        return found

    def _solve(self, slope: Array, pulls: list[Array], imbalance: Array | None = None) -> tuple[Array, Array]:
        parts = [slope]
        for root, pull, column in zip(self._root, pulls, self._columns, strict=True):
            b = column * (self.observe.T @ (root * pull))
            parts += [b.real, b.imag]
        for k, row in enumerate(self._rows):
            c = np.zeros(len(row), complex) if imbalance is None else row * imbalance[k][self.free]
            parts += [c.real, c.imag]
        b = np.concatenate([*parts, np.zeros(self._levels)])
        x, left = np.zeros_like(b), b
        for purpose in ("incremental", *["refinements"] * (REFINEMENTS - 1)):
            self.state.model.solves.count(purpose)
            x += self._factor.solve(left)
            left = b - self._matrix @ x
            if not np.linalg.norm(left) > ROUGH * 1e-4 * np.linalg.norm(b):
                break
        if not np.linalg.norm(left) <= ROUGH * np.linalg.norm(b):
            raise SolverError("the optimality conditions are singular: nothing holds some of the unknowns")
        waves = np.zeros((self.loads, len(self.free)), complex)
        rest = x[self.size : self.size + 2 * self.loads * int(self.active.sum())].reshape(self.loads, 2, -1)
        for k, column in enumerate(self._columns):
            waves[k, self.active] = column * (rest[k, 0] + 1j * rest[k, 1])
        return x[: self.size], waves


def _column_scale(square: sp.csr_array, matrix: sp.csr_array) -> Array:
    """Units of the waves' unknowns: a standard deviation of the data; of a pressure, what weighs as much in the matrix."""
    squares = square.diagonal()
    seen = squares > SEEN * squares.max()
    sigma = 1 / np.sqrt(np.median(squares[seen]))
    weights = np.sqrt(np.asarray(abs(matrix).power(2).sum(axis=0)).ravel())
    typical = np.median(weights[seen])
    return np.where(seen, sigma, sigma * typical / weights)
