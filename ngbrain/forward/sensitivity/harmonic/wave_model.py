"""Time-harmonic waves as a model from parameters to displacements at measured points.

For the discrete problem A(θ) u = b with u = g on the boundary and data d = B u,

    J δθ = B δu,   A δu = -(∂A/∂θ δθ) u - A δg        one solve a wave
    Jᵀ w:          Aᵀ λ = Bᵀ w,   -((∂A/∂θ) u)ᵀ λ     with the same factorisation

For (Re w̄ · d)'' δθ, with A' the derivative of A along δθ, A u' = -A' u - A δg and Aᵀ λ' = -A'ᵀ λ: two more solves a wave.
∂A/∂θ is a symbolic derivative of the integrand. `(∂A/∂θ) u` is assembled as sparse matrices where many products are needed, and as
linear forms for a single gradient. About a deformed body it includes the change of the equilibrium (`about_equilibrium`).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import ConvergenceError, InputError, check_shape
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.harmonic.factors import Factorised
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.sensitivity.harmonic.at_rest import AtRest
from ngbrain.forward.sensitivity.harmonic.medium import Medium
from ngbrain.forward.sensitivity.parameter_blocks import block_slices
from ngbrain.forward.sensitivity.parameters import Parameter
from ngbrain.solvers.newton import Newton

Array = np.ndarray
BOUNDARY = "boundary"
"""Name of the block of prescribed displacements (and translations): real, then imaginary parts of each wave (m)."""


class WaveModel:
    """Model from a parameter vector θ to complex displacements (m) at points.

    Parameters
    ----------
    body : HarmonicProblem
        At rest, or about the equilibrium of a deformed body.
    parameters : dict
        Name → parameter; their values one after the other, then the block `boundary`, are θ. At rest real GridFunctions of the
        material; for a deformed body everything that `StaticModel` takes, also in loss and density.
    points : array (n, 2 or 3)
        Measured points (m), at rest.
    newton : Newton, optional
        Settings for the equilibrium, as in `StaticModel`.
    steps : int
        Load steps from rest to the first equilibrium.

    Attributes
    ----------
    blocks : dict of str to slice
        Where each parameter is in θ.
    driven_dofs : array of int
        Degrees of freedom with prescribed displacements.

    Raises
    ------
    InputError
        For parameters that cannot be used and for points outside the mesh.

    Examples
    --------
    >>> from ngbrain.forward.harmonic.wave import Wave
    >>> from ngbrain.materials import Shearing
    >>> from ngbrain.mesh.geometry.structured import rectangles
    >>> mesh = rectangles(np.linspace(0, 0.1, 6), np.linspace(0, 0.1, 6))
    >>> storage = ngs.GridFunction(ngs.H1(mesh, order=1)); storage.Set(2000.0)
    >>> body = HarmonicProblem(mesh, Shearing(storage * (1 + 0.2j)), [Wave(50.0, {"top": (1e-3, 0)})], bulk=1e5, form="P2")
    >>> model = WaveModel(body, {"storage": storage}, np.array([[0.05, 0.05]]))
    >>> model.evaluate(model.theta).data.shape
    (1, 1, 2)
    """

    def __init__(
        self,
        body: HarmonicProblem,
        parameters: Mapping[str, Parameter],
        points: Array,
        newton: Newton | None = None,
        steps: int = 1,
    ) -> None:
        if BOUNDARY in parameters:
            raise InputError("parameters", repr(BOUNDARY), "another name: this is the block of boundary values")
        self.body, self.points = body, np.asarray(points, float)
        self.medium = _medium(body, parameters, newton, steps)
        self.dim = len(body.axes)
        scalar = evaluation(ngs.H1(body.mesh, order=body.form.order), self.points)
        if scalar.shape[1] * self.dim != body.displacement.ndof:
            raise InputError("form", str(body.form), "components of the displacement in spaces of their own")
        self._scalar = scalar
        self.driven_dofs = np.flatnonzero(body.fixed)
        sizes = {**self.medium.sizes, BOUNDARY: 2 * len(self.driven_dofs) * len(body.waves)}
        self.blocks = dict(zip(sizes, block_slices(list(sizes.values())), strict=True))
        self.size = sum(sizes.values())
        self.solves = self.medium.solves

    @property
    def fields(self) -> Mapping[str, ngs.GridFunction]:
        """Name → field, of a body at rest."""
        assert isinstance(self.medium, AtRest)
        return self.medium.fields

    @property
    def theta(self) -> Array:
        """Present parameters θ, boundary values included."""
        prescribed = [g[self.driven_dofs] for g in self.body.prescribed]
        return np.concatenate([self.medium.value, *(part for g in prescribed for part in (g.real, g.imag))])

    def evaluate(self, theta: Array) -> WaveLinearisation:
        """Waves at θ, with their derivatives; the body keeps the values of the last call.

        Raises `SolverError` at a resonance without loss, and for a deformed body the errors of `StaticModel`.
        """
        factors = self._factorised(theta)
        waves = np.array([factors.solve_wave(k, g) for k, g in enumerate(self.boundary_values(theta))])
        return WaveLinearisation(self, factors, waves)

    def linearise(self, theta: Array, waves: Array) -> WaveLinearisation:
        """Derivatives at θ and at given waves, such as measured ones, without solving for waves.

        Parameters
        ----------
        theta : array (size,)
            Parameters.
        waves : array (waves, ndof)
            Waves u.

        Returns
        -------
        WaveLinearisation
        """
        return WaveLinearisation(self, self._factorised(theta), np.asarray(waves, complex))

    def _factorised(self, theta: Array) -> Factorised:
        if np.shape(theta) != (self.size,):
            raise InputError("theta", f"of shape {np.shape(theta)}", f"{self.size} numbers")
        if not np.all(np.isfinite(theta)):
            raise ConvergenceError("parameters are not finite; reduce the step")
        self.medium.set_value(theta[: self.blocks[BOUNDARY].start])
        return self.body.factorise(self.solves)

    def boundary_values(self, theta: Array) -> Array:
        """Boundary values in θ, as arrays over all degrees of freedom (waves, ndof)."""
        parts = theta[self.blocks[BOUNDARY]].reshape(len(self.body.waves), 2, -1)
        g = np.zeros((len(parts), self.body.fes.ndof), complex)
        g[:, self.driven_dofs] = parts[:, 0] + 1j * parts[:, 1]
        return g

    def observe(self, u: Array) -> Array:
        """Values of a wave at the points (n, dim)."""
        width = self._scalar.shape[1]
        return _times(self._scalar, u[: self.dim * width].reshape(self.dim, width).T)

    @property
    def observation_matrix(self) -> sp.csr_array:
        """Matrix (n dim, ndof) of `observe`: all points of the first component, then of the next."""
        whole = sp.block_diag([self._scalar] * self.dim, format="csr")
        whole.resize((whole.shape[0], self.body.fes.ndof))
        return sp.csr_array(whole)

    @cached_property
    def elements(self) -> Array:
        """Element that contains each point (n,)."""
        return np.array(self.body.mesh(*self.points.T)["nr"])

    def observe_transpose(self, values: Array) -> Array:
        """Transpose of `observe`."""
        u = np.zeros(self.body.fes.ndof, complex)
        width = self._scalar.shape[1]
        u[: self.dim * width] = _times(self._transposed, values).T.ravel()
        return u

    @cached_property
    def _transposed(self) -> sp.csr_array:
        return sp.csr_array(self._scalar.T)


class WaveLinearisation:
    """Waves at one θ, and products with their derivatives. At rest it is valid until the model is evaluated again.

    Parameters
    ----------
    model : WaveModel
        The model.
    factors : Factorised
        Factorisations of A.
    waves : array (waves, ndof)
        Waves u.

    Attributes
    ----------
    data : array (waves, n, dim)
        Displacements (m) at the points.
    """

    def __init__(self, model: WaveModel, factors: Factorised, waves: Array) -> None:
        self.model, self.factors, self.waves = model, factors, waves
        self.data = np.array([model.observe(u) for u in waves])
        self.sensitivity = model.medium.sensitivity(waves)
        self._inner = slice(model.blocks[BOUNDARY].start)

    def displacement(self, number: int) -> ngs.GridFunction:
        """Complex displacement (m) of a wave."""
        gfu = ngs.GridFunction(self.model.body.displacement)
        gfu.vec.FV().NumPy()[:] = self.waves[number][: gfu.space.ndof]
        return gfu

    def jvp(self, direction: Array) -> Array:
        """Jacobian-vector product J δθ, with the shape of `data`."""
        return np.array([self.model.observe(u) for u in self.state_derivative(direction)])

    def state_derivative(self, direction: Array) -> Array:
        """Derivative of the waves along a direction of θ (waves, ndof)."""
        change = np.empty_like(self.waves)
        driven = self.model.boundary_values(direction)
        for k, pushed in enumerate(self.sensitivity.jvp(direction[self._inner])):
            b = -pushed
            if driven[k].any():
                b -= self.factors.apply(k, driven[k])
            still = not b.any()  # the direction may prescribe other displacements
            change[k] = 0 if still else self.factors.solve(k, b, "incremental") + driven[k]
        return change

    def vjp(self, w: Array) -> Array:
        """Re(Jᵀ w̄), the gradient of Re Σ w̄ · data, by the matrices that `jvp` uses."""
        adjoints = self._adjoints(w, "incremental")
        inner = self.sensitivity.vjp([adjoint for adjoint, _ in adjoints])
        return np.concatenate([-inner, self._of_boundary(adjoints)])

    def gradient(self, w: Array) -> Array:
        """As `vjp`, by linear forms: cheaper for a single product."""
        adjoints = self._adjoints(w, "adjoint")
        inner = self.sensitivity.gradient([adjoint for adjoint, _ in adjoints])
        return np.concatenate([-inner, self._of_boundary(adjoints)])

    def hvp(self, w: Array, direction: Array) -> Array:
        """Product of the second derivative of Re Σ w̄ · data with a direction.

        With w the derivative of a misfit, it is what the misfit's Hessian has beside the Gauss-Newton matrix.

        Parameters
        ----------
        w : array (waves, n, dim)
            Weights of the data.
        direction : array (size,)
            δθ.

        Returns
        -------
        array (size,)
        """
        model, how, factors, driven = self.model, self.sensitivity, self.factors, self.model.boundary_values(direction)
        adjoints = [adjoint for adjoint, _ in self._adjoints(w, "adjoint")]
        how.set_direction(direction[self._inner])
        changes, others, rests = [], [], []
        for k, adjoint in enumerate(adjoints):
            pushed = how.apply_derivative(k) + (factors.apply(k, driven[k]) if driven[k].any() else 0.0)
            bent = how.apply_derivative_transpose(k, adjoint)
            changes.append(driven[k] - factors.solve(k, pushed, "incremental"))
            other = -factors.solve(k, bent, "incremental", transposed=True)
            others.append(other)
            rests.append((other, -bent[model.driven_dofs] - factors.reactions(k, other, model.driven_dofs)))
        return np.concatenate([-how.gradient_derivative(adjoints, changes, others), self._of_boundary(rests)])

    def _adjoints(self, w: Array, purpose: str) -> list[tuple[Array, Array]]:
        """λ of each wave, and the residual of Bᵀ w̄ at the driven degrees of freedom."""
        check_shape("w", np.shape(w), self.data.shape)
        found, driving = [], self.model.driven_dofs
        for k, part in enumerate(np.conj(w)):
            if not part.any():
                found.append((np.zeros(self.model.body.fes.ndof, complex), np.zeros(len(driving), complex)))
                continue
            b = self.model.observe_transpose(part)
            adjoint = self.factors.solve(k, b, purpose, transposed=True)
            found.append((adjoint, b[driving] - self.factors.reactions(k, adjoint, driving)))
        return found

    def _of_boundary(self, adjoints: list[tuple[Array, Array]]) -> Array:
        return np.concatenate([part for _, rest in adjoints for part in (rest.real, -rest.imag)])


def _medium(body: HarmonicProblem, parameters: Mapping[str, Parameter], newton: Newton | None, steps: int) -> Medium:
    if body.state is None:
        return AtRest(body, parameters)
    from ngbrain.forward.sensitivity.harmonic.about_equilibrium import AboutEquilibrium

    return AboutEquilibrium(body, parameters, newton, steps)


def _times(matrix: sp.csr_array, columns: Array) -> Array:
    """Product of a real matrix with complex columns, part by part: SciPy would copy the matrix to complex numbers first."""
    parts = matrix @ np.ascontiguousarray(columns, complex).view(float)
    return np.asarray(parts.view(complex))
