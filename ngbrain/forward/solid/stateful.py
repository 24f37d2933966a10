"""State of a problem as a value; start and end of a time step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.common.state import State
from ngbrain.forward.solid.internal_variables import History
from ngbrain.forward.solid.reactions import Reactions

Array = np.ndarray


class Stateful(Reactions):
    """States and time steps of a `Problem`."""

    _free: Array

    def state(self, t: float) -> State:
        """The current state as a value, labelled by a time (s) or load factor."""
        internal = {name: value for term in self.terms for name, value in term.internal.items()}
        return State(t, self.x, internal)

    def set_state(self, state: State) -> None:
        """Set unknowns and internal variables to those of a state; loads and rigid bodies are unchanged."""
        if self.tool is not None:
            self.tool.hold_at(state.x[-1])
        self.x = state.x
        for term in self.terms:
            term.internal = state.internal

    def reset(self) -> State:
        """Reset the problem to rest, as if never loaded; returns that state, at time 0."""
        self.x = np.zeros(len(self.x))
        for term in self.terms:
            term.reset()
        return self.state(0.0)

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds at the current state; it ends with `finish`. See `advance`."""
        for term in self.terms:
            term.begin(dt)

    def finish(self) -> None:
        """End the step."""
        for term in self.terms:
            term.finish()

    def half_step_error(self, before: Array) -> tuple[float, float]:
        """Change (Pa) of the overstress if the step from `before` were made in two half steps, and its size.

        See `History.half_step_error`.
        """
        if self.tissue.history is None:
            return 0.0, 0.0
        now = self.x
        self.x = (before + now) / 2
        middle = self.tissue.history.here()
        self.x = now
        return self.tissue.history.half_step_error(middle)

    def path_error(self) -> float:
        """Relative error of the step that ends now, other than that of the internal variables: from inertia, or from a tool's
        travel."""
        return max(term.error(self._free) for term in self.terms)

    @property
    def frozen(self) -> dict[str, Any]:
        """Coefficients of the energy of the current step, apart from the unknowns."""
        return {name: value for term in self.terms for name, value in term.frozen.items()}

    def freeze(self, x: Array, energy: Mapping[str, Any]) -> None:
        """Restore unknowns and the coefficients of a step's energy.

        Parameters
        ----------
        x : array (n,)
            Unknowns.
        energy : dict
            Coefficients from `frozen`.
        """
        self.x = x
        for term in self.terms:
            term.frozen = energy

    @property
    def history(self) -> History:
        """Internal variables of viscoelastic tissue."""
        if self.tissue.history is None:
            raise AttributeError("history: an elastic body without contacts and inertia has none unless `history=True`")
        return self.tissue.history

    def start(self, velocity: Sequence[Any] | CoefficientFunction) -> None:
        """Set the initial velocity (m/s) of a body with inertia, and the acceleration that follows from its forces.

        The current pressures are used; those of a loaded body have to be set before.
        """
        if self.inertia is None:
            raise InputError("loads", "without Inertia", "an Inertia among them, for an initial velocity")
        self.tissue.begin(self.inertia.instant)
        self.friction.begin(self.inertia.instant)
        self._set_unknowns(self.x)
        forces = self.tissue.forces() + self._outer_forces()
        self.inertia.start(velocity, -forces[self.is_u], self._free)
