"""One Gauss-Newton step in the fields alone, by conjugate gradients: for problems in space, whose factors fill the memory.

The matrix H = JᵀWJ + Σ α R is never formed: a product takes two solves for each load with the factor of the waves. It is
preconditioned block by block. Around waves u a change δθ of a field drives like a stress ∂σ/∂θ δθ, which moves the body by
about |∂σ/∂θ| δθ/g · |ξ|/(|ξ|² + κ²) at wave number ξ, with g the shear stiffness and κ² = ρω²/|g|. So

    H_b ≈ α R_b + Dᵀ M_w S⁻¹ M_w D ,   S = K + κ² M ,   w = |∂σ/∂θ|/g · √n ,   D = ∂θ_b/∂x_b

K stiffness, M mass, M_w the mass matrix weighted with w, n the weight of the data 1/σ² per volume. Its inverse is a block of
the inverse of the sparse, symmetric, quasi-definite matrix [[αR, Dᵀ M_w], [M_w D, -S]]. Held displacements that are unknown
are preconditioned by Bᵀ W B, the data of the elements that they touch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.errors import SolverError
from ngbrain.forward.factors import sparse
from ngbrain.forward.harmonic import Harmonic
from ngbrain.forward.kinematics import PlaneStrain
from ngbrain.forward.sensitivity import BOUNDARY, Linearised, WaveModel
from ngbrain.materials.linear import OfSmallStrain
from ngbrain.solvers.directions import Directions
from ngbrain.solvers.krylov import truncated_cg

Array = np.ndarray
Apply = Callable[[Array], Array]
FORCING = 0.1
"""Residual of a step, in the norm of the preconditioner, as a part of its start."""
PROBED = 0.03
"""The same of a probe: what it leaves of the boundary's share, which is large, is not to pass for a field's."""
MOST = 80
"""Iterations of a step at most: a truncated step still goes down."""


class Normal:
    """The normal equations around a point.

    counted         list that the iterations of each solve are added to
    forcing, most   where conjugate gradients stop
    directions      of solves around points near by, which make these shorter; it learns from these too
    """

    def __init__(
        self,
        point: Point,
        counted: list[int] | None = None,
        forcing: float = FORCING,
        most: int = MOST,
        directions: Directions | None = None,
    ) -> None:
        self.point, self.forcing, self.most = point, forcing, most
        self.directions = Directions() if directions is None else directions
        self.iterations: list[int] = [] if counted is None else counted
        self._found: dict[str, float] = {}
        self._regular = point.reduced.regular_matrix(point.x)
        self._jacobian = point.reduced.unknowns.jacobian(point.x)
        self.precondition = by_blocks(preconditioners(point), point.reduced)

    def product(self, direction: Array) -> Array:
        """H times a direction."""
        state = self.point.state
        change = state.push(self._jacobian @ direction)
        back = state.pull(self.point.reduced.misfit.bend(state.data, change))
        return self._jacobian.T @ back + self._regular @ direction

    def gradient(self) -> Array:
        """∇J, by the matrices that products use."""
        reduced, state = self.point.reduced, self.point.state
        slope = state.pull(reduced.misfit.slope(state.data))
        return self._jacobian.T @ slope + reduced.regular_slope(self.point.x)

    def solve(self, b: Array, forcing: float | None = None) -> Array:
        """About H⁻¹ b; `SolverError` where H or its preconditioner is not positive definite."""
        forcing = self.forcing if forcing is None else forcing
        precondition = self.directions.corrected(self.precondition, lambda s: self._regular @ s)

        def learn(s: Array, image: Array) -> None:
            self.directions.add(s, image - self._regular @ s)

        try:
            x, iterations, _ = truncated_cg(self.product, precondition, b, forcing, self.most, learn)
        except FloatingPointError as error:
            raise SolverError(f"the normal equations cannot be solved: {error}") from error
        self.iterations.append(iterations)
        return x

    def determined(self, random: np.random.Generator) -> float:
        """How many of the real data the unknowns use up: Σ of `determined_of`, of the last probe if there was one."""
        return sum(self._counts(random).values())

    def determined_of(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """For each block how many of its numbers the data determine, tr (H⁻¹ Jᵀ W J) of the block, all by one probe.

        The probe is what pure noise ξ of the data would do: y = Jᵀ √W ξ has the covariance Jᵀ W J, so y·H⁻¹y is right in the
        mean, and right within its root when the number is large.
        """
        counts = self._counts(random)
        return {name: counts[name] for name in regular}

    def _counts(self, random: np.random.Generator) -> dict[str, float]:
        if not self._found:
            reduced, state = self.point.reduced, self.point.state
            root = np.sqrt(reduced.misfit.weight(state.data))  # type: ignore[attr-defined]
            noise = root * (random.normal(size=root.shape) + 1j * random.normal(size=root.shape))
            probe = self._jacobian.T @ state.pull(noise)
            fitted = self.solve(probe, PROBED)
            for name, block in reduced.unknowns.blocks.items():
                self._found[name] = float(np.clip(probe[block] @ fitted[block], 0.0, block.stop - block.start))
        return self._found


def by_blocks(parts: Mapping[str, Apply], reduced: Reduced) -> Apply:
    """A preconditioner from those of blocks."""

    def apply(r: Array) -> Array:
        z = np.empty_like(r)
        for name, block in reduced.unknowns.blocks.items():
            z[block] = parts[name](r[block])
        return z

    return apply


def preconditioners(point: Point) -> dict[str, Apply]:
    """Block → about the inverse of its part of H."""
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
            found[name] = _of_boundary(model, weight, inner, regular)
        else:
            found[name] = _of_field(state, name, density, inner, regular)  # type: ignore[arg-type]
    return found


def regulariser_alone(point: Point) -> dict[str, Apply]:
    """As `preconditioners`, of the regularisers alone: what they are compared with."""
    found: dict[str, Apply] = {}
    for name, block in point.reduced.unknowns.blocks.items():
        matrix = point.reduced.weights[name] * point.reduced.regularisers[name].matrix(point.x[block])
        found[name] = _factorised(sp.csc_array(matrix)).solve
    return found


def _of_field(
    state: Linearised, name: str, density: list[ngs.GridFunction], inner: sp.csr_array, regular: sp.csr_array
) -> Apply:
    model, body = state.model, state.model.body
    space = model.fields[name].space
    trial, test = space.TnT()
    squared, wave_number = ngs.CF(0.0), ngs.CF(0.0)
    for k, wave in enumerate(body.waves):
        u = ngs.GridFunction(body.fes)
        u.vec.FV().NumPy()[:] = state.waves[k]
        stiffness = _mean(body, shear_stiffness(body, wave.omega))
        squared = squared + _mean(body, driven(body, wave.omega, u, model.fields[name])) / stiffness**2 * density[k]
        wave_number = wave_number + wave.omega**2 * body.density / stiffness / len(body.waves)
    weighted = _assembled(space, body, ngs.sqrt(squared) * trial * test) @ inner
    S = _assembled(space, body, ngs.InnerProduct(ngs.Grad(trial), ngs.Grad(test)) + wave_number * trial * test)
    whole = sp.csc_array(sp.block_array([[regular, weighted.T], [weighted, -S]]))
    factor, size = _factorised(whole), regular.shape[0]
    rest = np.zeros(S.shape[0])
    return lambda r: factor.solve(np.concatenate([r, rest]))[:size]


def _of_boundary(model: WaveModel, weight: Array, inner: sp.csr_array, regular: sp.csr_array) -> Apply:
    observe = model.observation[:, model.driving]
    parts = []
    for part in weight:
        # Components move each other where volumes stay, so each counts with the mean of all, however well it is known itself.
        mean = np.broadcast_to(part.mean(axis=1, keepdims=True), part.shape).T.ravel()
        square = sp.csr_array(observe.T @ sp.diags_array(mean) @ observe)
        parts += [square, square]
    whole = inner.T @ sp.block_diag(parts, format="csr") @ inner + regular
    # What no datum is near to, one of its neighbours' weight holds.
    diagonal = whole.diagonal()
    whole = whole + sp.diags_array(1e-2 * np.median(diagonal[diagonal > 0]) * np.ones_like(diagonal))
    return _factorised(sp.csc_array(whole)).solve


def driven(body: Harmonic, omega: float, u: ngs.GridFunction, field: ngs.GridFunction) -> ngs.CoefficientFunction:
    """|∂σ/∂θ|² at a strain: of stress without change of volume, by differentiation of the energy."""
    displacement, _, gradient = body.split(u)
    strain = body.strain(displacement, gradient).MakeVariable()
    energy, n = _law(body, omega).energy(strain), strain.dims[0]
    one = ngs.GridFunction(field.space)  # NGSolve does not differentiate along a constant
    one.Set(1.0)
    total = ngs.CF(0.0)
    for i, j in np.ndindex(n, n):
        change = energy.Diff(strain, _unit(n, (i, j), 1.0)).Diff(field, one)
        total = total + change * ngs.Conj(change)
    return total


def _unit(n: int, entry: tuple[int, int], value: float) -> ngs.CoefficientFunction:
    values = np.zeros((n, n))
    values[entry] = value
    return ngs.CF(tuple(values.ravel()), dims=(n, n))


def shear_stiffness(body: Harmonic, omega: float) -> ngs.CoefficientFunction:
    """g (Pa, complex): twice the energy of a unit shear, the mean over the planes that coordinates span."""
    law = _law(body, omega)
    n = 2 if body.mesh.dim == 2 and isinstance(body.kinematics, PlaneStrain) else 3
    planes = [(i, j) for i in range(n) for j in range(i)]
    total = ngs.CF(0.0)
    for i, j in planes:
        total = total + 2 / len(planes) * law.energy(_unit(n, (i, j), 0.5) + _unit(n, (j, i), 0.5))
    return total


def _law(body: Harmonic, omega: float) -> OfSmallStrain:
    return body.law if isinstance(body.law, OfSmallStrain) else body.law(omega)


def _density(model: WaveModel, weight: Array) -> list[ngs.GridFunction]:
    """Of each load the data's weight per volume (1/m^(2+d)), element by element."""
    mesh = model.body.mesh
    volume = np.asarray(ngs.Integrate(1.0, mesh, element_wise=True))
    found = []
    for part in weight:
        density = ngs.GridFunction(ngs.L2(mesh, order=0))
        sums = np.bincount(model.elements, part.mean(axis=1), minlength=mesh.ne)
        density.vec.FV().NumPy()[:] = sums / volume
        found.append(density)
    return found


