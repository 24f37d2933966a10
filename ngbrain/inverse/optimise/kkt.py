"""One Gauss-Newton step with waves and fields as joint unknowns, by one sparse factorisation.

Around fields x and waves u the step (δx, δu) minimises

    ½ |W^½ (B (u + δu) - m)|² + ½ (x + δx - x̄)·R (x + δx - x̄)    subject to    A (u + δu) + (∂A/∂x u) δx = f

with W the weights of the data. The optimality (KKT) conditions are sparse and symmetric; their factor also yields the effective
number of parameters. The waves need not satisfy the equation of motion initially: started from measured waves, the first
step is a linear least-squares problem without local minima.

On the CPU the elements determine the order of elimination (`elimination_order`): with 55 000 unknowns that takes a quarter of
the time of a minimum-degree order, and round-off is a thousand times smaller. For plane problems; in 3-D the factor does not
fit into memory.
"""

from __future__ import annotations

from collections.abc import Mapping

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import SolverError
from ngbrain.forward.sensitivity.harmonic.at_rest import FieldSensitivity
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY, WaveLinearisation, WaveModel
from ngbrain.inverse.optimise.gauss_newton_hessian import Metric
from ngbrain.solvers.device import CPU
from ngbrain.solvers.krylov import gmres
from ngbrain.solvers.nested_dissection import nested_dissection

Array = np.ndarray
SHIFT = 1e-8
"""Shift of the diagonal, negative for the equations, so that any order of elimination is stable without pivoting (Vanderbei 1995,
10.1137/0805005). GMRES, preconditioned by the factor, removes it. Where data determine multipliers of the equations no better
than by 1e-10, as with displacements along one ultrasound beam, it cannot; a factor with pivots and hardly any shift then takes
ten times as long.
"""
PIVOTED_SHIFT, PIVOT = 1e-14, 1e-3
"""The shift, and the least pivot relative to its column, of the factor with pivots."""
BOUNDARY_WEIGHT = 1e-6
"""Weight of boundary changes, in squared deviations of the data: little else determines an edge between measurement points."""
UNMEASURED_WEIGHT = 1e-3
"""The same for a component that is never measured: with 2 % noise, a change as large as the waves then costs as much as a few
data."""
OBSERVED = 1e-12
"""Share of the largest squared basis function value at the data below which an unknown counts as unobserved. At nodes, or within
single-precision round-off of them, basis functions of other nodes are only round-off.
"""
REFINEMENTS, RESTARTS = 8, 3
FINE, ROUGH = 1e-10, 1e-6
"""Iterations of GMRES, and restarts; the relative residual at which a step stops, and the largest one that is taken. Estimates of
traces stop there: their random probes are off by per cent."""


