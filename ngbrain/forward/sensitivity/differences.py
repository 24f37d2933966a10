"""Central difference quotients of smooth functions without noise, accurate to about eleven digits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray
WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
"""Weights of f(kh) - f(-kh), k = 1 to 4, in h f'(0): eighth order."""
SHARE = 4e-3
"""Step h relative to the length over which f changes by itself: larger steps have truncation error, smaller ones round-off."""


def central_difference(function: Callable[[float], Array], size: float) -> Array:
    """d/ds f(s) at s = 0, by an eighth-order central difference.

    Parameters
    ----------
    function : callable
        f. It is called at eight values of s, up to 4 h in absolute value.
    size : float
        Relative change of what f depends on as s goes from 0 to 1: 1 where it changes by all of itself, 0 where it does not change.

    Returns
    -------
    array
        The derivative, with the shape of f(0).

    Examples
    --------
    >>> abs(float(central_difference(lambda s: np.exp(2 * s), 2.0)) - 2) < 1e-11
    True
    """
    if not size:
        return np.zeros_like(function(0.0))
    h = SHARE / size
    return sum(w * (function(k * h) - function(-k * h)) for k, w in enumerate(WEIGHTS, 1)) / h
