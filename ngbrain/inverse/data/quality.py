"""What wave data are good for, in numbers: strain over noise, nearness of a resonance, and how fine a map they determine."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError, NgbrainError
from ngbrain.forward.harmonic.factors import Factorised
from ngbrain.image.mre.displacement import gradient_noise, octahedral_amplitude, strain_snr
from ngbrain.image.preprocess.registration import largest_component
from ngbrain.inverse.data.outliers import discontinuity_share
from ngbrain.inverse.data.smoothing import fit_smooth_field
from ngbrain.io.waves import WaveData

STILL = 0.01
"""Part of the largest component's rms below which a component counts as still, see `noise_deviation`."""

NO_STRAIN = "no octahedral shear strain (OSS)"


RelativeNoise: TypeAlias = float | np.ndarray
"""Noise relative to the rms of each component: one number, or one for each point of the data (n,)."""


def noise_deviation(data: WaveData, relative: RelativeNoise, where: np.ndarray | None = None) -> np.ndarray:
    """Standard deviation (loads, 1, dim) m of real and of imaginary parts, for noise relative to each component's rms.

    Of noise by points (loads, points, dim), at those of them that are chosen (n,) bool.
    Of a component that hardly moves it is taken as a hundredth of the largest one's: none is known without error.
    """
    least = STILL * data.rms.max(axis=2, keepdims=True)
    if np.ndim(relative):
        relative = np.reshape(relative, (-1, 1))[slice(None) if where is None else where]
    return relative * np.maximum(data.rms, least) / np.sqrt(2)


def rms_noise(data: WaveData, relative: RelativeNoise) -> float:
    """One number for noise: the rms over the points of the mask.

    >>> grid = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 9, 2)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> round(rms_noise(data, np.repeat([0.01, 0.02], [4, 5])), 4)
    0.0163
    """
    return float(np.sqrt(np.mean(np.square(relative)[data.mask]))) if np.ndim(relative) else float(relative)


def total_noise(level: RelativeNoise, floor: RelativeNoise, model_error: float = 0.0) -> RelativeNoise:
    """Noise and model error together, and no less than a floor."""
    found = np.maximum(np.hypot(level, model_error), floor)
    return found if np.ndim(found) else float(found)


def noise_for_misfit(data: WaveData, noise: RelativeNoise, ratio: float, floor: RelativeNoise = 0.0) -> RelativeNoise:
    """Noise that explains a misfit of so many times what this one leaves, as one more error that is the same at all points.

    √(σ² + e²) with the mean of (σ² + e²)/σ² over the points as the ratio; less than σ for a ratio below 1, but not than a floor.

    >>> grid = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 9, 2)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> noise_for_misfit(data, 0.01, 4.0)
    0.02
    """
    more = np.square(noise) + (ratio - 1) / rms_noise(data, 1 / noise) ** 2
    return total_noise(np.sqrt(np.maximum(more, 0.0)), floor)


@dataclass(frozen=True, eq=False)
class OctahedralShearStrain:
    """Octahedral shear strain of measured waves (the mean over a period; at rest the strain itself) and what there is of it.

    oss   (loads, n), NaN where a component is not measured and at points that do not count
    snr   (loads, n), over its noise
    note  why there is none, or none of some loads; empty if nothing is missing
    volume  |∇·u| over |∇×u| of the waves, medians over points and loads: shear waves have 0; None where it is not known
    torn    share of the displacements beside a jump (`discontinuity_share`)
    """

    oss: np.ndarray
    snr: np.ndarray
    note: str = ""
    volume: float | None = None
    discontinuity_share: float = 0.0

    @property
    def median(self) -> float | None:
        """Of its ratio to noise, over all points and loads; None without any."""
        known = self.snr[np.isfinite(self.snr)]
        return float(np.median(known)) if known.size else None


def octahedral_shear_strain(data: WaveData, relative: RelativeNoise) -> OctahedralShearStrain:
    """The strain is that of a smooth field, its noise that of central differences over neighbours, as published values are.

    relative   noise of the displacement, as `noise_deviation` takes it

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
        return OctahedralShearStrain(oss, snr, f"{NO_STRAIN}, as no smooth field can be laid through the data: {error}")
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
    # Medians: at a rim with points left out single derivatives of a smooth field are anything.
    turned = float(np.median(np.concatenate(turn)))
    return OctahedralShearStrain(oss, snr, note, float(np.median(np.concatenate(volume))) / max(turned, 1e-300), jumps)


def strain_snr_mask(data: WaveData, noise: float | None, least: float) -> np.ndarray:
    """Which points (n,) of the mask have a strain of at least so many times its noise, in one load or more.

    noise   relative, None as for `noise_level`

    On a grid the largest piece of these, its holes filled: in nodes of standing waves nothing is strained, yet they are tissue.

    Raises `InputError` where no strain can be told.
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
    """Of neighbours along each axis (dim,) m."""
    if data.grid:
        return np.asarray(data.grid.spacing @ np.abs(data.grid.axes))
    return np.full(data.dim, data.point_spacing)


def resonance_distance(data: WaveData, factors: Factorised) -> float | None:
    """The smallest |ω_j - ω|/ω over the loads of data without loss (`Factorised.detuning`); None for all others."""
    moving = {float(f): load for load, f in enumerate(data.frequency) if f > 0}
    if data.rheology == "viscoelastic" or not moving:
        return None
    return min(factors.detuning(load) for load in moving.values())


def map_resolution(size: float, dim: int, determined: Mapping[str, float]) -> dict[str, float]:
    """A hint at the finest detail (m) of each field: the side of the region's share for every number that is determined.

    size        m² or m³, of the region
    determined  how many numbers of a field the data determine

    >>> map_resolution(0.01, 2, {"storage": 100.0})
    {'storage': 0.01}
    """
    return {name: float((size / max(number, 1.0)) ** (1 / dim)) for name, number in determined.items()}


def noise_level(data: WaveData, given: float | None) -> tuple[RelativeNoise, str]:
    """Relative noise: as given, as the data say, or as a smooth fit finds it; and a note where it had to be found."""
    if given is not None:
        return given, ""
    if data.noise is not None:
        return data.noise, ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = fit_smooth_field(data).noise
    except NgbrainError:
        return 0.01, "noise is taken as 1 %: it was not given, and no smooth field could be laid through the data"
    measured = np.isfinite(found) & (data.rms[:, 0] > 0)
    noise = float(np.median(found[measured] / data.rms[:, 0][measured]))
    return (
        noise,
        f"noise was not given: a smooth field through the data leaves {100 * noise:.3g} %, then the misfit tells",
    )
