"""Time samples of one period and MR phases, converted to complex amplitudes, their noise, and a mask.

    samples    (loads, n, d, N)   m, at t_j = jT/N, j = 0 … N-1, N at least 3 and T one period
    phase      (loads, n, d, N)   rad, wrapped or not, at these times; with
    encoding   () or (d,)         rad of phase per m of displacement
    magnitude  (n,)               magnitude image; the default mask is its largest bright component

Phases are unwrapped at each time and then in time. With more than three samples, the residual of the first harmonic gives the
noise, unless one is stated.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.mre.displacement import first_harmonic, phase_to_displacement, tissue_mask, unwrap_phase_in_time
from ngbrain.io.waves.grid import Grid

SAMPLED = ("samples", "phase", "encoding", "magnitude")
"""Keys that this module reads."""
REPEATED = 0.3
"""The last sample repeats the first if their difference, relative to the usual one between neighbours, is below this."""
FEWEST = 3
"""Minimum number of samples per period."""


def samples_to_amplitudes(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Replace the keys of `SAMPLED` by `displacement`, `mask` and `noise`.

    Raises
    ------
    InputError
        Samples are given beside displacements, have another shape, are too few, or belong to frequency 0; phases have no
        encoding, points that are not a grid, or move too fast to be unwrapped.
    MissingExtra
        scikit-image, needed for phases, is not installed.

    Examples
    --------
    >>> points = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> turn = np.exp(2j * np.pi * np.arange(4) / 4)
    >>> keys = {"points": points, "frequency": [50.0], "samples": np.real((1e-6 + 2e-6j) * np.ones((1, 9, 2, 1)) * turn)}
    >>> complex(np.round(1e6 * samples_to_amplitudes(keys)["displacement"][0, 0, 0], 9))
    (1+2j)
    """
    found = {name: value for name, value in keys.items() if name not in SAMPLED}
    if "magnitude" in keys and "mask" not in keys:
        found["mask"] = _mask(keys)
    given = [name for name in ("displacement", "samples", "phase") if name in keys]
    if len(given) > 1:
        raise InputError(given[1], f"given beside {given[0]}", "one of them")
    if given in ([], ["displacement"]):
        return found
    (name,) = given
    values = _over_time(name, keys)
    if name == "phase":
        encoding = _encoding(keys, values.shape[2])
        values = phase_to_displacement(_unwrap_in_time(values, keys, _given_mask(found)), encoding)
    found["displacement"], error = first_harmonic(values)
    times = values.shape[-1]
    if times > FEWEST and keys.get("noise") is None:
        found["noise"] = _relative(found["displacement"], np.sqrt(2 / times) * error, _given_mask(found))
    return found


def _over_time(name: str, keys: Mapping[str, Any]) -> np.ndarray:
    values = np.asarray(keys[name])
    shape = np.shape(keys.get("points", ()))
    shape = (*shape[:1], 1) if np.asarray(keys.get("motion", "")).item() == "anti_plane" else shape
    wanted = f"real numbers (loads, {', '.join(map(str, shape))}, times), at {FEWEST} times of a period or more"
    if values.ndim != 4 or values.dtype.kind not in "fiu" or values.shape[1:3] != shape or values.shape[3] < FEWEST:
        raise InputError(name, f"{values.dtype} of shape {values.shape}", wanted)
    frequency = np.asarray(keys.get("frequency", 1))
    if frequency.dtype.kind in "fiu" and not np.all(frequency > 0):
        raise InputError(name, "of a load at rest", "frequencies above 0, or displacement")
    values = values.astype(float)
    _check_times(name, values)
    return values


def _check_times(name: str, values: np.ndarray) -> None:
    """Refuse a last time that repeats the first: the two are then far closer than other neighbours."""
    turn = np.exp(1j * values) if name == "phase" else values
    steps = np.abs(np.diff(turn, axis=-1, append=turn[..., :1]))
    size = np.sqrt(np.nanmean(steps**2, axis=(0, 1, 2)))
    if size[-1] < REPEATED * np.median(size[:-1]):
        wanted = f"each time of the period once: leave out the last of {len(size)}"
        raise InputError(name, "the same at the last time as at the first", wanted)


def _encoding(keys: Mapping[str, Any], dim: int) -> np.ndarray:
    """Encoding (rad/m), broadcast to divide phases (loads, n, d, N)."""
    if "encoding" not in keys:
        raise InputError("encoding", "missing", "rad of phase per m of displacement, for all components or each")
    encoding = np.asarray(keys["encoding"])
    if encoding.dtype.kind not in "fiu" or encoding.shape not in ((), (1,), (dim,)):
        raise InputError("encoding", f"{encoding.dtype} of shape {encoding.shape}", f"one number or {dim}, rad/m")
    return np.broadcast_to(encoding.astype(float), (dim,))[:, None]


def _unwrap_in_time(phase: np.ndarray, keys: Mapping[str, Any], counting: np.ndarray) -> np.ndarray:
    """Unwrapped phases at the points of the mask; an unmeasured component stays NaN."""
    grid, found = _grid("phase", keys), np.full(phase.shape, np.nan)
    for load, i in np.ndindex(phase.shape[0], phase.shape[2]):
        if not np.isnan(phase[load, :, i]).all():
            found[load, :, i] = grid.flat(unwrap_phase_in_time(grid.box(phase[load, :, i]), grid.box(counting)))
    return found


def _given_mask(keys: Mapping[str, Any]) -> np.ndarray:
    """The mask (n,); an invalid mask is reported by `WaveData`."""
    mask, n = np.asarray(keys.get("mask", True)), len(keys["points"])
    return mask.astype(bool) if mask.shape == (n,) and mask.dtype.kind in "biuf" else np.ones(n, bool)


def _mask(keys: Mapping[str, Any]) -> np.ndarray:
    magnitude, grid = np.asarray(keys["magnitude"]), _grid("magnitude", keys)
    n = int(np.prod(grid.shape))
    if magnitude.shape != (n,) or magnitude.dtype.kind not in "fiu" or not np.isfinite(magnitude).all():
        raise InputError("magnitude", f"{magnitude.dtype} of shape {magnitude.shape}", f"finite real numbers ({n},)")
    return grid.flat(tissue_mask(grid.box(magnitude)))


def _grid(name: str, keys: Mapping[str, Any]) -> Grid:
    points = np.asarray(keys.get("points", ()))
    numbers = points.ndim == 2 and points.dtype.kind in "fiu" and np.isfinite(points).all()
    grid = Grid.from_points(points.astype(float)) if numbers else None
    if grid is None:
        raise InputError(name, "given at points that are no grid", "a grid, numbered along its first axis first")
    return grid


def _relative(u: np.ndarray, error: np.ndarray, counting: np.ndarray) -> float:
    """Noise of complex amplitudes, whose real and imaginary parts have `error`, relative to the rms of each component: the median
    over those that move.
    """
    size, off = (np.sqrt(np.nansum(np.abs(part[:, counting]) ** 2, axis=1)) for part in (u, error))
    return float(np.median(np.sqrt(2) * off[size > 0] / size[size > 0])) if size.any() else 0.0
