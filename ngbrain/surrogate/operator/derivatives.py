"""Derivatives of fields on square grids by local polynomials (Savitzky and Golay 1964, 10.1021/ac60214a047)."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from math import factorial

import numpy as np

Array = np.ndarray
DEGREE = 5
"""Default degree of the local polynomials."""


@cache
def derivative_matrix(n: int, half: float, order: int, degree: int = DEGREE) -> Array:
    """Matrix of a derivative on a line of length 1, by local polynomials; at the ends windows stay inside.

    Parameters
    ----------
    n : int
        Number of points.
    half : float
        Half window, as a fraction of the line.
    order : int
        Order of the derivative; 0 smooths.
    degree : int, default DEGREE
        Degree of the local polynomials.

    Returns
    -------
    numpy.ndarray of shape (n, n)
        Matrix from values to derivatives.

    Examples
    --------
    >>> x = np.linspace(0, 1, 51)
    >>> float(np.abs(derivative_matrix(51, 0.1, 2) @ x**4 - 12 * x**2).max()) < 1e-6
    True
    """
    reach = max(round(half * (n - 1)), (degree + 1) // 2)
    width = min(2 * reach + 1, n - 1 + n % 2)
    matrix = np.zeros((n, n))
    for i in range(n):
        first = min(max(i - width // 2, 0), n - width)
        powers = np.vander(np.arange(first - i, first - i + width) / width, degree + 1, increasing=True)
        matrix[i, first : first + width] = np.linalg.pinv(powers)[order]
    return matrix * factorial(order) * ((n - 1) / width) ** order


def partial_derivative(u: Array, half: float, along_x: int, along_y: int, degree: int = DEGREE) -> Array:
    """Partial derivative of fields by local polynomials.

    Parameters
    ----------
    u : numpy.ndarray of shape (…, n, n)
        Fields, y first.
    half : float
        Half window, in edges.
    along_x, along_y : int
        Orders of differentiation.
    degree : int, default DEGREE
        Degree of the local polynomials.

    Returns
    -------
    numpy.ndarray
        The derivative, of the same shape.
    """
    return partial_derivatives(u, half, [(along_x, along_y)], degree)[along_x, along_y]


def partial_derivatives(
    u: Array, half: float, ways: Iterable[tuple[int, int]], degree: int = DEGREE
) -> dict[tuple[int, int], Array]:
    """Several partial derivatives of fields, which share common products.

    Parameters
    ----------
    u : numpy.ndarray of shape (…, n, n)
        Fields, y first.
    half : float
        Half window, in edges.
    ways : iterable of tuple of (int, int)
        Orders along x and y of each derivative.
    degree : int, default DEGREE
        Degree of the local polynomials.

    Returns
    -------
    dict of tuple of (int, int) to numpy.ndarray
        Orders → derivative.

    Examples
    --------
    >>> y, x = np.meshgrid(*2 * (np.linspace(0, 1, 51),), indexing="ij")
    >>> found = partial_derivatives(x**2 * y, 0.1, [(1, 1), (2, 0)])
    >>> bool(np.allclose(found[1, 1], 2 * x) and np.allclose(found[2, 0], 2 * y))
    True
    """
    if np.iscomplexobj(u):  # keeps the matrices real
        parts = partial_derivatives(np.stack([u.real, u.imag]), half, ways, degree)
        return {way: each[0] + 1j * each[1] for way, each in parts.items()}
    n = u.shape[-1]
    orders: dict[int, list[int]] = {}
    for along_x, along_y in ways:
        orders.setdefault(along_x, []).append(along_y)
    along = u @ np.vstack([derivative_matrix(n, half, order, degree) for order in orders]).T
    found: dict[tuple[int, int], Array] = {}
    for i, (x, ys) in enumerate(orders.items()):
        both = np.vstack([derivative_matrix(n, half, y, degree) for y in ys]) @ along[..., i * n : (i + 1) * n]
        found |= {(x, y): both[..., k * n : (k + 1) * n, :] for k, y in enumerate(ys)}
    return found
