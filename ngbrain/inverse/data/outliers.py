"""Measured displacements that no smooth field explains."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from ngbrain.errors import InputError
from ngbrain.inverse.data.smoothing import fit_splines, moving_least_squares, supports_splines
from ngbrain.io.waves import WaveData

FAR = 5.0
"""Standard deviations of the noise, by the median, beyond which a displacement is one."""
LEAST = 2e-3
"""Of a component's rms, what counts as noise at least: exact data are missed by a smooth field too."""
NEAR = 4.0
"""Times the median of the points around: what is off where everything around is off too is a jump of the moduli, no error."""
JUMP = 0.1
"""Of a component's rms: published cases, living brains and phantoms have less beside what smooth fields miss at edges."""
AROUND = {2: 8, 3: 18}
"""How many points are around one, by the dimension."""
STIFF = 0.3
"""Coefficients of the smooth field for each point at most: with more it would follow single points."""
SMALLEST, FULLEST = 6, 0.4
"""Coefficients along an axis of the smallest spline, see `fit_splines`, and how many it may have for each point: on 9 × 9 exact
points (.44) it misses 14 of 162 good displacements, on 90 points none."""
ROUNDS = 10


def remove_outliers(data: WaveData, far: float = FAR) -> WaveData:
    """The data, displacements that are no part of a smooth field NaN: components of single loads, not whole points.

    A smooth field û is fitted, σ = median |u - û| / √(ln 2) (that of a complex Gaussian's size), and all u with |u - û| > `far` σ
    are suspects, without which it is fitted again; so until they stay the same. Errors that are near each other pull no field
    then, nor hide each other. Of the suspects those are gross errors that are also `NEAR` times as far off as the points around,
    gross errors not counted; again with fields that are fitted without these alone, until nothing changes. Of Gaussian noise this
    leaves out 1 in 10¹¹; where moduli jump on a coarse grid some displacements that are good (1.3 % of a published case on half
    of its points, .1 % on all of them, 1 % without noise).

    Raises `InputError` unless `far` is positive, and where too few points are left for a smooth field.
    Sources: Rousseeuw and Croux 1993, 10.1080/01621459.1993.10476408 (scale by the median); Westerweel and Scarano 2005,
    10.1007/s00348-005-0016-6 (comparison with the points around).

    >>> line = np.arange(20) * 2e-3
    >>> grid = np.array([[x, y] for y in line for x in line])
    >>> u = 1e-5 * np.exp(-200j * grid[:, ::-1])[None]
    >>> u[0, 210, 1] += 1e-5
    >>> data = WaveData(grid, u, [50.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4)
    >>> np.argwhere(np.isnan(remove_outliers(data).displacement)).tolist()
    [[0, 210, 1]]
    """
    if not far > 0:
        raise InputError("far", far, "a positive number of standard deviations")
    around, none = _around(data), np.zeros(data.displacement.shape, bool)
    known = data.measured & data.mask[:, None]
    number, least = int(known.sum(axis=1).max()), SMALLEST**data.dim / FULLEST
    if supports_splines(data) and number < least:  # what bends more than the smallest spline would count as errors
        raise InputError(
            "mask", f"true at {number} measured points", f"at least {np.ceil(least):.0f} to tell gross errors by"
        )
    out = none
    for near in (0.0, NEAR):  # suspects, then the gross errors among them
        errors = none
        for _ in range(ROUNDS):
            off, beyond = _off(_without(data, out), data, known, far)
            if near:
                beyond = np.maximum(beyond, near * _usual(np.where(errors, np.nan, off), data.mask, around))
            last, out = out, off > beyond
            if np.array_equal(out, last):
                break
            errors = out
    return _without(data, out & last)  # what comes and goes hangs on the points around, as at a jump


def discontinuity_share(data: WaveData) -> float:
    """Share of the displacements that lie beside a jump of the displacement: the seam of two scans, the border of a phase wrap.

    There a smooth field is off by more than `FAR` σ and `JUMP` of the waves' rms, and at most points around too; a jump of the
    moduli bends waves and tears nothing. Raises `InputError` where too few points make a smooth field.

    >>> line = np.arange(20) * 2e-3
    >>> grid = np.array([[x, y] for y in line for x in line])
    >>> u = 1e-5 * np.exp(-200j * grid[:, ::-1])[None]
    >>> torn = np.where(grid[:, :1] < 0.02, u, -1j * u)
    >>> [
    ...     round(discontinuity_share(WaveData(grid, each, [50.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4)), 2)
    ...     for each in (u, torn)
    ... ]
    [0.0, 0.09]
    """
    known = data.measured & data.mask[:, None]
    off, beyond = _off(data, data, known, FAR)
    usual = _usual(off, data.mask, _around(data))
    beside = known & (usual > np.maximum(beyond, JUMP * data.rms))
    return float(beside.sum() / max(known.sum(), 1))


def _around(data: WaveData) -> np.ndarray:
    """For each point of the mask the nearest others, as places among these points."""
    points = data.points[data.mask]
    return KDTree(points).query(points, k=min(AROUND[data.dim] + 1, len(points)))[1][:, 1:]


def _without(data: WaveData, out: np.ndarray) -> WaveData:
    return replace(data, displacement=np.where(out, np.nan, data.displacement)) if out.any() else data


def _off(left: WaveData, data: WaveData, known: np.ndarray, far: float) -> tuple[np.ndarray, np.ndarray]:
    """|u - û| of all that is known, NaN elsewhere, û fitted to what is left; and `far` σ."""
    smooth = fit_splines(left, STIFF) if supports_splines(left) else moving_least_squares(left)
    off = np.where(known, np.abs(data.displacement - smooth.values()), np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a component that is never measured
        noise = np.nan_to_num(np.nanmedian(off, axis=1, keepdims=True)) / np.sqrt(np.log(2))
    return off, far * np.maximum(noise, LEAST * left.rms)


def _usual(off: np.ndarray, mask: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Median over the points around each point of the mask; 0 elsewhere, and where nothing is known around."""
    usual = np.zeros(off.shape)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # nothing left around a point
        usual[:, mask] = np.nan_to_num(np.nanmedian(off[:, mask][:, around], axis=2))
    return usual


def screen_outliers(data: WaveData) -> tuple[WaveData, list[str]]:
    """`remove_outliers`, and what it left out in words; the data as they are where too few points make a smooth field."""
    try:
        left = remove_outliers(data)
    except InputError:
        return data, ["gross errors were not looked for: there are too few points for a smooth field"]
    given, lost = int((data.measured & data.mask[:, None]).sum()), int((data.measured & ~left.measured).sum())
    if not lost:
        return data, []
    share = f"{100 * lost / given:.2g} %"
    return left, [
        f"{lost} of {given} displacements ({share}) are far off a smooth field and were left out as gross errors"
    ]
