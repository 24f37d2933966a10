"""Protocols of a body under time-harmonic waves: its parameters, and derivatives of its system matrix A with respect to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ngbrain.forward.common.solve_counts import Solves

Array = np.ndarray


class Sensitivity(Protocol):
    """Derivatives of the system matrix A with respect to θ (boundary values excluded), contracted with the waves u_k.

    A' is the derivative along the direction last set by `set_direction`.
    """

    def jvp(self, direction: Array) -> Sequence[Array]:
        """(∂A/∂θ δθ) u of each wave (ndof,)."""

    def vjp(self, adjoints: Sequence[Array]) -> Array:
        """Σ Re λᵀ (∂A/∂θ) u (size,), by the matrices that `jvp` uses."""

    def gradient(self, adjoints: Sequence[Array]) -> Array:
        """As `vjp`, by linear forms: cheaper for a single product."""

    def set_direction(self, direction: Array) -> None:
        """Set the direction of A'."""

    def apply_derivative(self, number: int) -> Array:
        """A' u of a wave."""

    def apply_derivative_transpose(self, number: int, adjoint: Array) -> Array:
        """A'ᵀ λ of a wave.

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

    def gradient_derivative(
        self, adjoints: Sequence[Array], changes: Sequence[Array], others: Sequence[Array]
    ) -> Array:
        """Derivative of `gradient` along the direction.

        Parameters
        ----------
        adjoints : sequence of array (ndof,)
            λ of each wave.
        changes : sequence of array (ndof,)
            u', the change of each wave.
        others : sequence of array (ndof,)
            λ', the change of each adjoint.

        Returns
        -------
        array (size,)
        """


class Medium(Protocol):
    """A body under waves, with its parameters as blocks of θ."""

    sizes: dict[str, int]
    solves: Solves

    @property
    def value(self) -> Array:
        """Present parameters θ."""

    def set_value(self, values: Array) -> None:
        """Set θ."""

    def sensitivity(self, waves: Array) -> Sensitivity:
        """Derivatives of the system matrix at the values last set."""