class KKTSystem:
    """Factorised optimality (KKT) conditions of the linearised problem around one state.

    Parameters
    ----------
    state : WaveLinearisation
        Fields and waves around which the problem is linearised.
    jacobian : sparse array
        ∂θ/∂x of the unknown fields (rows of θ before those of the boundary).
    regular : sparse array (n, n)
        Weighted regulariser matrix R.
    weight : array (loads, n, dim)
        Data weights W, zero where nothing is measured.
    fixed : bool
        Whether the prescribed displacements are known exactly; otherwise they are unknowns determined by the data.
    fixed_direction : array (n,), optional
        Direction of x along which δx is zero. For a body at rest the equation of motion is satisfied best by vanishing moduli,
        whatever the waves, so that their common factor must stay fixed.
    order : array of int, optional
        Order of elimination; by default `elimination_order`, which is the same for all states of a model.

    Raises
    ------
    SolverError
        If the conditions are singular.
    """

    def __init__(
        self,
        state: WaveLinearisation,
        jacobian: sp.csr_array,
        regular: sp.csr_array,
        weight: Array,
        fixed: bool,
        fixed_direction: Array | None = None,
        order: Array | None = None,
    ) -> None:
        body, fields = state.model.body, state.sensitivity
        assert isinstance(fields, FieldSensitivity)
        self.state, self.loads, self.size = state, len(body.waves), regular.shape[0]
        self.free = ~body.fixed
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
            boundary = sp.diags_array(np.where(self.free, 0.0, self._boundary_weights(weight[k]))[self.active])
            matrix = matrix @ sp.diags_array(column)
            row = 1 / np.sqrt(np.asarray(abs(matrix).power(2).sum(axis=1)).ravel())
            matrix = sp.diags_array(row) @ matrix
            change = sp.diags_array(row) @ (fields.matrices[k] @ jacobian)[self.free]
            square = sp.csr_array(sp.diags_array(column) @ square @ sp.diags_array(column) + boundary)
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
        self._shift = np.concatenate([np.ones(whole.shape[0] - equations), np.full(equations, -1.0)])
        if order is None:
            order = elimination_order(state.model, jacobian, fixed, fixed_direction is not None)
        self._order = order
        self._factorise()

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns and equations, as real numbers."""
        return self._matrix.shape[0]

    def _boundary_weights(self, weight: Array) -> Array:
        """Weight of each unknown of a wave, if it lay on the boundary."""
        weights = np.full(len(self.free), BOUNDARY_WEIGHT)
        body = self.state.model.body
        moved = body.displacement.ndof
        weights[:moved].reshape(weight.shape[1], -1)[~np.any(weight > 0, axis=0)] = (
            UNMEASURED_WEIGHT  # component by component
        )
        return weights

    def step(self, slope: Array, residual: Array, imbalance: Array | None = None) -> tuple[Array, Array]:
        """Solve for the Gauss-Newton step.

        Parameters
        ----------
        slope : array (n,)
            Gradient of the regularisers at x.
        residual : array (loads, points, dim)
            Data residual m - B u, zero where nothing is measured.
        imbalance : array (loads, ndof), optional
            Residual f - A u of the equation of motion. By default the waves satisfy it.

        Returns
        -------
        dx : array (n,)
            Step of the fields.
        du : array (loads, ndof)
            Step of the waves.
        """
        weighted_residuals = [root * part.T.ravel() for root, part in zip(self._root, residual, strict=True)]
        return self._solve(-slope, weighted_residuals, imbalance)

    def effective_parameters(self, random: np.random.Generator) -> float:
        """Effective number of real data that the unknowns use up: an estimate of the trace of the influence matrix."""
        probes = [random.choice([-1.0, 1.0], size=(len(root), 2)) @ [1, 1j] for root in self._root]
        seen = [np.where(root > 0, probe, 0) for root, probe in zip(self._root, probes, strict=True)]
        _, waves = self._solve(np.zeros(self.size), seen, tolerance=ROUGH)
        used = 0.0
        for root, probe, u in zip(self._root, probes, waves, strict=True):
            used += float(np.sum(np.conj(probe) * (root * (self.observe @ u[self.active]))).real)
        return used

    def effective_parameters_by_block(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """Effective number of parameters of each block, n - tr(R_b H⁻¹), estimated with random probes.

        Parameters
        ----------
        blocks : mapping of str to slice
            Name and place of each block in x.
        regular : mapping of str to sparse array
            Weighted regulariser matrix of each block.
        random : Generator
            Random probes.

        Returns
        -------
        dict of str to float
        """
        # tr(R H⁻¹) = E[z·H⁻¹z] with E[zzᵀ] = R: this symmetric form has a far smaller variance than e·RH⁻¹e with random signs e.
        found = {}
        for name, matrix in regular.items():
            block, probe = blocks[name], np.zeros(self.size)
            size = block.stop - block.start
            probe[block] = Metric(matrix).colour(random.choice([-1.0, 1.0], size=size))
            y, _ = self._solve(probe, [np.zeros(len(root)) for root in self._root], tolerance=ROUGH)
            found[name] = float(np.clip(size - probe @ y, 0.0, size))
        return found

    def _solve(
        self, slope: Array, weighted_residuals: list[Array], imbalance: Array | None = None, tolerance: float = FINE
    ) -> tuple[Array, Array]:
        parts = [slope]
        for root, weighted_residual, column in zip(self._root, weighted_residuals, self._columns, strict=True):
            b = column * (self.observe.T @ (root * weighted_residual))
            parts += [b.real, b.imag]
        for k, row in enumerate(self._rows):
            c = np.zeros(len(row), complex) if imbalance is None else row * imbalance[k][self.free]
            parts += [c.real, c.imag]
        b = np.concatenate([*parts, np.zeros(self._levels)])
        x = self._refined(b, tolerance)
        if x is None and not self._pivoted:
            self._factorise(pivoted=True)
            x = self._refined(b, tolerance)
        if x is None:
            raise SolverError("the optimality conditions are singular: some unknowns are not determined")
        waves = np.zeros((self.loads, len(self.free)), complex)
        rest = x[self.size : self.size + 2 * self.loads * int(self.active.sum())].reshape(self.loads, 2, -1)
        for k, column in enumerate(self._columns):
            waves[k, self.active] = column * (rest[k, 0] + 1j * rest[k, 1])
        return x[: self.size], waves

    def _refined(self, b: Array, tolerance: float) -> Array | None:
        """Solution of the conditions without their shift; None where refinement does not converge."""
        self.state.model.solves.count("incremental")
        x = self._factor.solve(b)
        for restart in range(RESTARTS + 1):
            left = b - self._matrix @ x
            relative = float(np.linalg.norm(left)) / max(float(np.linalg.norm(b)), 1e-300)
            if restart == RESTARTS or not relative > tolerance:
                break
            first, unscaled = self._refinement(left), np.ones_like(b)
            x += gmres(self._matrix.__matmul__, self._refinement, first, unscaled, tolerance / relative, REFINEMENTS)[0]
        return x if relative <= ROUGH else None

    def _factorise(self, pivoted: bool = False) -> None:
        shift = (PIVOTED_SHIFT if pivoted else SHIFT) * self._shift
        shifted, what = sp.csr_array(self._matrix + sp.diags_array(shift)), "the optimality conditions"
        device = CPU if pivoted else self.state.model.body.device
        self._factor = device.factor_in_order(shifted, self._order, PIVOT if pivoted else 0.0, what)
        self._pivoted = pivoted
        self.state.model.solves.factorisations += 1

    def _refinement(self, residual: Array) -> Array:
        self.state.model.solves.count("refinements")
        return self._factor.solve(residual)


def elimination_order(model: WaveModel, jacobian: sp.csr_array, fixed: bool, fixed_direction: bool) -> Array:
    """Return the order of elimination of the optimality conditions, by nested dissection of the elements.

    Parameters
    ----------
    model : WaveModel
        The model.
    jacobian, fixed
        As for `KKTSystem`.
    fixed_direction : bool
        Whether there is a fixed direction.

    Returns
    -------
    array of int (unknowns and equations,)
    """
    body, loads = model.body, len(model.body.waves)
    mesh = body.mesh
    fields = sp.block_array([[_incidence(model.fields[name].space)] for name in model.blocks if name != BOUNDARY])
    waves = _incidence(body.fes)
    equations = waves[~body.fixed]
    rows = [abs(jacobian.T) @ fields, *[equations if fixed else waves] * (2 * loads), *[equations] * (2 * loads)]
    if fixed_direction:
        rows.append(sp.csr_array(np.ones((1, mesh.ne))))
    points = np.array([point.point for point in mesh.vertices])
    centres = np.array([points[[v.nr for v in element.vertices]].mean(axis=0) for element in mesh.Elements()])
    return nested_dissection(sp.csr_array(sp.vstack(rows)), centres)


def _incidence(space: ngs.FESpace) -> sp.csr_array:
    """1 where an unknown (row) belongs to an element (column)."""
    unknowns = [[dof for dof in element.dofs if dof >= 0] for element in space.Elements()]
    columns = np.repeat(np.arange(len(unknowns)), [len(each) for each in unknowns])
    entries = np.ones(len(columns)), (np.concatenate(unknowns), columns)
    return sp.coo_array(entries, shape=(space.ndof, len(unknowns))).tocsr()


def _column_scale(square: sp.csr_array, matrix: sp.csr_array) -> Array:
    """Scale of the unknowns of the waves: a standard deviation of the data; for pressures, the same norm of the matrix column."""
    squares = square.diagonal()
    seen = squares > OBSERVED * squares.max()
    sigma = 1 / np.sqrt(np.median(squares[seen]))
    weights = np.sqrt(np.asarray(abs(matrix).power(2).sum(axis=0)).ravel())
    typical = np.median(weights[seen])
    return np.where(seen, sigma, sigma * typical / weights)
