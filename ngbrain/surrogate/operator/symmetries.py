"""Symmetries of the data: mirror images, exchange of axes, phase."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def apply_random_symmetry(name: str, u: Array, maps: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """Mirror images of squares, for waves also with exchanged axes and another phase, at random.

    Parameters
    ----------
    name : str
        "waves" or "compression".
    u : numpy.ndarray of shape (batch, n, n, components)
        Displacement, y first.
    maps : numpy.ndarray of shape (batch, k, n, n)
        Property maps of the same squares.
    random : np.random.Generator
        Random numbers.

    Returns
    -------
    tuple of (numpy.ndarray, numpy.ndarray)
        Transformed displacement and maps.
    """
    u, maps = u.copy(), maps.copy()
    for i in range(len(u)):
        if random.random() < 0.5:
            u[i], maps[i] = u[i, :, ::-1], maps[i, :, :, ::-1]
            if name == "waves":
                u[i, ..., 0] *= -1
        if name != "waves":
            continue
        if random.random() < 0.5:
            u[i], maps[i] = u[i, ::-1], maps[i, :, ::-1]
            u[i, ..., 1] *= -1
        if random.random() < 0.5:
            u[i], maps[i] = u[i].transpose(1, 0, 2)[..., ::-1], maps[i].transpose(0, 2, 1)
        u[i] *= np.exp(2j * np.pi * random.random())
    return u, maps
