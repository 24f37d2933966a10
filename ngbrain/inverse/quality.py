"""What wave data are good for, in numbers: strain over noise, nearness of a resonance, and how fine a map they determine."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from scipy.spatial import KDTree

from ngbrain.errors import NgbrainError
from ngbrain.forward.factors import Factorised
from ngbrain.image.wavefield import gradient_noise, strain_snr
from ngbrain.inverse.smoothing import smoothed
from ngbrain.io.waves import WaveData

STILL = 0.01
"""Part of the largest component's rms below which a component counts as still, see `noise_of`."""


Relative: TypeAlias = float | np.ndarray
"""Noise relative to the rms of each component: one number, or one for each point of the data (n,)."""


def noise_of(data: WaveData, relative: Relative, where: np.ndarray | None = None) -> np.ndarray:
    """Standard deviation (loads, 1, dim) m of real and of imaginary parts, for noise relative to each component's rms.

    Of noise by points (loads, points, dim), at those of them that are chosen (n,) bool.
    Of a component that hardly moves it is taken as a hundredth of the largest one's: none is known without error.
    """
    least = STILL * data.rms.max(axis=2, keepdims=True)
    if np.ndim(relative):
        relative = np.reshape(relative, (-1, 1))[slice(None) if where is None else where]
    return relative * np.maximum(data.rms, least) / np.sqrt(2)


def overall(data: WaveData, relative: Relative) -> float:
    """One number for noise: the rms over the points of the mask.

    >>> grid = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 9, 2)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> round(overall(data, np.repeat([0.01, 0.02], [4, 5])), 4)
    0.0163
    """
    return float(np.sqrt(np.mean(np.square(relative)[data.mask]))) if np.ndim(relative) else float(relative)


def total(level: Relative, floor: Relative, model_error: float = 0.0) -> Relative:
    """Noise and model error together, and no less than a floor."""
    found = np.maximum(np.hypot(level, model_error), floor)
    return found if np.ndim(found) else float(found)


def explaining(data: WaveData, noise: Relative, ratio: float, floor: Relative = 0.0) -> Relative:
    """Noise that explains a misfit of so many times what this one leaves, as one more error that is the same at all points.

    √(σ² + e²) with the mean of (σ² + e²)/σ² over the points as the ratio; less than σ for a ratio below 1, but not than a floor.

    >>> grid = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 9, 2)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> explaining(data, 0.01, 4.0)
    0.02
    """
    more = np.square(noise) + (ratio - 1) / overall(data, 1 / noise) ** 2
    return total(np.sqrt(np.maximum(more, 0.0)), floor)


def median_strain_snr(data: WaveData, relative: Relative) -> float | None:
    """Median of the octahedral shear strain over its noise (`strain_snr`), all loads and points of the mask.

    The strain is that of a smooth field, its noise that of central differences over neighbours, as published values are.
    None where a component is not measured, or no smooth field can be laid through the data.
    """
    if not data.measured[:, data.mask].all() or overall(data, relative) <= 0:
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
    noise = gradient_noise(noise_of(data, relative, data.mask), spacing)
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


def noise_level(data: WaveData, given: float | None) -> tuple[Relative, str]:
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