def _mean(body: Harmonic, integrand: ngs.CoefficientFunction) -> ngs.GridFunction:
    """Size of the mean over each element: enough to precondition with, and an integrand is evaluated once at each point."""
    space = ngs.L2(body.mesh, order=0, complex=True)
    sums, sizes = (ngs.LinearForm(space) for _ in range(2))
    sums += (integrand + 0j * ngs.x).Compile() * space.TestFunction() * ngs.dx(intrules=body.rules)
    sizes += (1 + 0j) * space.TestFunction() * ngs.dx(intrules=body.rules)
    sums.Assemble()
    sizes.Assemble()
    mean = ngs.GridFunction(ngs.L2(body.mesh, order=0))
    mean.vec.FV().NumPy()[:] = np.abs(sums.vec.FV().NumPy() / sizes.vec.FV().NumPy())
    return mean


def _assembled(space: ngs.FESpace, body: Harmonic, integrand: ngs.CoefficientFunction) -> sp.csr_array:
    form = ngs.BilinearForm(space)
    form += integrand * ngs.dx(intrules=body.rules)
    form.Assemble()
    return sparse(form.mat)


def _factorised(matrix: sp.csc_array) -> scipy.sparse.linalg.SuperLU:
    try:
        return scipy.sparse.linalg.splu(
            matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError as error:
        raise SolverError(f"a preconditioner cannot be factorised: {error}") from error
