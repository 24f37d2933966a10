"""How waves at measured points change with the fields that a body is made of, and with what drives its boundary.

For the discrete problem A(θ) u = b with u = g on the boundary and data d = B u,

    J δθ = B δu,   A δu = -(∂A/∂θ δθ) u - A δg        one solve for each wave
    Jᵀ w:          A λ = Bᵀ w,   -((∂A/∂θ) u)ᵀ λ      the same factor, as A is symmetric

and second derivatives by two solves more for each wave (`wave_curvature`).
∂A/∂θ comes from the integrand by differentiation, `(∂A/∂θ) u` as one sparse matrix where many products are wanted and as
one linear form where only a gradient is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import ConvergenceError, InputError, shaped
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.harmonic.factors import Factorised, sparse
from ngbrain.forward.harmonic.problem import Harmonic
from ngbrain.forward.sensitivity.harmonic.hessian import Turned
from ngbrain.forward.sensitivity.harmonic.slopes import Pair, Slope, alike, along, complexified

Array = np.ndarray
BOUNDARY = "boundary"
"""Name of the block of held displacements (and translations): real parts, then imaginary parts, for each wave (m)."""


class WaveModel:
    """From a vector θ to complex displacements at points (`dim` components).

    body     whose law is made of `fields`
    fields   name → real GridFunction; their unknowns one after the other, then the block `boundary`, are θ
    points   (n, 2 or 3) m where waves are measured

    >>> from ngbrain.forward.harmonic.problem import Wave
    >>> from ngbrain.materials import Shearing
    >>> from ngbrain.mesh.grid import rectangles
    >>> mesh = rectangles(np.linspace(0, 0.1, 6), np.linspace(0, 0.1, 6))
    >>> storage = ngs.GridFunction(ngs.H1(mesh, order=1)); storage.Set(2000.0)
    >>> body = Harmonic(mesh, Shearing(storage * (1 + 0.2j)), [Wave(50.0, {"top": (1e-3, 0)})], bulk=1e5, form="P2")
    >>> model = WaveModel(body, {"storage": storage}, np.array([[0.05, 0.05]]))
    >>> model.at(model.theta).data.shape
    (1, 1, 2)
    """

    def __init__(self, body: Harmonic, fields: Mapping[str, ngs.GridFunction], points: Array) -> None:
        if BOUNDARY in fields:
            raise InputError("fields", repr(BOUNDARY), "another name: this is what drives the boundary")
        for name, field in fields.items():
            if field.space.is_complex:
                raise InputError(f"fields.{name}", "complex", "a real field; storage and loss are one each")
        self.body, self.fields, self.points = body, dict(fields), np.asarray(points, float)
        self.dim = len(body.axes)
        scalar = evaluation(ngs.H1(body.mesh, order=body.form.order), self.points)
        if scalar.shape[1] * self.dim != body.displacement.ndof:
            raise InputError("form", str(body.form), "components of the displacement in spaces of their own")
        self._scalar = scalar
        self.driving = np.flatnonzero(body.held)
        sizes = {name: field.space.ndof for name, field in self.fields.items()}
        sizes[BOUNDARY] = 2 * len(self.driving) * len(body.waves)
        ends = np.cumsum(list(sizes.values()))
        self.blocks = {
            name: slice(int(end - size), int(end)) for (name, size), end in zip(sizes.items(), ends, strict=True)
        }
        self.size = int(ends[-1])
        self.solves = Solves()
        self._slopes = dict[tuple[float, str], Slope]()

    @property
    def theta(self) -> Array:
        """θ of the fields and boundary values as the body has them now."""
        held = [g[self.driving] for g in self.body.prescribed]
        parts = [field.vec.FV().NumPy() for field in self.fields.values()]
        return np.concatenate([*parts, *(part for g in held for part in (g.real, g.imag))])

    def at(self, theta: Array) -> Linearised:
        """Waves of θ, and their derivatives; the fields keep the values of the last call."""
        factors = self._factorised(theta)
        waves = np.array([factors.driven(k, g) for k, g in enumerate(self.held(theta))])
        return Linearised(self, factors, waves)

    def around(self, theta: Array, waves: Array) -> Linearised:
        """Derivatives at θ and at any waves (loads, ndof), such as measured ones: nothing is solved."""
        return Linearised(self, self._factorised(theta), np.asarray(waves, complex))

    def _factorised(self, theta: Array) -> Factorised:
        if np.shape(theta) != (self.size,):
            raise InputError("theta", f"of shape {np.shape(theta)}", f"{self.size} numbers")
        if not np.all(np.isfinite(theta)):
            raise ConvergenceError("parameters that are not finite have no waves: a step too far")
        for name, field in self.fields.items():
            field.vec.FV().NumPy()[:] = theta[self.blocks[name]]
        return self.body.factorised(self.solves)

    def held(self, theta: Array) -> Array:
        """Boundary values in θ as arrays over all unknowns (waves, ndof)."""
        parts = theta[self.blocks[BOUNDARY]].reshape(len(self.body.waves), 2, -1)
        g = np.zeros((len(parts), self.body.fes.ndof), complex)
        g[:, self.driving] = parts[:, 0] + 1j * parts[:, 1]
        return g

    def observed(self, u: Array) -> Array:
        """Unknowns of a wave to values at the points (n, dim)."""
        width = self._scalar.shape[1]
        return _times(self._scalar, u[: self.dim * width].reshape(self.dim, width).T)

    @property
    def observation(self) -> sp.csr_array:
        """The matrix (n dim, ndof) of `observed`: all points of the first component, then of the next."""
        whole = sp.block_diag([self._scalar] * self.dim, format="csr")
        whole.resize((whole.shape[0], self.body.fes.ndof))
        return sp.csr_array(whole)

    @cached_property
    def alike(self) -> dict[float, dict[str, tuple[str, complex]]]:
        """For each angular frequency (rad/s) the fields that one integral serves, see `slopes.alike`."""
        return {omega: alike(self.body, self.fields, omega) for omega in {wave.omega for wave in self.body.waves}}

    def firsts(self, omega: float) -> list[str]:
        """Fields that need integrals of their own."""
        return [name for name, (first, _) in self.alike[omega].items() if name == first]

    def slope(self, omega: float, name: str) -> Slope:
        """How the matrices change with a field, between as many pairs of waves as there are of this frequency; kept."""
        if (omega, name) not in self._slopes:
            number = sum(wave.omega == omega for wave in self.body.waves)
            self._slopes[omega, name] = Slope(self.body, omega, self.fields[name], number)
        return self._slopes[omega, name]

    @cached_property
    def turned(self) -> Turned:
        """How the matrices change along a direction of the fields, for second derivatives."""
        return Turned(self)

    @cached_property
    def elements(self) -> Array:
        """In which element each point lies (n,)."""
        return np.array(self.body.mesh(*self.points.T)["nr"])

    def spread(self, values: Array) -> Array:
        """The transpose of `observed`."""
        u = np.zeros(self.body.fes.ndof, complex)
        width = self._scalar.shape[1]
        u[: self.dim * width] = _times(self._turned, values).T.ravel()
        return u

    @cached_property
    def _turned(self) -> sp.csr_array:
        return sp.csr_array(self._scalar.T)


class Linearised:
    """Waves at one θ: `data` (waves, n, dim) in m, and the products of J and Jᵀ. It is of use until the model moves on."""

    def __init__(self, model: WaveModel, factors: Factorised, waves: Array) -> None:
        self.model, self.factors, self.waves = model, factors, waves
        self.data = np.array([model.observed(u) for u in waves])
        self._sensitivities: list[sp.csr_array] | None = None

    def push(self, direction: Array) -> Array:
        """J δθ, as `data`."""
        return np.array([self.model.observed(u) for u in self.along(direction)])

    def along(self, direction: Array) -> Array:
        """How waves change, in all unknowns (waves, ndof)."""
        change = np.empty_like(self.waves)
        fields = direction[: self.model.blocks[BOUNDARY].start]
        driven = self.model.held(direction)
        for k, sensitivity in enumerate(self.sensitivities):
            b = -(sensitivity @ fields)
            if driven[k].any():
                b -= self.factors.apply(k, driven[k])
            still = not b.any()  # of a direction that drives another wave
            change[k] = 0 if still else self.factors.solve(k, b, "incremental") + driven[k]
        return change

    def pull(self, w: Array) -> Array:
        """Re(Jᵀ w̄), the gradient of Re Σ w̄ · data, by the matrices that `push` uses."""
        adjoints = self._adjoints(w, "incremental")
        parts = [s.T @ adjoint for s, (adjoint, _) in zip(self.sensitivities, adjoints, strict=True)]
        return np.concatenate([-np.sum(parts, axis=0).real, self._of_boundary(adjoints)])

    def gradient(self, w: Array) -> Array:
        """The same as `pull` by one linear form: cheaper for a single product."""
        model = self.model
        adjoints = self._adjoints(w, "adjoint")
        pairs: dict[float, list[Pair]] = {}
        for k, (adjoint, _) in enumerate(adjoints):
            pairs.setdefault(model.body.waves[k].omega, []).append((self.waves[k], adjoint))
        total = {name: np.zeros(field.space.ndof) for name, field in model.fields.items()}
        for omega, both in pairs.items():
            slopes = {name: model.slope(omega, name)(both) for name in model.firsts(omega)}
            for name, (first, r) in model.alike[omega].items():
                total[name] -= (r * slopes[first]).real
        return np.concatenate([*total.values(), self._of_boundary(adjoints)])

    def second(self, w: Array, direction: Array) -> Array:
        """(Re Σ w̄ · data)'' δθ: what the curvature of a misfit has beside the Gauss-Newton matrix, with w the misfit's slope."""
        model, turned, driven = self.model, self.model.turned, self.model.held(direction)
        turned.aim(direction)
        pairs: dict[float, tuple[list[Pair], list[Pair]]] = {}
        rests = []
        for k, (adjoint, _) in enumerate(self._adjoints(w, "adjoint")):
            omega, wave = model.body.waves[k].omega, self.waves[k]
            pushed = turned.times(omega, wave) + (self.factors.apply(k, driven[k]) if driven[k].any() else 0.0)
            bent = turned.times(omega, adjoint)
            change = driven[k] - self.factors.solve(k, pushed, "incremental")
            other = -self.factors.solve(k, bent, "incremental")
            both, same = pairs.setdefault(omega, ([], []))
            both += [(wave, other), (change, adjoint)]
            same.append((wave, adjoint))
            rests.append((other, -bent[model.driving] - self.factors.reactions(k, other, model.driving)))
        total = {name: np.zeros(field.space.ndof) for name, field in model.fields.items()}
        for omega, (both, same) in pairs.items():
            slopes = {}
            for name in model.firsts(omega):
                moved = model.slope(omega, name)(both[::2]) + model.slope(omega, name)(both[1::2])
                slopes[name] = moved + turned.slope(omega, name, same)
            for name, (first, r) in model.alike[omega].items():
                total[name] -= (r * slopes[first]).real
        return np.concatenate([*total.values(), self._of_boundary(rests)])

    @property
    def sensitivities(self) -> Sequence[sp.csr_array]:
        """(∂A/∂θ) u of each wave (ndof, unknowns of the fields), assembled when first asked for."""
        if self._sensitivities is None:
            self._sensitivities = [self._sensitivity(k) for k in range(len(self.waves))]
        return self._sensitivities

    def _sensitivity(self, k: int) -> sp.csr_array:
        body, omega = self.model.body, self.model.body.waves[k].omega
        u, test = self._function(self.waves[k]), body.fes.TestFunction()
        columns = {}
        for name in self.model.firsts(omega):
            field = self.model.fields[name]
            space = complexified(field.space)
            form = ngs.BilinearForm(trialspace=space, testspace=body.fes)
            work = body.terms(omega, u, test, along(field, space.TrialFunction()))
            if work is not None:
                form += work
            form.Assemble()
            columns[name] = sparse(form.mat)
        return sp.csr_array(sp.hstack([r * columns[first] for first, r in self.model.alike[omega].values()]))

    def _adjoints(self, w: Array, purpose: str) -> list[tuple[Array, Array]]:
        """For each wave λ and what is left of Bᵀ w̄ at the driven unknowns."""
        shaped("w", np.shape(w), self.data.shape)
        found, driving = [], self.model.driving
        for k, part in enumerate(np.conj(w)):
            if not part.any():
                found.append((np.zeros(self.model.body.fes.ndof, complex), np.zeros(len(driving), complex)))
                continue
            b = self.model.spread(part)
            adjoint = self.factors.solve(k, b, purpose)
            found.append((adjoint, b[driving] - self.factors.reactions(k, adjoint, driving)))
        return found

    def _of_boundary(self, adjoints: list[tuple[Array, Array]]) -> Array:
        return np.concatenate([part for _, rest in adjoints for part in (rest.real, -rest.imag)])

    def _function(self, u: Array) -> ngs.GridFunction:
        gfu = ngs.GridFunction(self.model.body.fes)
        gfu.vec.FV().NumPy()[:] = u
        return gfu


def _times(matrix: sp.csr_array, columns: Array) -> Array:
    """A real matrix times complex columns, by their parts: scipy would first copy the matrix to complex numbers."""
    parts = matrix @ np.ascontiguousarray(columns, complex).view(float)
    return np.asarray(parts.view(complex))
