"""Measured displacements that no smooth field explains."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ngbrain.errors import InputError
from ngbrain.inverse.data.moving_least_squares import moving_least_squares
from ngbrain.inverse.data.smooth_field import SmoothField
from ngbrain.inverse.data.smoothing import fit_splines, supports_splines
from ngbrain.io.waves import WaveData
from ngbrain.io.waves.grid import Grid

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
MOST_TORN, PATCH = 0.3, 10
"""Largest share of points that may be torn off the rest: half of another scan is no error. Number of points from which a piece
is a patch: a wrapped phase, not errors side by side."""


def remove_outliers(data: WaveData, far: float = FAR) -> WaveData:
    """Replace displacements that are not part of a smooth field by NaN: components of single loads, not whole points.

    A smooth field û is fitted, with σ = median |u - û| / √(ln 2) (the scale of a complex Gaussian). All u with |u - û| >
    `far` σ are suspects. The field is fitted again without them, until the suspects stay the same. So outliers near each
    other neither bias the field nor hide each other. Outliers are those suspects that are also `NEAR` times as far off as the
    points around them, other outliers not counted. The fields are then fitted without the outliers alone, until nothing
    changes.

    First go those that are torn off the rest (`torn_displacements`): patches of a wrapped phase, vessels.

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
    return _remove_scattered(_remove(data, torn_displacements(data)[0]), far)


def _remove_scattered(data: WaveData, far: float) -> WaveData:
    """`remove_outliers` where nothing is torn off."""
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


def torn_displacements(data: WaveData) -> tuple[np.ndarray, np.ndarray]:
    """Return the displacements that a closed seam tears off the rest, and those of them that are whole patches.

    Two neighbours on a grid are torn apart where their distances from a smooth field û, u - û, differ by more than `FAR` times
    what is usual (by the median) and by `JUMP` of the rms, and their difference is as far from those to the next points on the
    same line, on either side: beside a jump û is off too, but there u goes on as before. Where these two differ more from each
    other, as along a wave of few points, nothing is torn. So the points fall into pieces, and
    the largest is tissue. Pieces of fewer than `PATCH` points are errors, alone or side by side as in a vessel. A larger one is
    a patch, such as a wrapped phase, if most of its seam is with other large pieces; else errors divide it from the rest, and
    it is tissue too. Where more than `MOST_TORN` is torn off, nothing is: then the data are not those of one body. The smooth
    field is fitted again without what is torn off, until that stays the same. Scattered points have no lines: nothing is torn.

    Parameters
    ----------
    data : WaveData
        The data.

    Returns
    -------
    torn, patches : numpy.ndarray
        (loads, n, d) bool.

    Raises
    ------
    InputError
        There are too few points for a smooth field.

    Examples
    --------
    >>> line = np.arange(20) * 2e-3
    >>> grid = np.array([[x, y] for y in line for x in line])
    >>> u = 1e-5 * np.exp(-200j * grid[:, ::-1])[None]
    >>> wrapped = np.hypot(*(grid - 0.02).T) < 0.005
    >>> u[0, wrapped, 1] += 2e-5
    >>> data = WaveData(grid, u, [50.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4)
    >>> torn, patches = torn_displacements(data)
    >>> bool((torn[0, :, 1] == wrapped).all()), bool(torn[0, :, 0].any()), bool((patches == torn).all())
    (True, False, True)
    """
    known = data.measured & data.mask[:, None]
    torn = patches = np.zeros(data.displacement.shape, bool)
    if data.grid is None:
        return torn, patches
    lines = _lines(data, data.grid)
    for _ in range(ROUNDS):
        off, last = data.displacement - _smooth(_remove(data, torn)).values(), torn
        torn, patches = np.zeros_like(torn), np.zeros_like(torn)
        for load, component in np.argwhere(known.any(axis=1)):
            here, least = (load, slice(None), component), JUMP * data.rms[load, 0, component]
            torn[here], patches[here] = _pieces(data.displacement[here], off[here], known[here], lines, least)
        if np.array_equal(torn, last):
            break
    return torn & last, patches & last


