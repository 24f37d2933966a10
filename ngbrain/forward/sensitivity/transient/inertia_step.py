"""Inertia in one time step: derivatives with respect to initial displacement, velocity, accelerations and density.

A step ends at u' with F(u') + c M(ρ) (u' - û) = 0. û, and velocity and accelerations at the end, are linear in u' and in the
initial values (`GeneralizedAlpha`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock
from ngbrain.forward.sensitivity.transient.friction_step import CarriedGradients
from ngbrain.forward.sensitivity.transient.quadrature_blocks import unknowns
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Terms, WorkIntegral, vector

Array = np.ndarray


class InertiaSensitivity:
    """Derivatives of inertia's part of a step, with the body at its end.

    Carried variables are one array (3 n,): velocity, acceleration and its average; so are their weights.

    Parameters
    ----------
    body : Problem
        Body with mass.
    parts : dict of str to ParameterBlock
        Blocks of θ.
    """

    in_reactions = True
    """Whether reactions at supports include these forces."""

    def __init__(self, body: Problem, parts: Mapping[str, ParameterBlock]) -> None:
        assert body.inertia is not None
        self.body, self.inertia, self._parts = body, body.inertia, list(parts.values())
        self._motion, self._n = ngs.GridFunction(body.fes), int(np.sum(body.is_u))
        self._going = ngs.GridFunction(body.u.space)
        self.size = 3 * self._n
        self._changes: list[Array] = []

    # Backwards.

    def adjoint_gradients(self, adjoint: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Gradients with respect to initial displacements, carried variables and θ.

        Parameters
        ----------
        adjoint : array (n,)
            λ.
        weights : array (3 n,)
            Weights of the carried variables at the end.

        Returns
        -------
        by_start, by_carried, by_theta : array
        """
        s, dt, _ = self._scheme
        by_target = -s.weight(dt) * (np.split(weights, 3)[1] + self.inertia.times(self._of_u(adjoint)))
        unknowns(self._motion)[:] = adjoint[: self.body.fes.ndof]
        by_start, carried = self._back(by_target, weights)
        return by_start, carried, np.concatenate([part() for part in self._by_theta])

    def _back(self, by_target: Array, weights: Array) -> tuple[Array, Array]:
        """Gradients with respect to start and carried variables, from those with respect to û and the variables carried on."""
        s, dt, beta_dt = self._scheme
        velocity, _, average = np.split(weights, 3)
        by_average = average + s.gamma * dt * velocity
        by_drift = by_target - by_average / beta_dt
        used = dt**2 * (0.5 - s.beta) * by_drift + dt * (1 - s.gamma) * velocity
        used -= beta_dt * s.alpha_m / (1 - s.alpha_m) * by_target
        before = beta_dt * s.alpha_f / (1 - s.alpha_m) * by_target
        kept = self.inertia.stretch
        found = np.concatenate([velocity + dt * by_drift, before + (1 - kept) * used, kept * used])
        return self._spread(by_drift), found

    def carried_state_gradient(self, weights: Array) -> Array:
        """Gradient of the weighted carried variables with respect to the end state (n,)."""
        s, dt, beta_dt = self._scheme
        velocity, acceleration, average = np.split(weights, 3)
        return self._spread((average + s.gamma * dt * velocity) / beta_dt + s.weight(dt) * acceleration)

    @cached_property
    def _by_theta(self) -> list[Callable[[], Array]]:
        return [part.gradient(self._work(self._motion), self.body.mesh) for part in self._parts]

    # Forwards.

    def residual_derivative(self, start: Array, carried: Array, theta: Sequence[Array]) -> Array:
        """Derivative of the forces along changes of start, carried variables and θ.

        Parameters
        ----------
        start : array (n,)
            Change of the initial displacements.
        carried : array (3 n,)
            Change of the carried variables.
        theta : sequence of array
            Change of each parameter.

        Returns
        -------
        array (n,)
        """
        s, dt, beta_dt = self._scheme
        velocity, acceleration, average = np.split(carried, 3)
        used = acceleration + (average - acceleration) * self.inertia.stretch
        drift = self._of_u(start) + dt * velocity + dt**2 * (0.5 - s.beta) * used
        target = drift - beta_dt * (s.alpha_m * used - s.alpha_f * acceleration) / (1 - s.alpha_m)
        self._changes = [velocity, used, drift, target]
        for part, way in zip(self._parts, theta, strict=False):
            part.set_direction(way)
        return self._spread(-s.weight(dt) * self.inertia.times(target), self._changed())

    def carried_derivative(self, end: Array) -> Array:
        """Derivative of the carried variables at the end, with the last `residual_derivative`."""
        s, dt, beta_dt = self._scheme
        velocity, used, drift, target = self._changes
        u = self._of_u(end)
        average = (u - drift) / beta_dt
        velocity = velocity + dt * ((1 - s.gamma) * used + s.gamma * average)
        return np.concatenate([velocity, s.weight(dt) * (u - target), average])

    @cached_property
    def _changed(self) -> Callable[[], Array]:
        still = self._work(self.body.fes.TestFunction())
        return vector(self.body.fes, [term for part in self._parts for term in part.directional_derivative(still)])

    # Second derivatives: only the product of density and displacement is nonlinear.

    def set_direction(self, end: Array, start: Array, carried: Array, theta: Sequence[Array]) -> None:
        """Set the direction of second derivatives.

        Parameters
        ----------
        end, start : array (n,)
            Changes of the step's end and start.
        carried : array (3 n,)
            Change of the carried variables.
        theta : sequence of array
            Change of each parameter.
        """
        self.residual_derivative(start, carried, theta)
        unknowns(self._going)[:] = self._of_u(end) - self._changes[-1]

    def gradient_derivatives(self, adjoint: Array, weights: Array) -> CarriedGradients:
        """Derivatives of the gradients along the direction.

        Parameters
        ----------
        adjoint : array (n,)
            λ.
        weights : array (3 n,)
            Weights of the carried variables.

        Returns
        -------
        CarriedGradients
        """
        unknowns(self._motion)[:] = adjoint[: self.body.fes.ndof]
        by_end = self._heavier()[self.body.is_u]
        by_start, carried = self._back(-by_end, np.zeros(self.size))
        return CarriedGradients(
            self._spread(by_end), by_start, carried, np.concatenate([part() for part in self._turned_by_theta])
        )

    @cached_property
    def _heavier(self) -> Callable[[], Array]:
        """c ∫ ρ' v · λ dV."""
        v = self.body.layout.fields(self.body.fes.TestFunction()).u
        still = [WorkIntegral(*self.inertia.mass_work(v, self.body.layout.fields(self._motion).u))]
        return vector(self.body.fes, [term for part in self._parts for term in part.directional_derivative(still)])

    @cached_property
    def _turned_by_theta(self) -> list[Callable[[], Array]]:
        going = [WorkIntegral(*self.inertia.mass_work(self._going, self.body.layout.fields(self._motion).u))]
        bent = [term for part in self._parts for term in part.directional_derivative(self._work(self._motion))]
        return [part.gradient(going + bent, self.body.mesh) for part in self._parts]

    def _work(self, motion: Motion) -> Terms:
        """c ∫ ρ (u - û) · λ dV."""
        return [WorkIntegral(*self.inertia.work(self.body.u, self.body.layout.fields(motion).u))]

    @property
    def _scheme(self) -> tuple:
        """The scheme, Δt and β Δt²."""
        s, dt = self.inertia.scheme, self.inertia.dt
        return s, dt, s.beta * dt**2

    def _of_u(self, x: Array) -> Array:
        return x[: self.body.fes.ndof][self.body.is_u]

    def _spread(self, of_u: Array, more: Array | float = 0.0) -> Array:
        """Vector over all unknowns, from one over displacements and, optionally, one over the space."""
        found, n = np.zeros(len(self.body.x)), self.body.fes.ndof
        found[:n] += more
        found[:n][self.body.is_u] += of_u
        return found
