"""The quality of wave data: noise, strain SNR, distance of a resonance, and resolution of maps."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError, NgbrainError
from ngbrain.forward.harmonic.factors import Factorised
from ngbrain.image.mre.strain import gradient_noise, octahedral_amplitude, strain_snr
from ngbrain.image.preprocess.registration import largest_component
from ngbrain.inverse.data.outliers import discontinuity_share
from ngbrain.inverse.data.smoothing import fit_smooth_field
from ngbrain.io.waves import WaveData
from ngbrain.look import BriefText

STILL = 0.01
"""Least rms of a component for its noise, relative to the largest component's, see `noise_deviation`."""

NO_STRAIN = "no octahedral shear strain (OSS)"


RelativeNoise: TypeAlias = float | np.ndarray
"""Noise relative to the rms of each component: one number, or one for each point of the data (n,)."""


def noise_deviation(data: WaveData, relative: RelativeNoise, where: np.ndarray | None = None) -> np.ndarray:
    """Return the standard deviation of real and of imaginary parts, for noise relative to each component's rms.

    For a component that hardly moves, the rms counts as at least a hundredth of the largest component's: no component is
    known without error.

    Parameters
    ----------
    data : WaveData
        The data.
    relative : RelativeNoise
        Relative noise.
    where : numpy.ndarray, optional
        (n,) bool, the points of noise by points.

    Returns
    -------
    numpy.ndarray
        (loads, 1, dim) m; for noise by points (loads, points, dim).
    """
    least = STILL * data.rms.max(axis=2, keepdims=True)
    if np.ndim(relative):
        relative = np.reshape(relative, (-1, 1))[slice(None) if where is None else where]
    return relative * np.maximum(data.rms, least) / np.sqrt(2)


def rms_noise(data: WaveData, relative: RelativeNoise) -> float:
    """Return one number for relative noise: the rms over the points of the mask.

    Parameters
    ----------
    data : WaveData
        The data.
    relative : RelativeNoise
        Relative noise.

    Returns
    -------
    float
        The rms.

    Examples
    --------
    >>> grid = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 9, 2)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> round(rms_noise(data, np.repeat([0.01, 0.02], [4, 5])), 4)
    0.0163
    """
    return float(np.sqrt(np.mean(np.square(relative)[data.mask]))) if np.ndim(relative) else float(relative)


def total_noise(level: RelativeNoise, floor: RelativeNoise, model_error: float = 0.0) -> RelativeNoise:
    """Return noise and model error together, with a lower bound.

    Parameters
    ----------
    level : RelativeNoise
        Relative noise.
    floor : RelativeNoise
        Lower bound.
    model_error : float
        Relative model error.

    Returns
    -------
    RelativeNoise
        The total.
    """
    found = np.maximum(np.hypot(level, model_error), floor)
    return found if np.ndim(found) else float(found)


def noise_for_misfit(data: WaveData, noise: RelativeNoise, ratio: float, floor: RelativeNoise = 0.0) -> RelativeNoise:
    """Return the noise that explains a misfit, as an additional error e that is the same at all points.

    It is √(σ² + e²), where the mean of (σ² + e²)/σ² over the points equals the ratio. For a ratio below 1 it is less than σ.

    Parameters
    ----------
    data : WaveData
        The data.
    noise : RelativeNoise
        Relative noise σ.
    ratio : float
        Misfit over its expected value for this noise.
    floor : RelativeNoise
        Lower bound.

    Returns
    -------
    RelativeNoise
        The noise.

    Examples
    --------
    >>> grid = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 9, 2)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> noise_for_misfit(data, 0.01, 4.0)
    0.02
    """
    more = np.square(noise) + (ratio - 1) / rms_noise(data, 1 / noise) ** 2
    return total_noise(np.sqrt(np.maximum(more, 0.0)), floor)


