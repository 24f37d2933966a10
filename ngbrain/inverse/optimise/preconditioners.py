"""Preconditioners of Gauss-Newton steps in 3-D, block by block.

For waves u a change δθ of a field acts like a stress ∂σ/∂θ δθ, which moves the body by about |∂σ/∂θ| δθ/g · |ξ|/(|ξ|² + κ²) at wave
number ξ, with g the shear stiffness and κ² = ρω²/|g|. Hence

    H_b ≈ α R_b + Dᵀ M_w S⁻¹ M_w D ,   S = K + κ² M ,   w = |∂σ/∂θ|/g · √n ,   D = ∂θ_b/∂x_b

with K the stiffness matrix, M the mass matrix, M_w the mass matrix weighted with w, and n the data weight 1/σ² per volume. Its
inverse is a block of the inverse of the sparse, symmetric, quasi-definite matrix [[αR, Dᵀ M_w], [M_w D, -S]]. Unknown boundary
displacements are preconditioned by `BoundaryExtensionPreconditioner`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.errors import SolverError
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.stiffness import definite, elastic, element_means, law_of, shear_stiffness, unit
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY, WaveLinearisation, WaveModel
from ngbrain.solvers.matrices import to_scipy

Array = np.ndarray
Apply = Callable[[Array], Array]


STIFF = 0.1
"""Elastic energy in `BoundaryExtensionPreconditioner` relative to that of the data, at the wavelength of shear waves."""
GROUND = 1e-6
"""Share of all data that keeps displacements in place where there are no data."""


class BoundaryExtensionPreconditioner:
    """Preconditioner of unknown boundary displacements, by their extension into the body with least

        u·BᵀWB u + τ n/(ρω²) ∫ K (tr ε)² + 2 g ε:ε dx ,

    with BᵀWB the weights of the data, n their sum over the volume, τ = `STIFF`. The boundary block of the inverse of this matrix
    accounts for near-incompressibility: displacements that would change the volume move the whole body and are stiff; the
    others act locally.

    It is assembled once, with the moduli of that time and component weights averaged over all loads.
    """

    def __init__(self) -> None:
        self._made: Apply | None = None

    def inverse_blocks(self, state: WaveLinearisation, weight: Array) -> list[Apply]:
        """Approximate inverse of the boundary block for each load.

        Parameters
        ----------
        state : WaveLinearisation
            State of the wave model.
        weight : array (loads, n, dim)
            Data weights.

        Returns
        -------
        list of callable
            For each load: a function of the real or imaginary parts of boundary displacements (m).
        """
        known = weight.mean(axis=1)
        sizes = [float(np.exp(np.log(each[each > 0]).mean())) for each in known]
        if self._made is None:
            shares = [each / size for each, size in zip(known, sizes, strict=True)]
            self._made = _boundary_extension(state.model, np.mean(shares, axis=0))
        made = self._made
        return [lambda r, size=size: made(r) / size for size in sizes]  # type: ignore[misc]


def _boundary_extension(model: WaveModel, weight: Array) -> Apply:
    body, n = model.body, len(model.points)
    seen = evaluation(ngs.H1(body.mesh, order=body.form.order), model.points)
    data = sp.block_diag([w * (seen.T @ seen) for w in weight])
    ground = GROUND * n / seen.shape[1] * sp.eye_array(data.shape[0])
    solve = definite(sp.coo_array(n * STIFF * elastic(body, 0, body.form.order) + data + ground))

    def apply(r: Array) -> Array:
        whole = np.zeros(data.shape[0])
        whole[model.driven_dofs] = r
        return solve(whole)[model.driven_dofs]

    return apply


def block_preconditioner(parts: Mapping[str, Apply], reduced: Reduced) -> Apply:
    """Combine the preconditioners of all blocks.

    Parameters
    ----------
    parts : mapping of str to callable
        Preconditioner of each block.
    reduced : Reduced
        Objective with these blocks.

    Returns
    -------
    callable
        Preconditioner of the whole vector.
    """

    def apply(r: Array) -> Array:
        z = np.empty_like(r)
        for name, block in reduced.unknowns.blocks.items():
            z[block] = parts[name](r[block])
        return z

    return apply


def diagonal_block_inverses(point: Point, extensions: BoundaryExtensionPreconditioner) -> dict[str, Apply]:
    """Approximate inverse of the diagonal block of H for each block of unknowns.

    Parameters
    ----------
    point : Point
        Point of the reduced objective.
    extensions : BoundaryExtensionPreconditioner
        Preconditioner of boundary displacements.

    Returns
    -------
    dict of str to callable
    """
    reduced, state = point.reduced, point.state
    model: WaveModel = reduced.model  # type: ignore[assignment]
    weight = reduced.misfit.weight(state.data)  # type: ignore[attr-defined]
    density = _density(model, weight)
    jacobian = reduced.unknowns.jacobian(point.x)
    found: dict[str, Apply] = {}
    for name, block in reduced.unknowns.blocks.items():
        rows, size = model.blocks[name], block.stop - block.start
        regular = sp.csr_array((size, size))
        if name in reduced.regularisers:
            regular = reduced.weights[name] * reduced.regularisers[name].matrix(point.x[block])
        inner = jacobian[rows][:, block]
        if name == BOUNDARY:
            found[name] = _boundary_block(extensions.inverse_blocks(state, weight), inner)  # type: ignore[arg-type]
        else:
            found[name] = _field_block(state, name, density, inner, regular)  # type: ignore[arg-type]
    return found


def _field_block(
    state: WaveLinearisation, name: str, density: list[ngs.GridFunction], inner: sp.csr_array, regular: sp.csr_array
) -> Apply:
    model, body = state.model, state.model.body
    space = model.fields[name].space
    trial, test = space.TnT()
    squared, wave_number = ngs.CF(0.0), ngs.CF(0.0)
    for k, wave in enumerate(body.waves):
        u = ngs.GridFunction(body.fes)
        u.vec.FV().NumPy()[:] = state.waves[k]
        stiffness = element_means(body, shear_stiffness(body, wave.omega))
        squared = (
            squared
            + element_means(body, squared_stress_sensitivity(body, wave.omega, u, model.fields[name]))
            / stiffness**2
            * density[k]
        )
        wave_number = wave_number + wave.omega**2 * body.density / stiffness / len(body.waves)
    weighted = _assemble(space, body, ngs.sqrt(squared) * trial * test) @ inner
    S = _assemble(space, body, ngs.InnerProduct(ngs.Grad(trial), ngs.Grad(test)) + wave_number * trial * test)
    whole = sp.csc_array(sp.block_array([[regular, weighted.T], [weighted, -S]]))
    factor, size = factorise_quasidefinite(whole), regular.shape[0]
    rest = np.zeros(S.shape[0])
    return lambda r: factor.solve(np.concatenate([r, rest]))[:size]


def _boundary_block(loads: list[Apply], inner: sp.csr_array) -> Apply:
    scale = inner.diagonal()  # boundary displacements in their own scale

    def apply(r: Array) -> Array:
        parts = (r / scale).reshape(2 * len(loads), -1)
        return np.concatenate([loads[i // 2](part) for i, part in enumerate(parts)]) / scale

    return apply


def squared_stress_sensitivity(
    body: HarmonicProblem, omega: float, u: ngs.GridFunction, field: ngs.GridFunction
) -> ngs.CoefficientFunction:
    """Squared stress sensitivity |∂σ/∂θ|² of the deviatoric stress at a strain, by differentiation of the energy.

    Parameters
    ----------
    body : HarmonicProblem
        Body.
    omega : float
        Angular frequency (rad/s).
    u : GridFunction
        Wave, whose strain is used.
    field : GridFunction
        Field θ.

    Returns
    -------
    CoefficientFunction
    """
    displacement, _, gradient = body.split(u)
    strain = body.strain(displacement, gradient).MakeVariable()
    energy, n = law_of(body, omega).energy(strain), strain.dims[0]
    one = ngs.GridFunction(field.space)  # NGSolve cannot differentiate with respect to a constant
    one.Set(1.0)
    total = ngs.CF(0.0)
    for i, j in np.ndindex(n, n):
        change = energy.Diff(strain, unit(n, (i, j), 1.0)).Diff(field, one)
        total = total + change * ngs.Conj(change)
    return total


def _density(model: WaveModel, weight: Array) -> list[ngs.GridFunction]:
    """Data weight per volume (1/m^(2+d)) of each load, element by element."""
    mesh = model.body.mesh
    volume = np.asarray(ngs.Integrate(1.0, mesh, element_wise=True))
    found = []
    for part in weight:
        density = ngs.GridFunction(ngs.L2(mesh, order=0))
        sums = np.bincount(model.elements, part.mean(axis=1), minlength=mesh.ne)
        density.vec.FV().NumPy()[:] = sums / volume
        found.append(density)
    return found


def _assemble(space: ngs.FESpace, body: HarmonicProblem, integrand: ngs.CoefficientFunction) -> sp.csr_array:
    form = ngs.BilinearForm(space)
    form += integrand * ngs.dx(intrules=body.rules)
    form.Assemble()
    return to_scipy(form.mat)


def factorise_quasidefinite(matrix: sp.csc_array) -> scipy.sparse.linalg.SuperLU:
    """LDLᵀ factorisation of a symmetric (quasi-)definite matrix as LU with diagonal pivots; `SolverError` for other matrices."""
    try:
        return scipy.sparse.linalg.splu(
            matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError as error:
        raise SolverError(f"a preconditioner cannot be factorised: {error}") from error
