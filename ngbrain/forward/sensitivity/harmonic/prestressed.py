"""Waves of small amplitude in a body that is deformed already, and how they change with what its energy is made of.

On an equilibrium u₀ of the energy E, R(u₀; θ) = E'(u₀; θ) = 0, moves u₀ + Re(v e^{iωt}) with v = g where it is driven and

    A v = 0 ,    A = E''(u₀; θ) + iη W_iso''(u₀; θ) - ω² M

so that A is the tangent of all that acts on the body, its stress included (acoustoelasticity), and the loss is a ratio η of
that of the laws of shape: G* = μ (1 + iη) at rest. A loss that depends on frequency takes a model for each. Coordinates, points
and densities ρ are those of rest. Data are d = B v:

    J δθ :       K δu₀ = -R_θ δθ ,    A δv = -(A_θ δθ + A_u δu₀) v ,    K = E''
    Re(Jᵀ w̄):    Aᵀ λ = Bᵀ w̄ ,        Kᵀ κ = -∂(λᵀ A v)/∂u₀ ,           -∂(λᵀ A v)/∂θ - R_θᵀ κ       real parts

and (Re w̄ · d)'' δθ with A' for the change of A along δθ and δu₀, A v' = -A' v and Aᵀ λ' = -A'ᵀ λ. All of it from the energies by
symbols. Source: Ogden 2007, 10.1007/978-3-211-73572-5_1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TypeAlias

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError, shaped
from ngbrain.forward.common.dirichlet import Supports
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.harmonic.problem import Wave
from ngbrain.forward.observables.points import Displacements, Unknowns
from ngbrain.forward.sensitivity.harmonic.prestressed_factor import Factor
from ngbrain.forward.sensitivity.harmonic.prestressed_work import WaveWork
from ngbrain.forward.sensitivity.harmonic.slopes import complexified
from ngbrain.forward.sensitivity.parameter_blocks import Parameter
from ngbrain.forward.sensitivity.static_model import Case, Equilibria, StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials.base import Value, checked, positive
from ngbrain.solvers.newton import Newton

__all__ = ["Prestressed", "PrestressedModel"]

Array = np.ndarray
Held: TypeAlias = str | Mapping[str, str] | None


class PrestressedModel:
    """From a vector θ to complex displacements (m) at points of a body that is in equilibrium under its loads.

    body        elastic, with its supports and loads
    waves       frequencies (Hz) and what is `held` where (m, complex); waves without tractions and forces
    points      (n, 2 or 3) m, where they are at rest
    parameters  name → what is θ, as in `StaticModel`; `loss` and `rho` may be made of them too
    loss        η, a number or a field
    rho         ρ (kg/m³) at rest
    held        boundaries that waves hold: a pattern, or patterns by component as in `Harmonic`; unasked where the body is held
    newton, steps  as in `StaticModel`

    Raises `InputError` for what makes no sense; `at` raises `SolverError` at a resonance without loss, and what `StaticModel` does.

    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh.grid import rectangles
    >>> mesh = rectangles(np.linspace(0, 0.1, 4), np.linspace(0, 0.1, 4))
    >>> mu = ngs.Parameter(2e3)
    >>> body = Problem(mesh, {".*": Material(NeoHooke(mu), 1e5)}, {"bottom": 0, "top": (0, -0.02)}, element="Q2/Q1")
    >>> model = PrestressedModel(body, [Wave(30.0, {"top": (1e-3, 0)})], [[0.05, 0.05]], {"mu": mu}, loss=0.2)
    >>> there = model.at(model.theta)
    >>> there.data.shape, there.gradient(there.data).shape
    ((1, 1, 2), (1,))
    """

    def __init__(
        self,
        body: Problem,
        waves: Sequence[Wave],
        points: Array,
        parameters: Mapping[str, Parameter],
        *,
        loss: Value = 0.0,
        rho: Value = 1000.0,
        held: Held = None,
        newton: Newton | None = None,
        steps: int = 1,
    ) -> None:
        if not waves:
            raise InputError("waves", "none", "one Wave or more")
        self.body, self.waves = body, tuple(waves)
        self.loss = checked(loss, "loss", lambda ratio: ratio >= 0, "a number of at least 0")
        self.rho = positive(rho, "rho")
        self.static = StaticModel([Case(body, [Unknowns()])], parameters, newton, steps)
        self.observation = sp.csr_array(Displacements(points).on(body).matrix)
        """B (n · dim, ndof)."""
        self.held = _held(body, held)
        """Which unknowns waves hold (ndof,)."""
        self.prescribed = [self._prescribed(wave) for wave in self.waves]
        """Where (m), one array (ndof,) for each wave; zero elsewhere."""
        self.symmetric = body.symmetric
        self.work = WaveWork(body, self.static.parts.values(), self.loss, self.rho)

    @property
    def theta(self) -> Array:
        """θ as the body has it now."""
        return self.static.theta

    @property
    def blocks(self) -> Mapping[str, slice]:
        """Name → where in θ."""
        return self.static.blocks

    @property
    def size(self) -> int:
        """Of θ."""
        return self.static.size

    @property
    def solves(self) -> Solves:
        """What was done, in equilibrium and for waves."""
        return self.static.solves

    def at(self, theta: Array) -> Prestressed:
        """Waves on the equilibrium at θ, and their derivatives."""
        return Prestressed(self, self.static.at(theta))

    def _prescribed(self, wave: Wave) -> Array:
        if wave.traction or wave.force is not None:
            raise InputError("Wave", "a traction or a force", "what is held alone, on a body that is deformed")
        g, dim = np.zeros(self.body.fes.ndof, complex), self.body.mesh.dim
        space = self.body.u.space
        for pattern, vector in wave.held.items():
            size = vector.dim if isinstance(vector, ngs.CoefficientFunction) else len(vector)
            if size != dim:
                raise InputError("Wave.held", f"a vector of {size} components", f"{dim} components")
            parts = [
                Supports(self.body.mesh, {pattern: tuple(of(vector[i]) for i in range(dim))}).coefficients(space)
                for of in (lambda part: part.real, lambda part: part.imag)
            ]
            there, values = parts[0][1], parts[0][0] + 1j * parts[1][0]
            for span in (slice(part.start, part.stop) for part in map(space.Range, range(dim))):
                if values[span].any() and np.any(there[span] & ~self.held[span]):
                    raise InputError("Wave.held", repr(pattern), "boundaries that are held along what is prescribed")
            g[: len(there)][there] = values[there]
        return np.where(self.held, g, 0)


class Prestressed:
    """Waves at one θ: `data` (waves, n, dim) in m, and the products of J and Jᵀ.

    there  the body's equilibrium
    waves  all unknowns of each wave (waves, ndof)
    """

    def __init__(self, model: PrestressedModel, there: Equilibria) -> None:
        self.model, self.there = model, there
        model.static.bring(there)
        free = ~model.held
        self._factors: dict[float, Factor] = {}
        matrices = model.work.matrices()
        waves = []
        for wave, g in zip(model.waves, model.prescribed, strict=True):
            if wave.omega not in self._factors:
                entries = matrices(wave.omega)
                self._factors[wave.omega] = Factor(model.work.pattern, entries, free, model.symmetric, model.solves)
            factor = self._factors[wave.omega]
            waves.append(g + factor.solve(-(factor.matrix @ g), "forward"))
        self.waves = np.array(waves)
        self.data = np.array([self._observed(v) for v in waves])

    def displacement(self, number: int) -> ngs.GridFunction:
        """Amplitudes (m, complex) of a wave, a vector over the mesh at rest."""
        gfu = ngs.GridFunction(complexified(self.model.body.u.space))
        gfu.vec.FV().NumPy()[:] = self.waves[number][: gfu.space.ndof]
        return gfu

    def push(self, direction: Array) -> Array:
        """J δθ, as `data`."""
        moved = self.there.push(direction)
        changes = []
        for wave, (by_state, by_theta) in zip(self.model.waves, self.sensitivities, strict=True):
            b = -(by_theta @ direction + by_state @ moved)
            changes.append(self._observed(self._factors[wave.omega].solve(b, "incremental")))
        return np.array(changes)

    def pull(self, w: Array) -> Array:
        """Re(Jᵀ w̄), the gradient of Re Σ w̄ · data, by the matrices that `push` uses."""
        of_state, of_theta = np.zeros(len(self.there.data)), np.zeros(self.model.size)
        adjoints = self._adjoints(w, "incremental")
        for adjoint, (by_state, by_theta) in zip(adjoints, self.sensitivities, strict=True):
            of_state -= (by_state.T @ adjoint).real
            of_theta -= (by_theta.T @ adjoint).real
        return of_theta + self.there.pull(of_state)

    def gradient(self, w: Array) -> Array:
        """The same as `pull` by linear forms: cheaper for a single product."""
        work, adjoints = self.model.work, self._adjoints(w, "adjoint")
        self.model.static.bring(self.there)
        of_state, of_theta = np.zeros(len(self.there.data)), np.zeros(self.model.size)
        for wave, v, adjoint in zip(self.model.waves, self.waves, adjoints, strict=True):
            by_state, by_theta = work.slopes(wave.omega, v, adjoint)
            of_state -= by_state
            of_theta -= by_theta
        return of_theta + self.there.gradient(of_state)

    def second(self, w: Array, direction: Array) -> Array:
        """(Re Σ w̄ · data)'' δθ: what the curvature of a misfit has beside the Gauss-Newton matrix, with w the misfit's slope."""
        work, adjoints = self.model.work, self._adjoints(w, "adjoint")
        work.aim(self.there.along(direction)[0], direction)
        first, change = np.zeros(len(self.there.data)), np.zeros(len(self.there.data))
        total = np.zeros(self.model.size)
        for wave, v, adjoint in zip(self.model.waves, self.waves, adjoints, strict=True):
            omega, factor = wave.omega, self._factors[wave.omega]
            moved = -factor.solve(work.turned(omega, v), "incremental")
            other = -factor.solve(work.turned_back(omega, adjoint), "incremental", True)
            first -= work.slopes(omega, v, adjoint)[0]
            slopes = [
                work.slopes(omega, moved, adjoint),
                work.slopes(omega, v, other),
                work.turned_slopes(omega, v, adjoint),
            ]
            change -= sum(by_state for by_state, _ in slopes)
            total -= sum(by_theta for _, by_theta in slopes)
        return total + self.there.pull(change) + self.there.second(first, direction)

    @cached_property
    def sensitivities(self) -> Sequence[tuple[sp.csr_array, sp.csr_array]]:
        """∂(A v)/∂u₀ (ndof, ndof) and ∂(A v)/∂θ (ndof, size) of each wave, assembled when first asked for."""
        self.model.static.bring(self.there)
        return [
            self.model.work.sensitivity(wave.omega, v) for wave, v in zip(self.model.waves, self.waves, strict=True)
        ]

    def _adjoints(self, w: Array, purpose: str) -> list[Array]:
        shaped("w", np.shape(w), self.data.shape)
        found = []
        for wave, part in zip(self.model.waves, np.conj(w), strict=True):
            found.append(self._factors[wave.omega].solve(self.model.observation.T @ np.ravel(part), purpose, True))
        return found

    def _observed(self, v: Array) -> Array:
        return np.asarray(self.model.observation @ v).reshape(-1, self.model.body.mesh.dim)


def _held(body: Problem, asked: Held) -> Array:
    """Which unknowns waves hold."""
    mask = body.held
    if asked is not None:
        names = "xyz"[: body.mesh.dim]
        axes = dict.fromkeys(names, asked) if isinstance(asked, str) else asked
        if not set(axes) <= set(names):
            raise InputError("held", sorted(axes), f"patterns for axes among {', '.join(names)}")
        values = {p: tuple(0.0 if axes.get(axis) == p else None for axis in names) for p in axes.values() if p}
        mask = Supports(body.mesh, values).coefficients(body.u.space)[1]
    return np.pad(mask, (0, body.fes.ndof - len(mask)))
