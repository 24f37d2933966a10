"""What wave data are good for, in numbers: strain over noise, nearness of a resonance, and how fine a map they determine."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import KDTree

from ngbrain.errors import InputError, NgbrainError
from ngbrain.forward.factors import Factorised
from ngbrain.image.align import largest
from ngbrain.image.wavefield import gradient_noise, octahedral_amplitude, strain_snr
from ngbrain.inverse.smoothing import smoothed
from ngbrain.io.waves import WaveData

STILL = 0.01
"""Part of the largest component's rms below which a component counts as still, see `noise_of`."""

NO_STRAIN = "no octahedral shear strain (OSS)"


def noise_of(data: WaveData, relative: float) -> np.ndarray:
    """Standard deviation (loads, 1, dim) m of real and of imaginary parts, for noise relative to each component's rms.

    Of a component that hardly moves it is taken as a hundredth of the largest one's: none is known without error.
    """
    least = STILL * data.rms.max(axis=2, keepdims=True)
    return relative * np.maximum(data.rms, least) / np.sqrt(2)


@dataclass(frozen=True, eq=False)
class Strain:
    """Octahedral shear strain of measured waves (the mean over a period; at rest the strain itself) and what there is of it.

    oss   (loads, n), NaN where a component is not measured and at points that do not count
    snr   (loads, n), over its noise
    note  why there is none, or none of some loads; empty if nothing is missing
    """

    oss: np.ndarray
    snr: np.ndarray
    note: str = ""

    @property
    def median(self) -> float | None:
        """Of its ratio to noise, over all points and loads; None without any."""
        known = self.snr[np.isfinite(self.snr)]
        return float(np.median(known)) if known.size else None


def strain_of(data: WaveData, relative: float) -> Strain:
    """The strain is that of a smooth field, its noise that of central differences over neighbours, as published values are.

    relative   noise of the displacement, as `noise_of` takes it

    >>> line = np.arange(12) * 2e-3
    >>> grid = np.array([[x, y] for y in line for x in line])
    >>> u = 1e-5 * np.stack([np.exp(-200j * grid[:, 1]), 0 * grid[:, 0]], axis=1)[None]
    >>> data = WaveData(grid, u, [50.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4)
    >>> shear = 2e-3  # its amplitude: 200/m of 1e-5 m
    >>> bool(abs(np.median(strain_of(data, 0.01).oss) / (2 / np.pi * np.sqrt(2 / 3) * shear) - 1) < 1e-3)
    True
    """
    known = data.measured & data.mask[:, None]
    oss, snr = np.full((2, data.loads, len(data.points)), np.nan)
    never = ~known.any(axis=1)
    missing = [
        f"component{'s' if lost.sum() > 1 else ''} {' and '.join(np.array(list('xyz'))[: data.dim][lost])} of load {load + 1}"
        for load, lost in enumerate(never)
        if lost.any()
    ]
    note = f"{NO_STRAIN} where a component is never measured: {', '.join(missing)}" if missing else ""
    loads = np.flatnonzero(~never.any(axis=1))
    if not len(loads):
        return Strain(oss, snr, note)
    try:
        gradient = smoothed(data).gradient()
    except NgbrainError as error:
        return Strain(oss, snr, f"{NO_STRAIN}, as no smooth field can be laid through the data: {error}")
    noise = gradient_noise(noise_of(data, relative), _spacing(data))
    for load in loads:
        where = known[load].all(axis=1)
        if data.frequency[load]:
            mean, at = octahedral_amplitude(gradient[load, where])[1], strain_snr(gradient[load, where], noise[load])[0]
        else:  # a cosine's mean is 2/π of its peak
            still = gradient[load, where].real
            mean, at = octahedral_amplitude(still)[0], np.pi / 2 * strain_snr(still, noise[load])[0]
        oss[load, where], snr[load, where] = mean, at
    return Strain(oss, snr, note)


def where_strained(data: WaveData, noise: float | None, least: float) -> np.ndarray:
    """Which points (n,) of the mask have a strain of at least so many times its noise, in one load or more.

    noise   relative, None as for `noise_level`

    On a grid the largest piece of these, its holes filled: in nodes of standing waves nothing is strained, yet they are tissue.

    Raises `InputError` where no strain can be told.
    """
    strain = strain_of(data, noise_level(data, noise)[0])
    if strain.median is None:
        raise InputError(
            "displacement", strain.note or "without noise", "all components and noise, or no least OSS-SNR"
        )
    strained, grid = (np.nan_to_num(strain.snr) >= least).any(axis=0), data.structured
    if grid:
        strained = grid.flat(ndimage.binary_fill_holes(largest(grid.box(strained))))
    return np.asarray(data.mask & strained)


def _spacing(data: WaveData) -> np.ndarray:
    """Of neighbours along each axis (dim,) m."""
    if data.structured:
        return np.asarray(data.structured.spacing @ np.abs(data.structured.axes))
    points = data.points[data.mask]
    return np.full(data.dim, np.median(KDTree(points).query(points, k=2)[0][:, 1]))


def resonance_distance(data: WaveData, factors: Factorised) -> float | None:
    """The smallest |ω_j - ω|/ω over the loads of data without loss (`Factorised.detuning`); None for all others."""
    moving = {float(f): load for load, f in enumerate(data.frequency) if f > 0}
    if data.rheology == "viscoelastic" or not moving:
        return None
    return min(factors.detuning(load) for load in moving.values())


def resolution(size: float, dim: int, determined: Mapping[str, float]) -> dict[str, float]:
    """A hint at the finest detail (m) of each field: the side of the region's share for every number that is determined.

    size        m² or m³, of the region
    determined  how many numbers of a field the data determine

    >>> resolution(0.01, 2, {"storage": 100.0})
    {'storage': 0.01}
    """
    return {name: float((size / max(number, 1.0)) ** (1 / dim)) for name, number in determined.items()}


def noise_level(data: WaveData, given: float | None) -> tuple[float, str]:
    """Relative noise: as given, as the data say, or as a smooth fit finds it; and a note where it had to be found."""
    if given is not None:
        return given, ""
    if data.noise is not None:
        return data.noise, ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = smoothed(data).noise
    except NgbrainError:
        return 0.01, "noise is taken as 1 %: it was not given, and no smooth field could be laid through the data"
    measured = np.isfinite(found) & (data.rms[:, 0] > 0)
    noise = float(np.median(found[measured] / data.rms[:, 0][measured]))
    return (
        noise,
        f"noise was not given: a smooth field through the data leaves {100 * noise:.3g} %, then the misfit tells",
    )
