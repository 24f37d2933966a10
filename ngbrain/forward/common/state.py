"""Where a problem stands, as a value; and the parts of a problem that remember."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs
import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class State:
    """Where a problem stands. Nothing changes it, and its arrays are all that a step starts from.

    Parameters
    ----------
    t : float
        Time (s); the load factor along a `LoadPath`.
    x : array (n,)
        Unknowns.
    internal : dict
        Internal variables of tissue, friction, inertia and tools of given force, by name; empty where there are none.
    """

    t: float
    x: Array
    internal: Mapping[str, Any]


class Term:
    """A part of a problem's energy, with what it remembers from one time step to the next.

    A step lies between `begin` and `finish`; in it `stand` is called wherever the unknowns are others. What a term does not have
    or need it leaves as it is here.
    """

    def join(self, form: ngs.BilinearForm) -> None:
        """Add the energy, or the virtual work where there is none, to a form of the problem's."""

    def boundary_forms(self) -> list[tuple[str | None, ngs.BilinearForm]]:
        """What acts from outside, each part by itself with its boundary; None of one on no boundary."""
        return []

    def error(self, free: Array) -> float:
        """Relative error of the step that now ends, where `free` is 1 for each unknown of the space that is free, and 0 else."""
        return 0.0

    def rest(self) -> None:
        """Forget all: internal variables as in a body that was never loaded."""

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds at the unknowns that stand."""

    def stand(self) -> None:
        """Take the unknowns as they stand now."""

    def finish(self) -> None:
        """End the step begun at the unknowns that stand; its forces can be read until the next one begins."""

    @property
    def internal(self) -> Mapping[str, Any]:
        """Internal variables: what decides the steps to come besides the unknowns. Arrays are replaced, never changed."""
        return {}

    @internal.setter
    def internal(self, saved: Mapping[str, Any]) -> None:
        """Take them from a state."""

    @property
    def frozen(self) -> Mapping[str, Any]:
        """What the energy of the present step is made of besides the unknowns."""
        return {}

    @frozen.setter
    def frozen(self, saved: Mapping[str, Any]) -> None:
        """Go back to the energy of that step."""
