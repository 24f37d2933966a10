"""State of a problem as a value, and the beginning and end of a time step."""

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
    """States and steps of a `Problem`: what its terms remember."""

    _free: Array

    def state(self, t: float) -> State:
        """Where the problem stands, as a value that belongs to a time (s) or load factor."""
        internal = {name: value for term in self.terms for name, value in term.internal.items()}
        return State(t, self.x, internal)

    def set_state(self, state: State) -> None:
        """Put the problem where a state says: its GridFunctions and internal variables; loads and bodies stay where they are."""
        if self.tool is not None:
            self.tool.hold_at(state.x[-1])
        self.x = state.x
        for term in self.terms:
            term.internal = state.internal

    def reset(self) -> State:
        """Put the problem at rest, as if it had never been loaded; that state, at time 0."""
        self.x = np.zeros(len(self.x))
        for term in self.terms:
            term.reset()
        return self.state(0.0)

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds from where it stands; it ends with `finish`. See `advance`."""
        for term in self.terms:
            term.begin(dt)

    def finish(self) -> None:
        """End the step begun."""
        for term in self.terms:
            term.finish()

    def half_step_error(self, before: Array) -> tuple[float, float]:
        """By how much (Pa) the overstress at the end of the step from `before` would change in two half steps, and its size.

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
        """Relative error of the step that now ends beside the history's: that of inertia, or of the way of a tool."""
        return max(term.error(self._free) for term in self.terms)

    @property
    def frozen(self) -> dict[str, Any]:
        """All that the energy of the present step is made of besides the unknowns."""
        return {name: value for term in self.terms for name, value in term.frozen.items()}

    def freeze(self, x: Array, energy: Mapping[str, Any]) -> None:
        """Restore unknowns and the coefficients of a step's energy.

        Parameters
        ----------
        x : array (n,)
            Unknowns.
        energy : dict
            As `frozen` gave it there.
        """
        self.x = x
        for term in self.terms:
            term.frozen = energy

    @property
    def history(self) -> History:
        """What relaxing tissue remembers."""
        if self.tissue.history is None:
            raise AttributeError(
                "history: an elastic body without contacts and inertia has none unless it is asked for"
            )
        return self.tissue.history

    def start(self, velocity: Sequence[Any] | CoefficientFunction) -> None:
        """Set a body with inertia moving at a velocity (m/s), with the acceleration that its forces give it.

        Pressures have to be there already if it is loaded: they are taken as they are.
        """
        if self.inertia is None:
            raise InputError("loads", "without Inertia", "Inertia among them, for a body that moves by itself")
        self.tissue.begin(self.inertia.instant)
        self.friction.begin(self.inertia.instant)
        self._set_unknowns(self.x)
        forces = self.tissue.forces() + self._outer_forces()
        self.inertia.start(velocity, -forces[self.is_u], self._free)
