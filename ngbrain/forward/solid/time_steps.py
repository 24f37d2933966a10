"""A problem in one time step: how it begins and ends, what it remembers, and what its tangent was made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.solid.assembled import Assembled
from ngbrain.forward.solid.internal_variables import History

Array = np.ndarray


class TimeSteps(Assembled):
    """The time steps of a `Problem`: of its history, its friction and its inertia."""

    @property
    def history(self) -> History:
        """What relaxing tissue remembers."""
        if self.tissue.history is None:
            raise AttributeError(
                "history: an elastic body without contacts and inertia has none unless it is asked for"
            )
        return self.tissue.history

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds from the present state; it ends with `finish`."""
        self.tissue.begin(dt)
        self.friction.begin(self.state[: self.fes.ndof])
        if self.inertia is not None:
            self.inertia.begin(dt)

    def finish(self) -> None:
        """End the step begun at the state that now stands."""
        self._finish_tissue()
        self.friction.hold(self.gfu.vec)
        self.friction.finish()
        if self.inertia is not None:
            self.inertia.finish()

    def _finish_tissue(self) -> None:
        if self.tissue.history is not None:
            self.tissue.relax(self.state)
            self.tissue.history.finish()

    def halving(self, before: Array) -> tuple[float, float]:
        """By how much (Pa) the overstress at the end of the step would change in two half steps, and its size: see `History`."""
        if self.tissue.history is None:
            return 0.0, 0.0
        now = self.state
        self.state = (before + now) / 2
        middle = self.history.here()
        self.state = now
        return self.history.halving(middle)

    def path_error(self) -> float:
        """Relative error of the step that now ends beside the history's: that of inertia."""
        return 0.0 if self.inertia is None else self.inertia.error(self._free)

    @property
    def frozen(self) -> dict[str, Any]:
        """All that the energy of the present step is made of besides the state."""
        history = {} if self.tissue.history is None else self.history.frozen
        return {**history, **self.friction.frozen}

    def freeze(self, x: Array, energy: dict[str, Any]) -> None:
        """Go back to a state x and what the energy (`frozen`) was made of there."""
        if self.tissue.history is not None:
            self.history.frozen = energy
        self.tissue.rests_at(x)
        self.friction.frozen = energy
        self.state = x
        if self.inertia is not None:
            self.inertia.freeze(energy["dt"])

    @property
    def memory(self) -> dict[str, Any]:
        """All that decides the steps to come besides the state."""
        history = {} if self.tissue.history is None else self.history.memory
        return {**history, **self.friction.memory, **({} if self.inertia is None else self.inertia.memory)}

    @memory.setter
    def memory(self, saved: dict[str, Any]) -> None:
        if self.tissue.history is not None:
            self.history.memory = saved
        self.friction.memory = saved
        if self.inertia is not None:
            self.inertia.memory = saved

    def start(self, velocity: Sequence[Any] | CoefficientFunction) -> None:
        """Set the present state of a body with inertia moving at a velocity (m/s), with the acceleration that its forces give it.

        Pressures have to be there already if the state is loaded: they are taken as they are.
        """
        if self.inertia is None:
            raise InputError("loads", "without Inertia", "Inertia among them, for a body that moves by itself")
        self.tissue.begin(self.inertia.instant)
        self.friction.begin(self.state)
        self._stand(self.state)
        forces = self.tissue.forces() + self._outer_forces()
        self.inertia.start(velocity, -forces[self.is_u], self._free)

    def kinetic_energy(self) -> float:
        """∫ ρ/2 |v|² (J); 0 without inertia."""
        return 0.0 if self.inertia is None else self.inertia.energy()
