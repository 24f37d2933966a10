"""Measured displacements that no smooth field explains."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from ngbrain.errors import InputError
from ngbrain.inverse.data.moving_least_squares import moving_least_squares
from ngbrain.inverse.data.smoothing import fit_splines, supports_splines
from ngbrain.io.waves import WaveData

FAR = 5.0
"""Standard deviations of the noise (from the median) beyond which a displacement is a suspect."""
LEAST = 2e-3
"""Least noise, relative to a component's rms: smooth fields miss exact data too."""
NEAR = 4.0
"""Ratio to the median of the points around, beyond which a suspect is an outlier. Where the points around are off too, moduli
jump."""
JUMP = 0.1
"""Relative to a component's rms: published cases, living brains and phantoms have less beside what smooth fields miss at
edges."""
AROUND = {2: 8, 3: 18}
"""Number of points around a point, by dimension."""
STIFF = 0.3
"""Most coefficients of the smooth field for each point: with more it would follow single points."""
SMALLEST, FULLEST = 6, 0.4
"""Coefficients along an axis of the smallest spline, see `fit_splines`, and the most it may have for each point. On 9 × 9
exact points (.44) it misses 14 of 162 good displacements, on 90 points none."""
ROUNDS = 10


def remove_outliers(data: WaveData, far: float = FAR) -> WaveData:
    """Replace displacements that are not part of a smooth field by NaN: components of single loads, not whole points.

    A smooth field û is fitted, with σ = median |u - û| / √(ln 2) (the scale of a complex Gaussian). All u with |u - û| >
    `far` σ are suspects. The field is fitted again without them, until the suspects stay the same. So outliers near each
    other neither bias the field nor hide each other. Outliers are those suspects that are also `NEAR` times as far off as the
    points around them, other outliers not counted. The fields are then fitted without the outliers alone, until nothing
    changes.

    Of Gaussian noise this removes 1 in 10¹¹. Where moduli jump on a coarse grid, it removes some good displacements (1.3 % of
    a published case on half of its points, .1 % on all of them, 1 % without noise).

    Parameters
    ----------
    data : WaveData
        The data.
    far : float
        Standard deviations.

    Returns
    -------
    WaveData
        The data without outliers.

    Raises
    ------
    InputError
        `far` is not positive, or too few points are left for a smooth field.

    References
    ----------
    Rousseeuw and Croux 1993, 10.1080/01621459.1993.10476408 (scale by the median); Westerweel and Scarano 2005,
    10.1007/s00348-005-0016-6 (comparison with the points around).

    Examples
    --------
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
    around, none = _nearest_neighbours(data), np.zeros(data.displacement.shape, bool)
    known = data.measured & data.mask[:, None]
    number, least = int(known.sum(axis=1).max()), SMALLEST**data.dim / FULLEST
    if (
        supports_splines(data) and number < least
    ):  # what varies faster than the smallest spline would count as an outlier
        raise InputError(
            "mask", f"true at {number} measured points", f"at least {np.ceil(least):.0f} to detect gross errors"
        )
    out = none
    for near in (0.0, NEAR):  # suspects, then the outliers among them
        errors = none
        for _ in range(ROUNDS):
            off, beyond = _deviations(_remove(data, out), data, known, far)
            if near:
                beyond = np.maximum(beyond, near * _neighbour_median(np.where(errors, np.nan, off), data.mask, around))
            last, out = out, off > beyond
            if np.array_equal(out, last):
                break
            errors = out
    return _remove(data, out & last)  # what alternates depends on the points around, as at a jump


def discontinuity_share(data: WaveData) -> float:
    """Return the share of displacements beside a jump of the displacement: the seam of two scans, the border of a phase wrap.

    There a smooth field is off by more than `FAR` σ and `JUMP` of the rms, and at most points around too. A jump of the
    moduli only bends waves. Raises `InputError` where there are too few points for a smooth field.

    Examples
    --------
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
    off, beyond = _deviations(data, data, known, FAR)
    usual = _neighbour_median(off, data.mask, _nearest_neighbours(data))
    beside = known & (usual > np.maximum(beyond, JUMP * data.rms))
    return float(beside.sum() / max(known.sum(), 1))


def _nearest_neighbours(data: WaveData) -> np.ndarray:
    """For each point of the mask the nearest others, as indices among these points."""
    points = data.points[data.mask]
    return KDTree(points).query(points, k=min(AROUND[data.dim] + 1, len(points)))[1][:, 1:]


def _remove(data: WaveData, out: np.ndarray) -> WaveData:
    return replace(data, displacement=np.where(out, np.nan, data.displacement)) if out.any() else data


def _deviations(left: WaveData, data: WaveData, known: np.ndarray, far: float) -> tuple[np.ndarray, np.ndarray]:
    """|u - û| of all known displacements, NaN elsewhere, with û fitted to those that are left; and `far` σ."""
    smooth = fit_splines(left, STIFF) if supports_splines(left) else moving_least_squares(left)
    off = np.where(known, np.abs(data.displacement - smooth.values()), np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a component that is never measured
        noise = np.nan_to_num(np.nanmedian(off, axis=1, keepdims=True)) / np.sqrt(np.log(2))
    return off, far * np.maximum(noise, LEAST * left.rms)


def _neighbour_median(off: np.ndarray, mask: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Median over the points around each point of the mask; 0 elsewhere, and where nothing around is known."""
    usual = np.zeros(off.shape)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # nothing left around a point
        usual[:, mask] = np.nan_to_num(np.nanmedian(off[:, mask][:, around], axis=2))
    return usual


def screen_outliers(data: WaveData) -> tuple[WaveData, list[str]]:
    """Return the data of `remove_outliers`, and a note on what it removed.

    Where there are too few points for a smooth field, the data stay as they are.
    """
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
