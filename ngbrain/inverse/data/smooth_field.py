"""A smooth displacement field with its derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from itertools import combinations_with_replacement

import numpy as np


class SmoothField(ABC):
    """A smooth displacement (m) of several loads with its derivatives, everywhere.

    `points` (n, d) m are by default those of the data.

    Attributes
    ----------
    noise : numpy.ndarray
        (loads, d) rms of the complex noise of each component, m; NaN where one is not measured.
    axes : numpy.ndarray
        (d, d) unit vectors in rows, along which `derivative` differentiates.
    """

    noise: np.ndarray
    axes: np.ndarray

    @abstractmethod
    def derivative(self, orders: tuple[int, ...], points: np.ndarray | None = None) -> np.ndarray:
        """Return a derivative of u.

        Parameters
        ----------
        orders : tuple of int
            Order of differentiation along each of `axes`.
        points : numpy.ndarray, optional
            (n, d) m; by default the points of the data.

        Returns
        -------
        numpy.ndarray
            (loads, n, d)
        """

    def values(self, points: np.ndarray | None = None) -> np.ndarray:
        """Return u, (loads, n, d) m."""
        return self.derivative((0,) * len(self.axes), points)

    def gradient(self, points: np.ndarray | None = None) -> np.ndarray:
        """Return ∂u_i/∂x_j, (loads, n, components, d), i before j."""
        along = np.stack([self.derivative(_orders(len(self.axes), j), points) for j in range(len(self.axes))], axis=-1)
        return along @ self.axes

    def hessian(self, points: np.ndarray | None = None) -> np.ndarray:
        """Return ∂²u_i/∂x_j∂x_k, (loads, n, d, d, d)."""
        d = len(self.axes)
        pairs = {jk: self.derivative(_orders(d, *jk), points) for jk in combinations_with_replacement(range(d), 2)}
        rows = [np.stack([pairs[min(j, k), max(j, k)] for k in range(d)], axis=-1) for j in range(d)]
        return self.axes.T @ np.stack(rows, axis=-2) @ self.axes

    def laplacian(self, points: np.ndarray | None = None) -> np.ndarray:
        """Return ∇²u, (loads, n, d)."""
        return sum(self.derivative(_orders(len(self.axes), k, k), points) for k in range(len(self.axes)))  # type: ignore

    def curl(self, points: np.ndarray | None = None) -> np.ndarray:
        """Return ∇×u, (loads, n, 3); in the plane (loads, n, 1)."""
        return _curl(self.gradient(points))

    def curl_laplacian(self, points: np.ndarray | None = None) -> np.ndarray:
        """Return ∇²(∇×u), as `curl`."""
        d = len(self.axes)
        along = [sum(self.derivative(_orders(d, k, k, j), points) for k in range(d)) for j in range(d)]
        return _curl(np.stack(along, axis=-1) @ self.axes)  # type: ignore[arg-type]


def _orders(d: int, *axes: int) -> tuple[int, ...]:
    return tuple(axes.count(i) for i in range(d))


def _curl(gradient: np.ndarray) -> np.ndarray:
    """Curl of ∂u_i/∂x_j, (…, d, d)."""

    def turn(i: int, j: int) -> np.ndarray:
        return gradient[..., j, i] - gradient[..., i, j]

    return np.stack([turn(0, 1)] if gradient.shape[-1] == 2 else [turn(1, 2), turn(2, 0), turn(0, 1)], axis=-1)
