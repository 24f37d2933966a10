"""What a wave model asks of the body under its waves: blocks of parameters, and how its matrix changes with them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ngbrain.forward.common.solve_counts import Solves

Array = np.ndarray


class Sensitivity(Protocol):
    """How a body's matrix A changes with θ, all but what drives its boundary, between its waves u_k and whatever.

    A' is the change along the direction that `set_direction` was last given.
    """

    def jvp(self, direction: Array) -> Sequence[Array]:
        """(∂A/∂θ δθ) u of each wave (ndof,)."""

    def vjp(self, adjoints: Sequence[Array]) -> Array:
        """Σ Re λᵀ (∂A/∂θ) u (size,), by the matrices that `jvp` uses."""

    def gradient(self, adjoints: Sequence[Array]) -> Array:
        """The same by linear forms: cheaper for a single product."""

    def set_direction(self, direction: Array) -> None:
        """Set the direction of A'."""

    def apply_derivative(self, number: int) -> Array:
        """A' u of a wave."""

    def apply_derivative_transpose(self, number: int, adjoint: Array) -> Array:
        """A'ᵀ λ of a wave."""

    def gradient_derivative(
        self, adjoints: Sequence[Array], changes: Sequence[Array], others: Sequence[Array]
    ) -> Array:
        """The change of `gradient` along the direction, with u' and λ'."""


class Medium(Protocol):
    """What a body is made of, as blocks of θ."""

    sizes: dict[str, int]
    solves: Solves

    @property
    def value(self) -> Array:
        """θ as the body has it now."""

    def set_value(self, values: Array) -> None:
        """Set it."""

    def sensitivity(self, waves: Array) -> Sensitivity:
        """How the matrix changes, at the values last set."""