@dataclass(frozen=True, eq=False, repr=False)
class OctahedralShearStrain(BriefText):
    """Octahedral shear strain of measured waves, its SNR, and related checks.

    Parameters
    ----------
    oss : numpy.ndarray
        (loads, n) the mean over a period; for quasi-static loads the strain itself. NaN where a component is not measured and
        at points outside the mask.
    snr : numpy.ndarray
        (loads, n) over its noise.
    note : str
        Why there is no strain, or none of some loads; empty if nothing is missing.
    volume : float, optional
        |∇·u| over |∇×u| of the waves, medians over points and loads; 0 for shear waves.
    discontinuity_share : float
        Share of displacements beside a jump (`outliers.discontinuity_share`).
    """

    oss: np.ndarray
    snr: np.ndarray
    note: str = ""
    volume: float | None = None
    discontinuity_share: float = 0.0

    @property
    def median(self) -> float | None:
        """Median SNR over all points and loads; None without any."""
        known = self.snr[np.isfinite(self.snr)]
        return float(np.median(known)) if known.size else None


def octahedral_shear_strain(data: WaveData, relative: RelativeNoise) -> OctahedralShearStrain:
    """Compute the octahedral shear strain and its SNR.

    The strain is that of a smooth field. Its noise is that of central differences over neighbours, as in published values.

    Parameters
    ----------
    data : WaveData
        The data.
    relative : RelativeNoise
        Noise of the displacement, as `noise_deviation` takes it.

    Returns
    -------
    OctahedralShearStrain
        Strain and SNR.

    Examples
    --------
    >>> line = np.arange(12) * 2e-3
    >>> grid = np.array([[x, y] for y in line for x in line])
    >>> u = 1e-5 * np.stack([np.exp(-200j * grid[:, 1]), 0 * grid[:, 0]], axis=1)[None]
    >>> data = WaveData(grid, u, [50.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4)
    >>> shear = 2e-3  # its amplitude: 200/m of 1e-5 m
    >>> bool(abs(np.median(octahedral_shear_strain(data, 0.01).oss) / (2 / np.pi * np.sqrt(2 / 3) * shear) - 1) < 1e-3)
    True
    """
    known = data.measured & data.mask[:, None]
    oss, snr = np.full((2, data.loads, len(data.points)), np.nan)
    never = ~known.any(axis=1)
    missing = [
        f"component{'s' if lost.sum() > 1 else ''} {' and '.join(np.array(list(data.components))[lost])} of load {load + 1}"
        for load, lost in enumerate(never)
        if lost.any()
    ]
    note = f"{NO_STRAIN} where a component is never measured: {', '.join(missing)}" if missing else ""
    loads = np.flatnonzero(~never.any(axis=1))
    if not len(loads):
        return OctahedralShearStrain(oss, snr, note)
    try:
        gradient = fit_smooth_field(data).gradient()
    except NgbrainError as error:
        return OctahedralShearStrain(oss, snr, f"{NO_STRAIN}, as no smooth field fits the data: {error}")
    noise = gradient_noise(noise_deviation(data, relative), _spacing(data))
    volume, turn = list[np.ndarray](), list[np.ndarray]()
    for load in loads:
        where = known[load].all(axis=1)
        off = noise[load, where] if np.ndim(relative) else noise[load]
        slope = gradient[load, where]
        if data.motion == "anti_plane":  # the third row of a gradient in space
            off, slope = (_third_row(each) for each in (off, slope))
        elif data.frequency[load]:
            volume.append(np.abs(np.trace(slope, axis1=1, axis2=2)))
            turn.append(np.linalg.norm(slope - slope.swapaxes(1, 2), axis=(1, 2)) / np.sqrt(2))
        if data.frequency[load]:
            mean, at = octahedral_amplitude(slope)[1], strain_snr(slope, off)[0]
        else:  # a cosine's mean is 2/π of its peak
            still = slope.real
            mean, at = octahedral_amplitude(still)[0], np.pi / 2 * strain_snr(still, off)[0]
        oss[load, where], snr[load, where] = mean, at
    jumps = discontinuity_share(data) if data.frequency.any() else 0.0
    if not turn:
        return OctahedralShearStrain(oss, snr, note, None, jumps)
    # Medians: at a rim with points left out, single derivatives of a smooth field are unreliable.
    turned = float(np.median(np.concatenate(turn)))
    return OctahedralShearStrain(oss, snr, note, float(np.median(np.concatenate(volume))) / max(turned, 1e-300), jumps)


