"""Whether waves can be those of soft tissue: the stiffness that their length and frequency mean, and the points along a wave."""

from __future__ import annotations

import numpy as np

from ngbrain.errors import InputError
from ngbrain.io.waves import WaveData

SOFTEST, STIFFEST = 1.0, 1e8
"""Shear moduli (Pa) that no soft tissue or phantom of it has: a frequency of kHz or mHz that was meant in Hz makes them 10⁶ times
what they are."""
SOFT, STIFF = 50.0, 1e6
"""The same, that few have."""
FEW = 4.0
"""Points along a wave, of which fewer tell little."""


def check_frequency(data: WaveData, shear: float) -> None:
    """Raise `InputError` about the frequency where waves mean a modulus (Pa) that is not between `SOFTEST` and `STIFFEST`."""
    if data.frequency.any() and not SOFTEST <= shear <= STIFFEST:
        wanted = f"Hz, 0 at rest: soft tissue has {_pascal(SOFTEST)} to {_pascal(STIFFEST)}"
        raise InputError("frequency", f"{data.frequency.max():g}, so that {_means(data, shear)}", wanted)


def of_frequency(data: WaveData, shear: float) -> list[str]:
    """What to say of waves in tissue of such a median |G| (Pa): that it is hardly tissue, or that points are too far apart."""
    if not data.frequency.any():
        return []
    means, notes = f"at {data.frequency.max():g} Hz {_means(data, shear)}", list[str]()
    if not SOFT <= shear <= STIFF:
        notes.append(f"{means}, which few tissues have: is the frequency in Hz, are the points in m?")
    if (along := _length(data, shear) / data.apart) < FEW:
        notes.append(f"{means}, and {along:.1f} distances between points: what is shorter cannot be told from it")
    return notes


def _means(data: WaveData, shear: float) -> str:
    return f"waves of {1e3 * _length(data, shear):.3g} mm mean a shear modulus of {_pascal(shear)}"


def _length(data: WaveData, shear: float) -> float:
    return float(np.sqrt(shear / data.density) / data.frequency.max())


def _pascal(value: float) -> str:
    for unit, size in (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.3g} Pa"
