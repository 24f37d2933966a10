"""State of a problem as a value, and the terms of its energy that have internal variables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.look import BriefText

Array = np.ndarray


@dataclass(frozen=True, repr=False)
class State(BriefText):
    """State of a problem at one time, immutable: everything that the next step depends on.

    Parameters
    ----------
    t : float
        Time (s); the load factor along a `LoadPath`.
    x : array (n,)
        Unknowns.
    internal : dict
        Internal variables of tissue, friction, inertia and force-controlled tools, by name; empty where there are none.
    """

    t: float
    x: Array
    internal: Mapping[str, Any]


class Term:
    """A term of a problem's energy, with its internal variables.

    A time step lies between `begin` and `finish`; `update` is called whenever the unknowns change in between. Methods that a term
    does not need keep the defaults here.
    """

    def join(self, form: ngs.BilinearForm) -> None:
        """Add the energy, or the virtual work where there is none, to a form of the problem."""

    def boundary_forms(self) -> list[tuple[str | None, ngs.BilinearForm]]:
        """External actions, one form each, with the boundary that each acts on; None for an action on no boundary."""
        return []

    def error(self, free: Array) -> float:
        """Relative error of the step that ends now; `free` is 1 for each free unknown of the space, and 0 otherwise."""
        return 0.0

    def reset(self) -> None:
        """Reset the internal variables to those of a body that was never loaded."""

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds at the current unknowns."""

    def update(self) -> None:
        """Update what depends on the current unknowns within a step."""

    def finish(self) -> None:
        """End the step at the current unknowns; its forces can be read until the next one begins."""

    @property
    def internal(self) -> Mapping[str, Any]:
        """Internal variables: everything besides the unknowns that determines later steps. Arrays are replaced, never
        modified."""
        return {}

    @internal.setter
    def internal(self, saved: Mapping[str, Any]) -> None:
        """Set the internal variables of a state."""

    @property
    def frozen(self) -> Mapping[str, Any]:
        """Coefficients of the energy of the current step, apart from the unknowns."""
        return {}

    @frozen.setter
    def frozen(self, saved: Mapping[str, Any]) -> None:
        """Restore these coefficients."""