def strain_snr_mask(data: WaveData, noise: float | None, least: float) -> np.ndarray:
    """Return the points of the mask with a minimum strain SNR in at least one load.

    On a grid it is the largest connected piece of these with its holes filled: nodes of standing waves have no strain, yet
    they are tissue.

    Parameters
    ----------
    data : WaveData
        The data.
    noise : float or None
        Relative noise, as `noise_level` takes it.
    least : float
        Minimum SNR.

    Returns
    -------
    numpy.ndarray
        (n,) bool.

    Raises
    ------
    InputError
        The data have no strain SNR.
    """
    strain = octahedral_shear_strain(data, noise_level(data, noise)[0])
    if strain.median is None:
        raise InputError(
            "displacement", strain.note or "without noise", "all components and noise, or no least OSS-SNR"
        )
    strained, grid = (np.nan_to_num(strain.snr) >= least).any(axis=0), data.grid
    if grid:
        strained = grid.flat(ndimage.binary_fill_holes(largest_component(grid.box(strained))))
    return np.asarray(data.mask & strained)


def _third_row(gradient: np.ndarray) -> np.ndarray:
    """(…, 1, 2) ∂u_z/∂x and ∂u_z/∂y as (…, 3, 3)."""
    whole = np.zeros((*gradient.shape[:-2], 3, 3), gradient.dtype)
    whole[..., 2:, :2] = gradient
    return whole


def _spacing(data: WaveData) -> np.ndarray:
    """Spacing of neighbours along each axis, (dim,) m."""
    if data.grid:
        return np.asarray(data.grid.spacing @ np.abs(data.grid.axes))
    return np.full(data.dim, data.point_spacing)


def resonance_distance(data: WaveData, factors: Factorised) -> float | None:
    """Return the smallest |ω_j - ω|/ω over the loads of data without loss, with resonances ω_j.

    Parameters
    ----------
    data : WaveData
        The data.
    factors : HarmonicFactors
        Factorised wave problem.

    Returns
    -------
    float or None
        The distance; None for other data.
    """
    moving = {float(f): load for load, f in enumerate(data.frequency) if f > 0}
    if data.rheology == "viscoelastic" or not moving:
        return None
    return min(factors.detuning(load) for load in moving.values())


def map_resolution(size: float, dim: int, determined: Mapping[str, float]) -> dict[str, float]:
    """Return an estimate of the finest detail of each field: the side of the region's share for each determined parameter.

    Parameters
    ----------
    size : float
        Area or volume of the region, m² or m³.
    dim : int
        2 or 3.
    determined : mapping of str to float
        Field → number of parameters that the data determine.

    Returns
    -------
    dict of str to float
        Field → m

    Examples
    --------
    >>> map_resolution(0.01, 2, {"storage": 100.0})
    {'storage': 0.01}
    """
    return {name: float((size / max(number, 1.0)) ** (1 / dim)) for name, number in determined.items()}


def noise_level(data: WaveData, given: float | None) -> tuple[RelativeNoise, str]:
    """Return the relative noise, and a note where it had to be estimated.

    Parameters
    ----------
    data : WaveData
        Data that may state their noise.
    given : float or None
        A given level.

    Returns
    -------
    level : RelativeNoise
        The given level, that of the data, or the residual of a smooth fit.
    note : str
        A sentence, or empty.
    """
    if given is not None:
        return given, ""
    if data.noise is not None:
        return data.noise, ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = fit_smooth_field(data).noise
    except NgbrainError:
        return 0.01, "noise is taken as 1 %: it was not given, and no smooth field fits the data"
    measured = np.isfinite(found) & (data.rms[:, 0] > 0)
    noise = float(np.median(found[measured] / data.rms[:, 0][measured]))
    return (
        noise,
        f"noise was not given: a smooth field through the data leaves {100 * noise:.3g} %, then the misfit decides",
    )
