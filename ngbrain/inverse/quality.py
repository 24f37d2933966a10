"""What wave data are good for, in numbers: strain over noise, nearness of a resonance, and how fine a map they determine."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np
from scipy.spatial import KDTree

from ngbrain.errors import NgbrainError
from ngbrain.forward.factors import Factorised
from ngbrain.image.wavefield import gradient_noise, strain_snr
from ngbrain.inverse.smoothing import smoothed
from ngbrain.io.waves import WaveData

STILL = 0.01
"""Part of the largest component's rms below which a component counts as still, see `noise_of`."""


def noise_of(data: WaveData, relative: float) -> np.ndarray:
    """Standard deviation (loads, 1, dim) m of real and of imaginary parts, for noise relative to each component's rms.

    Of a component that hardly moves it is taken as a hundredth of the largest one's: none is known without error.
    """
    least = STILL * data.rms.max(axis=2, keepdims=True)
    return relative * np.maximum(data.rms, least) / np.sqrt(2)


def median_strain_snr(data: WaveData, relative: float) -> float | None:
    """Median of the octahedral shear strain over its noise (`strain_snr`), all loads and points of the mask.

    The strain is that of a smooth field, its noise that of central differences over neighbours, as published values are.
    None where a component is not measured, or no smooth field can be laid through the data.
    """
    if not data.measured[:, data.mask].all() or relative <= 0:
        return None
    try:
        gradient = smoothed(data).gradient()[:, data.mask]
    except NgbrainError:
        return None
    if data.structured:
        spacing = data.structured.spacing @ np.abs(data.structured.axes)
    else:
        spacing = np.full(
            data.dim, np.median(KDTree(data.points[data.mask]).query(data.points[data.mask], k=2)[0][:, 1])
        )
    noise = gradient_noise(noise_of(data, relative), spacing)
    return float(np.median(strain_snr(gradient, noise)[0]))


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
