"""Squares that are the same but for how one looks at them."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def apply_random_symmetry(name: str, u: Array, maps: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """The same squares seen in a mirror, for waves also lying on another side and at another phase; maps (batch, k, n, n)."""
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