def _lines(data: WaveData, grid: Grid) -> np.ndarray:
    """(m, 4) indices of points in a row along an axis of the grid, both ways; -1 outside the mask and the grid."""
    number = np.pad(grid.box(np.where(data.mask, np.arange(len(data.points)), -1)), 2, constant_values=-1)
    rows = [sliding_window_view(number, 4, axis).reshape(-1, 4) for axis in range(number.ndim)]
    lines = np.concatenate([*rows, *(row[:, ::-1] for row in rows)])
    return lines[(lines[:, 1] >= 0) & (lines[:, 2] >= 0)]


def _pieces(
    u: np.ndarray, off: np.ndarray, known: np.ndarray, lines: np.ndarray, jump: float
) -> tuple[np.ndarray, np.ndarray]:
    """`torn_displacements` of one component: (n,) bool each."""
    lines = lines[known[lines[:, 1]] & known[lines[:, 2]]]
    none, there = np.zeros_like(known), known[lines] & (lines >= 0)
    if not len(lines):
        return none, none
    first, second = lines[:, 1], lines[:, 2]
    slope = np.where(there[:, :-1] & there[:, 1:], np.diff(u[lines], axis=1), np.nan)
    bends = np.abs(slope[:, [0, 2]] - slope[:, [1]])
    bend = np.nanmin(bends, axis=1, initial=np.inf)
    bend[np.isinf(bend)] = 0.0  # nothing to compare with
    short = np.abs(slope[:, 0] - slope[:, 2]) > bends.max(axis=1)  # a slope between its neighbours: a short wave
    bend[short] = 0.0
    apart = np.ones(len(lines), bool)
    for step in (np.abs(off[first] - off[second]), bend):
        apart &= step > max(FAR * float(np.median(step)) / np.sqrt(np.log(2)), jump)
    joined = first[~apart], second[~apart]
    graph = coo_array((np.ones(len(joined[0])), joined), shape=(len(known),) * 2)
    piece = connected_components(graph, directed=False)[1]
    size = np.bincount(piece[known], minlength=piece.max() + 1)
    seam = np.bincount(piece[first], apart, minlength=len(size))
    with_large = np.bincount(piece[first], apart & (size[piece[second]] >= PATCH), minlength=len(size))
    patch = (size >= PATCH) & (with_large > seam / 2)
    patch[size.argmax()] = False
    torn = known & ((size < PATCH) | patch)[piece]
    return (torn, torn & patch[piece]) if torn.sum() <= MOST_TORN * known.sum() else (none, none)


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


def _smooth(data: WaveData) -> SmoothField:
    return fit_splines(data, STIFF) if supports_splines(data) else moving_least_squares(data)


def _deviations(left: WaveData, data: WaveData, known: np.ndarray, far: float) -> tuple[np.ndarray, np.ndarray]:
    """|u - û| of all known displacements, NaN elsewhere, with û fitted to those that are left; and `far` σ."""
    off = np.where(known, np.abs(data.displacement - _smooth(left).values()), np.nan)
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


class Screened(NamedTuple):
    """Data without gross errors, notes on what was removed, and the share of displacements that whole patches had."""

    data: WaveData
    notes: list[str]
    patches: float = 0.0


def screen_outliers(data: WaveData) -> Screened:
    """Return the data of `remove_outliers`, and notes on what it removed.

    Where there are too few points for a smooth field, the data stay as they are.
    """
    try:
        torn, patches = torn_displacements(data)
        left = _remove_scattered(_remove(data, torn), FAR)
    except InputError:
        return Screened(data, ["gross errors were not looked for: there are too few points for a smooth field"])
    given, lost = int((data.measured & data.mask[:, None]).sum()), int((data.measured & ~left.measured).sum())
    if not lost:
        return Screened(data, [])
    share = f"{100 * lost / given:.2g} %"
    note = f"{lost} of {given} displacements ({share}) are far off a smooth field and were left out as gross errors"
    return Screened(left, [note], float(patches.sum() / given))
