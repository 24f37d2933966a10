"""Wave data with gross errors at some points."""

from dataclasses import replace

import numpy as np


def spoiled(data, share, size, seed=0):
    """The data with a Gaussian error of `size` times the waves' rms at a share of the points, and which points these are."""
    rng = np.random.default_rng(seed)
    where = rng.random(len(data.points)) < share
    u = data.displacement.copy()
    error = rng.normal(size=(2, *u[:, where].shape)) / np.sqrt(2)
    u[:, where] += size * np.sqrt(np.mean(np.abs(u) ** 2)) * (error[0] + 1j * error[1])
    return replace(data, displacement=u), where
