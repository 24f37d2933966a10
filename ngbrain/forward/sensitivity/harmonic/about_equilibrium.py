"""Derivatives of the system matrix of a deformed body, including those of its static equilibrium.

    (∂A/∂θ δθ) v = A_θ δθ v + A_u δu₀ v ,    K δu₀ = -R_θ δθ ,    K = E''

Transposed products need one adjoint solve of the equilibrium for all waves together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ngbrain.forward.harmonic.about_state import AboutState
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.observables.points import SolutionUnknowns
from ngbrain.forward.sensitivity.harmonic.state_work import StateWork
from ngbrain.forward.sensitivity.parameters import Parameter
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticLinearisation, StaticModel
from ngbrain.solvers.newton import Newton

Array = np.ndarray


class AboutEquilibrium:
    """A deformed body, with parameters as blocks of θ; setting them solves for the equilibrium.

    Parameters
    ----------
    body : HarmonicProblem
        Waves about the body's equilibrium.
    parameters : dict
        As in `StaticModel`; loss and density may depend on them too.
    newton : Newton or None
        Settings for the equilibrium.
    steps : int
        Load steps from rest.
    """

    def __init__(
        self, body: HarmonicProblem, parameters: Mapping[str, Parameter], newton: Newton | None, steps: int
    ) -> None:
        state = body.state
        assert isinstance(state, AboutState)
        self.body = body
        self.static = StaticModel([LoadCase(state.body, [SolutionUnknowns()])], parameters, newton, steps)
        self.solves = self.static.solves
        self.sizes = {name: part.size for name, part in self.static.parts.items()}
        self.work = StateWork(state, self.static.parts.values())

    @property
    def value(self) -> Array:
        """Present parameters θ."""
        return self.static.theta

    def set_value(self, values: Array) -> None:
        """Set θ and solve for the equilibrium."""
        self._there = self.static.evaluate(values)

    def sensitivity(self, waves: Array) -> StateSensitivity:
        """Derivatives at the last equilibrium; they stay valid when others are computed."""
        return StateSensitivity(self, self._there, waves)


class StateSensitivity:
    """Implements `Sensitivity` for a deformed body.

    Parameters
    ----------
    medium : AboutEquilibrium
        The body.
    there : StaticLinearisation
        Its equilibrium.
    waves : array (waves, ndof)
        Waves v.
    """

    def __init__(self, medium: AboutEquilibrium, there: StaticLinearisation, waves: Array) -> None:
        self._medium, self._there, self._waves = medium, there, waves
        self._omegas = [wave.omega for wave in medium.body.waves]
        self._direction = np.zeros(0)

    def jvp(self, direction: Array) -> Sequence[Array]:
        """(∂A/∂θ δθ) v of each wave."""
        moved = self._there.jvp(direction)
        return [by_theta @ direction + by_state @ moved for by_state, by_theta in self._matrices]

    def vjp(self, adjoints: Sequence[Array]) -> Array:
        """Σ Re λᵀ (∂A/∂θ) v."""
        parts = zip(adjoints, self._matrices, strict=True)
        found = [((by_state.T @ a).real, (by_theta.T @ a).real) for a, (by_state, by_theta) in parts]
        by_state, by_theta = (np.sum(part, axis=0) for part in zip(*found, strict=True))
        return by_theta + self._there.vjp(by_state)

    def gradient(self, adjoints: Sequence[Array]) -> Array:
        """As `vjp`, by linear forms."""
        by_state, by_theta = self._slopes(adjoints)
        return by_theta + self._there.gradient(by_state)

    def set_direction(self, direction: Array) -> None:
        """Set a direction of θ, and the resulting change of the equilibrium."""
        self._direction = direction
        self._medium.work.set_direction(self._there.state_derivative(direction)[0], direction)

    def apply_derivative(self, number: int) -> Array:
        """A' v."""
        return self._medium.work.apply_derivative(self._omegas[number], self._waves[number])

    def apply_derivative_transpose(self, number: int, adjoint: Array) -> Array:
        """A'ᵀ λ.

        Parameters
        ----------
        number : int
            Index of the wave.
        adjoint : array (ndof,)
            λ.

        Returns
        -------
        array (ndof,)
        """
        return self._medium.work.apply_derivative_transpose(self._omegas[number], adjoint)

    def gradient_derivative(
        self, adjoints: Sequence[Array], changes: Sequence[Array], others: Sequence[Array]
    ) -> Array:
        """Derivative of `gradient`: of the matrix, and of the equilibrium.

        Parameters
        ----------
        adjoints, changes, others : sequence of array (ndof,)
            λ, v' and λ' of each wave.

        Returns
        -------
        array (size,)
        """
        work = self._medium.work
        first, _ = self._slopes(adjoints)
        by_state, by_theta = np.zeros(len(first)), np.zeros(len(self._direction))
        parts = zip(self._omegas, self._waves, adjoints, changes, others, strict=True)
        for omega, wave, adjoint, change, other in parts:
            for state, theta in (
                work.gradient(omega, change, adjoint),
                work.gradient(omega, wave, other),
                work.gradient_derivative(omega, wave, adjoint),
            ):
                by_state, by_theta = by_state + state, by_theta + theta
        return by_theta + self._there.vjp(by_state) + self._there.hvp(first, self._direction)

    def _slopes(self, adjoints: Sequence[Array]) -> tuple[Array, Array]:
        """Gradient of Σ Re λᵀ A v with respect to the state, and to θ at fixed state."""
        self._medium.static.restore(self._there)
        parts = zip(self._omegas, self._waves, adjoints, strict=True)
        found = [self._medium.work.gradient(omega, wave, adjoint) for omega, wave, adjoint in parts]
        by_state, by_theta = (np.sum(part, axis=0) for part in zip(*found, strict=True))
        return by_state, by_theta

    @cached_property
    def _matrices(self) -> Sequence[tuple[sp.csr_array, sp.csr_array]]:
        """∂(A v)/∂u₀ (ndof, ndof) and ∂(A v)/∂θ (ndof, size) of each wave, assembled at first use."""
        self._medium.static.restore(self._there)
        return [
            self._medium.work.sensitivity(omega, wave) for omega, wave in zip(self._omegas, self._waves, strict=True)
        ]
