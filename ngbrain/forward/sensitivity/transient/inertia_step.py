"""How inertia's part of a time step changes with where the step begins, how fast and with what accelerations, and with the density.

A step ends at u' with F(u') + c M(ρ) (u' - û) = 0; û, and velocity and accelerations at its end, are linear in u' and in what it
begins with (`GeneralizedAlpha`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ngbrain.forward.sensitivity.parameter_blocks import Block
from ngbrain.forward.sensitivity.transient.quadrature_blocks import values
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Term, Terms, vector

Array = np.ndarray


class InertiaStep:
    """Of a body with mass, at the end of a step where it stands; parameters as `parts`.

    What is carried from step to step is one array (3 n,): velocity, acceleration and its average; so are weights of these.
    """

    felt = True
    """Supports feel the forces: a motion of what is seen takes part in them."""

    def __init__(self, body: Problem, parts: Mapping[str, Block]) -> None:
        assert body.inertia is not None
        self.body, self.inertia, self._parts = body, body.inertia, list(parts.values())
        self._motion, self._n = ngs.GridFunction(body.fes), int(np.sum(body.is_u))
        self.size = 3 * self._n
        self._changes: list[Array] = []

    # Backwards.

    def back(self, adjoint: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Derivatives by the start's displacements (ndof,), by what was carried there, and by θ."""
        s, dt, beta_dt = self._scheme
        velocity, acceleration, average = np.split(weights, 3)
        by_average = average + s.gamma * dt * velocity
        by_target = -s.weight(dt) * (acceleration + self.inertia.times(adjoint[self.body.is_u]))
        by_drift = by_target - by_average / beta_dt
        used = dt**2 * (0.5 - s.beta) * by_drift + dt * (1 - s.gamma) * velocity
        used -= beta_dt * s.alpha_m / (1 - s.alpha_m) * by_target
        before = beta_dt * s.alpha_f / (1 - s.alpha_m) * by_target
        kept = self.inertia.stretch
        found = np.concatenate([velocity + dt * by_drift, before + (1 - kept) * used, kept * used])
        values(self._motion)[:] = adjoint
        return self._spread(by_drift), found, np.concatenate([part() for part in self._by_theta])

    def remembered(self, weights: Array) -> Array:
        """How what is carried on changes with the end, by weights (ndof,)."""
        s, dt, beta_dt = self._scheme
        velocity, acceleration, average = np.split(weights, 3)
        return self._spread((average + s.gamma * dt * velocity) / beta_dt + s.weight(dt) * acceleration)

    @cached_property
    def _by_theta(self) -> list[Callable[[], Array]]:
        return [part.slope(self._work(self._motion), self.body.mesh) for part in self._parts]

    # Forwards.

    def changed(self, start: Array, carried: Array, theta: Sequence[Array]) -> Array:
        """How forces change with where the step begins, with what was carried there, and with θ (ndof,)."""
        s, dt, beta_dt = self._scheme
        velocity, acceleration, average = np.split(carried, 3)
        used = acceleration + (average - acceleration) * self.inertia.stretch
        drift = start[self.body.is_u] + dt * velocity + dt**2 * (0.5 - s.beta) * used
        target = drift - beta_dt * (s.alpha_m * used - s.alpha_f * acceleration) / (1 - s.alpha_m)
        self._changes = [velocity, used, drift, target]
        for part, way in zip(self._parts, theta, strict=True):
            part.turn(way)
        return self._spread(-s.weight(dt) * self.inertia.times(target)) + self._changed()

    def moved(self, end: Array) -> Array:
        """How what is carried on changes with the end, and with what `changed` was last asked for."""
        s, dt, beta_dt = self._scheme
        velocity, used, drift, target = self._changes
        u = end[self.body.is_u]
        average = (u - drift) / beta_dt
        velocity = velocity + dt * ((1 - s.gamma) * used + s.gamma * average)
        return np.concatenate([velocity, s.weight(dt) * (u - target), average])

    @cached_property
    def _changed(self) -> Callable[[], Array]:
        still = self._work(self.body.fes.TestFunction())
        return vector(self.body.fes, [term for part in self._parts for term in part.along(still)])

    def _work(self, motion: Motion) -> Terms:
        """c ∫ ρ (u - û) · λ dV."""
        return [Term(*self.inertia.work(self.body.u, self.body.layout.fields(motion).u))]

    @property
    def _scheme(self) -> tuple:
        """The scheme, Δt and β Δt²."""
        s, dt = self.inertia.scheme, self.inertia.dt
        return s, dt, s.beta * dt**2

    def _spread(self, of_u: Array) -> Array:
        found = np.zeros(self.body.fes.ndof)
        found[self.body.is_u] = of_u
        return found
