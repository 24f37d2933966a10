"""From MR phases to harmonic displacements.

Phase φ(x, t) → `unwrap_phase_in_time` → `phase_to_displacement` → `first_harmonic` → `remove_rigid_motion` →
`ngbrain.image.mre.strain.strain_snr`. The first axes of every array are those of the image; each function names further axes.
"""

from __future__ import annotations

import itertools
from functools import reduce

import numpy as np
from scipy import ndimage
from scipy.fft import dctn, idctn
from scipy.sparse.linalg import LinearOperator, cg

from ngbrain.errors import InputError, require
from ngbrain.image.preprocess.registration import largest_component, otsu_threshold


def tissue_mask(magnitude: np.ndarray) -> np.ndarray:
    """Mask (nx, ny[, nz]) from a magnitude image: its largest bright component, with holes filled.

    >>> ball = np.linalg.norm(np.indices((20, 20)) - 9.5, axis=0)
    >>> found = tissue_mask(np.select([ball < 2, ball < 7], [10.0, 300.0], 20.0))
    >>> bool((found == (ball < 7)).all())
    True
    """
    magnitude = np.asarray(magnitude, float)
    return np.asarray(ndimage.binary_fill_holes(largest_component(magnitude > otsu_threshold(magnitude))))


def unwrap_phase(phase: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Unwrap the phase of a 2-D or 3-D image by sorting on reliability.

    The result is unique up to a multiple of 2π per connected component of the mask. It fails where the true phase differs by
    more than π between neighbouring voxels.

    Parameters
    ----------
    phase : numpy.ndarray
        (nx, ny[, nz]) rad, taken modulo 2π.
    mask : numpy.ndarray, optional
        (nx, ny[, nz]) voxels to unwrap; the result is 0 elsewhere.

    Returns
    -------
    numpy.ndarray
        (nx, ny[, nz]) rad.

    Raises
    ------
    InputError
        The image has another number of axes, the mask another shape, or the phase is not finite in the mask.
    MissingExtra
        scikit-image is not installed.

    References
    ----------
    Herráez et al. 2002, doi:10.1364/AO.41.007437, as implemented in scikit-image.

    Examples
    --------
    >>> true = np.linspace(0, 20, 40)[:, None] * np.ones(5)
    >>> found = unwrap_phase(np.angle(np.exp(1j * true)))
    >>> bool(np.ptp(found - true) < 1e-9)
    True
    """
    phase, mask = _phase(phase, mask)
    turned = np.angle(np.exp(1j * np.where(mask, phase, 0)))
    restoration = require("skimage.restoration", "mri")
    return np.where(mask, np.ma.filled(restoration.unwrap_phase(np.ma.array(turned, mask=~mask), rng=0), 0.0), 0.0)


def unwrap_phase_least_squares(phase: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Unwrap the phase of a 2-D or 3-D image by least squares; needs no optional package.

    Minimises Σ (Δφ - wrapped Δphase)² over all neighbours in the mask by conjugate gradients, preconditioned by the cosine
    transform on the whole image. Every value is then shifted by the multiple of 2π that brings it nearest to φ. The result
    depends on no single path, so that a noisy voxel does not affect those behind it; residues caused by strong noise make
    slopes too small.

    Parameters
    ----------
    phase : numpy.ndarray
        (nx, ny[, nz]) rad, taken modulo 2π.
    mask : numpy.ndarray, optional
        (nx, ny[, nz]) voxels to unwrap; the result is 0 elsewhere.

    Returns
    -------
    numpy.ndarray
        (nx, ny[, nz]) rad.

    Raises
    ------
    InputError
        As `unwrap_phase`.

    References
    ----------
    Ghiglia & Romero 1994, doi:10.1364/JOSAA.11.000107.
    """
    phase, mask = _phase(phase, mask)
    phase = np.where(mask, phase, 0)
    pairs = [(*_ends(phase.ndim, axis), axis) for axis in range(phase.ndim)]
    joined = [mask[first] & mask[last] for first, last, _ in pairs]

    def gathered(steps: list[np.ndarray]) -> np.ndarray:
        total = np.zeros(phase.shape)
        for (first, last, _), step in zip(pairs, steps, strict=True):
            total[first] -= step
            total[last] += step
        return total

    def laplacian(x: np.ndarray) -> np.ndarray:
        x = x.reshape(phase.shape)
        return gathered(
            [np.diff(x, axis=axis) * both for (_, _, axis), both in zip(pairs, joined, strict=True)]
        ).ravel()

    right = gathered(
        [
            np.angle(np.exp(1j * np.diff(phase, axis=axis))) * both
            for (_, _, axis), both in zip(pairs, joined, strict=True)
        ]
    )
    turns = [2 - 2 * np.cos(np.pi * np.arange(n) / n) for n in phase.shape]
    eigenvalues = reduce(np.add.outer, turns)
    eigenvalues[(0,) * phase.ndim] = np.inf  # the constant
    n = phase.size
    by_cosines = LinearOperator((n, n), lambda x: idctn(dctn(x.reshape(phase.shape)) / eigenvalues).ravel())
    smooth, _ = cg(LinearOperator((n, n), laplacian), right.ravel(), rtol=1e-6, maxiter=300, M=by_cosines)
    off = smooth.reshape(phase.shape) - phase
    pieces, count = ndimage.label(mask)
    # The constant of each component is free; this one makes most shifts close to multiples of 2π.
    number = range(1, count + 1)
    turned = ndimage.mean(np.cos(off), pieces, number) + 1j * ndimage.mean(np.sin(off), pieces, number)
    level = np.r_[0.0, np.angle(turned)]
    return np.where(mask, phase + 2 * np.pi * np.round((off - level[pieces]) / (2 * np.pi)), 0)


def unwrap_phase_in_time(phase: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Unwrap phases at times equally spaced over one period, in space and in time.

    Each time is unwrapped by `unwrap_phase`; then each connected component is shifted by the multiple of 2π that brings most
    voxels within π of the time before. One multiple of 2π per component, the same at all times, stays unknown: it does not
    affect the harmonic.

    Parameters
    ----------
    phase : numpy.ndarray
        (nx, ny[, nz], N) rad.
    mask : numpy.ndarray, optional
        (nx, ny[, nz]).

    Returns
    -------
    numpy.ndarray
        (nx, ny[, nz], N) rad.

    Raises
    ------
    InputError
        As `unwrap_phase`; or the last time does not lead back to the first, as the phase changes by more than π between times.

    Examples
    --------
    >>> x, y, t = np.arange(12)[:, None, None], np.arange(3)[:, None], np.arange(8)
    >>> true = 0.5 * x + y + 4 * np.sin(x / 2) * np.cos(2 * np.pi * t / 8)
    >>> off = unwrap_phase_in_time(np.angle(np.exp(1j * true))) - true
    >>> bool(np.ptp(off) < 1e-9)
    True
    """
    phase = np.asarray(phase, float)
    mask = np.ones(phase.shape[:-1], bool) if mask is None else np.asarray(mask, bool)
    found = np.stack([unwrap_phase(each, mask) for each in np.moveaxis(phase, -1, 0)], axis=-1)
    pieces, count = ndimage.label(mask)
    for number in range(1, count + 1):
        here = pieces == number
        steps = np.diff(found[here], axis=-1, append=found[here][:, :1])
        turns = np.rint(np.median(np.rint(steps / (2 * np.pi)), axis=0))
        if turns.sum():
            wanted = "steps of less than π from time to time: more times, or a smaller encoding"
            raise InputError("phase", "of a motion too fast to be unwrapped through time", wanted)
        found[here] -= 2 * np.pi * np.r_[0, np.cumsum(turns[:-1])]
    return found


def phase_to_displacement(phase: np.ndarray, encoding: float | np.ndarray) -> np.ndarray:
    """Displacement from unwrapped phase and motion encoding.

    Parameters
    ----------
    phase : numpy.ndarray
        Unwrapped phase (rad).
    encoding : float or numpy.ndarray
        Motion encoding (rad per m of displacement).

    Returns
    -------
    numpy.ndarray
        Displacement (m).

    Raises
    ------
    InputError
        The encoding is 0 or not finite.
    """
    if not (np.isfinite(encoding).all() and np.all(encoding)):
        raise InputError("encoding", np.ravel(encoding).tolist(), "rad/m, not 0")
    return np.asarray(phase) / encoding


def first_harmonic(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First harmonic u of samples s_j = Re(u e^{2πij/N}) + rest over one period, and its residual.

    Parameters
    ----------
    samples : numpy.ndarray
        (…, N) real, at N ≥ 3 equally spaced times t_j = jT/N.

    Returns
    -------
    u : numpy.ndarray
        (…) complex: u = 2/N Σ_j s_j e^{-2πij/N}.
    error : numpy.ndarray
        (…) standard deviation of the residual of mean and first harmonic, with N - 3 degrees of freedom; 0 for N = 3. The
        standard error of the real and of the imaginary part of u is √(2/N) of it.

    Raises
    ------
    InputError
        There are fewer than 3 samples, or complex values.

    Examples
    --------
    >>> t = 2 * np.pi * np.arange(8) / 8
    >>> u, error = first_harmonic(0.5 + 3 * np.cos(t) - 4 * np.sin(t))
    >>> complex(np.round(u, 12)), bool(error < 1e-12)
    ((3+4j), True)
    """
    samples = np.asarray(samples)
    if samples.ndim < 1 or samples.shape[-1] < 3 or np.iscomplexobj(samples):
        raise InputError("samples", f"{samples.dtype} of shape {samples.shape}", "real values (…, N), N at least 3")
    n = samples.shape[-1]
    turn = np.exp(2j * np.pi * np.arange(n) / n)
    u = 2 / n * (samples @ turn.conj())
    left = samples - samples.mean(axis=-1, keepdims=True) - (u[..., None] * turn).real
    return u, np.sqrt((left**2).sum(axis=-1) / max(n - 3, 1)) * (n > 3)


def remove_rigid_motion(u: np.ndarray, points: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Remove the rigid motion of the head: u - (a + b × x), by least squares.

    Parameters
    ----------
    u : numpy.ndarray
        (n, d) displacements (m), complex or real.
    points : numpy.ndarray
        (n, d) m, d = 2 or 3.
    mask : numpy.ndarray, optional
        (n,) points used by the fit; NaN values are never used.

    Returns
    -------
    numpy.ndarray
        (n, d) m.

    Raises
    ------
    InputError
        The shapes differ, or nothing is measured.

    Examples
    --------
    >>> x = np.random.default_rng(0).normal(size=(20, 2))
    >>> bool(np.abs(remove_rigid_motion([1.0, 2j] + 3j * x[:, ::-1] * [-1, 1], x)).max() < 1e-12)
    True
    """
    u, points = np.asarray(u), np.asarray(points, float)
    if u.ndim != 2 or u.shape != points.shape or u.shape[1] not in (2, 3):
        raise InputError("displacement", f"of shape {u.shape} at points {points.shape}", "(n, 2) or (n, 3), both")
    d = points.shape[1]
    known = np.isfinite(u) & (True if mask is None else np.asarray(mask, bool)[:, None])
    seen = known.any(axis=1)
    if not seen.any():
        raise InputError("displacement", "nowhere measured", "values at some points")
    centre = points[seen].mean(axis=0)
    x = (points - centre) / max(float(np.abs(points[seen] - centre).max()), 1e-300)
    modes = [np.broadcast_to(row, x.shape) for row in np.eye(d)]
    for i, j in itertools.combinations(range(d), 2):
        mode = np.zeros_like(x)
        mode[:, i], mode[:, j] = -x[:, j], x[:, i]
        modes.append(mode)
    A = np.stack(modes, axis=-1)
    found, *_ = np.linalg.lstsq(A[known], u[known], rcond=1e-10)
    return u - A @ found


def _phase(phase: np.ndarray, mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    phase = np.asarray(phase, float)
    mask = np.ones(phase.shape, bool) if mask is None else np.asarray(mask, bool)
    if phase.ndim not in (2, 3) or mask.shape != phase.shape:
        raise InputError(
            "phase", f"of shape {phase.shape}, mask {mask.shape}", "an image of two or three axes, its mask"
        )
    if not mask.any() or not np.isfinite(phase[mask]).all():
        raise InputError("phase", "not finite in the mask, or the mask empty", "rad at every voxel of the mask")
    return phase, mask


def _ends(d: int, axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices of all but the last and of all but the first along an axis."""
    first, last = ([slice(None)] * d for _ in range(2))
    first[axis], last[axis] = slice(None, -1), slice(1, None)
    return tuple(first), tuple(last)
