"""Measured displacements that no smooth field explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ngbrain.errors import InputError
from ngbrain.inverse.smoothing import fit_splines, moving_least_squares
from ngbrain.io.waves import WaveData

FAR = 5.0
"""Standard deviations of the noise, by the median, beyond which a displacement is one."""
LEAST = 2e-3
"""Of a component's rms, what counts as noise at least: exact data are missed by a smooth field too."""
STIFF = 0.3
"""Coefficients of the smooth field for each point at most: with more it would follow single points."""
ROUNDS = 10


def without_outliers(data: WaveData, far: float = FAR) -> WaveData:
    """The data, displacements that are no part of a smooth field NaN: components of single loads, not whole points.

    A smooth field û is fitted to what is left, σ = median |u - û| / √(ln 2) (that of a complex Gaussian's size), and all u with
    |u - û| > `far` σ are left out; so again until nothing changes. Of Gaussian noise this leaves out 1 in 10¹¹; where moduli jump
    on a coarse grid some displacements that are good (2.5 % of a published case on half of its points).

    Raises `InputError` unless `far` is positive, and where too few points are left for a smooth field.
    Source of the scale by the median: Rousseeuw and Croux 1993, 10.1080/01621459.1993.10476408.

    >>> line = np.arange(20) * 2e-3
    >>> grid = np.array([[x, y] for y in line for x in line])
    >>> u = 1e-5 * np.exp(-200j * grid[:, ::-1])[None]
    >>> u[0, 210, 1] += 1e-5
    >>> data = WaveData(grid, u, [50.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4)
    >>> np.argwhere(np.isnan(without_outliers(data).displacement)).tolist()
    [[0, 210, 1]]
    """
    if not far > 0:
        raise InputError("far", far, "a positive number of standard deviations")
    left = data
    for _ in range(ROUNDS):
        smooth = fit_splines(left, STIFF) if left.structured else moving_least_squares(left)
        off = np.abs(data.displacement - smooth.values())
        known = left.measured & data.mask[:, None]
        some = np.where(known.any(axis=1, keepdims=True), np.where(known, off, np.nan), 0.0)
        noise = np.nanmedian(some, axis=1, keepdims=True) / np.sqrt(np.log(2))
        outside = data.mask[:, None] & (off > far * np.maximum(noise, LEAST * left.rms))
        u = np.where(outside, np.nan, data.displacement)
        if np.array_equal(np.isnan(u), np.isnan(left.displacement)):
            break
        left = replace(data, displacement=u)
    return left
