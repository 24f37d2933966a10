"""Measured displacements that no smooth field explains."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from ngbrain.errors import InputError
from ngbrain.inverse.smoothing import fit_splines, moving_least_squares
from ngbrain.io.waves import WaveData

FAR = 5.0
"""Standard deviations of the noise, by the median, beyond which a displacement is one."""
LEAST = 2e-3
"""Of a component's rms, what counts as noise at least: exact data are missed by a smooth field too."""
NEAR = 4.0
"""Times the median of the points around: what is off where everything around is off too is a jump of the moduli, no error."""
AROUND = {2: 8, 3: 18}
"""How many points are around one, by the dimension."""
STIFF = 0.3
"""Coefficients of the smooth field for each point at most: with more it would follow single points."""
ROUNDS = 10


def without_outliers(data: WaveData, far: float = FAR) -> WaveData:
    """The data, displacements that are no part of a smooth field NaN: components of single loads, not whole points.

    A smooth field û is fitted to what is left, σ = median |u - û| / √(ln 2) (that of a complex Gaussian's size), and all u with
    |u - û| > `far` σ that are also `NEAR` times as far off as the points around are left out; so again until nothing changes. Of
    Gaussian noise this leaves out 1 in 10¹¹; where moduli jump on a coarse grid some displacements that are good (1.6 % of a
    published case on half of its points, .7 % on all of them).

    Raises `InputError` unless `far` is positive, and where too few points are left for a smooth field.
    Sources: Rousseeuw and Croux 1993, 10.1080/01621459.1993.10476408 (scale by the median); Westerweel and Scarano 2005,
    10.1007/s00348-005-0016-6 (comparison with the points around).

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
    left, chosen = data, np.flatnonzero(data.mask)
    number = min(AROUND[data.dim] + 1, len(chosen))
    around = KDTree(data.points[chosen]).query(data.points[chosen], k=number)[1][:, 1:]
    for _ in range(ROUNDS):
        smooth = fit_splines(left, STIFF) if left.structured else moving_least_squares(left)
        off = np.abs(data.displacement - smooth.values())
        known = left.measured & data.mask[:, None]
        some = np.where(known.any(axis=1, keepdims=True), np.where(known, off, np.nan), 0.0)
        noise = np.nanmedian(some, axis=1, keepdims=True) / np.sqrt(np.log(2))
        usual = np.zeros(off.shape)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # nothing left around a point
            usual[:, chosen] = np.nan_to_num(np.nanmedian(some[:, chosen][:, around], axis=2))
        beyond = np.maximum(far * np.maximum(noise, LEAST * left.rms), NEAR * usual)
        u = np.where(data.mask[:, None] & (off > beyond), np.nan, data.displacement)
        if np.array_equal(np.isnan(u), np.isnan(left.displacement)):
            break
        left = replace(data, displacement=u)
    return left


def cleaned(data: WaveData) -> tuple[WaveData, list[str]]:
    """`without_outliers`, and what it left out in words; the data as they are where too few points make a smooth field."""
    try:
        left = without_outliers(data)
    except InputError:
        return data, ["gross errors were not looked for: there are too few points for a smooth field"]
    given, lost = int((data.measured & data.mask[:, None]).sum()), int((data.measured & ~left.measured).sum())
    if not lost:
        return data, []
    share = f"{100 * lost / given:.2g} %"
    return left, [
        f"{lost} of {given} displacements ({share}) are far off a smooth field and were left out as gross errors"
    ]
