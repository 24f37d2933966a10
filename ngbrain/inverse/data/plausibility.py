"""Whether wavelength and frequency are those of soft tissue, and whether there are enough points for a wave."""

from __future__ import annotations

import numpy as np

from ngbrain.errors import InputError
from ngbrain.io.waves import WaveData

SOFTEST, STIFFEST = 1.0, 1e8
"""Shear moduli (Pa) outside the range of soft tissue and its phantoms. A frequency in kHz or mHz in place of Hz changes them
by a factor of 10⁶."""
SOFT, STIFF = 50.0, 1e6
"""Shear moduli (Pa) outside the range of most soft tissue."""
TISSUES: dict[str, tuple[float, float]] = {
    "brain": (300.0, 8e3),
    "liver": (600.0, 2e4),
    "breast": (300.0, 6e4),
    "muscle": (800.0, 1e5),
    "phantom": (200.0, 1e5),
}
"""Range of medians of |G*| (Pa) at 20 to 200 Hz, healthy or not, with a margin on either side."""
FEW = 4.0
"""Points for each wavelength below which waves determine little."""


def check_frequency(data: WaveData, shear: float) -> None:
    """Raise `InputError` about the frequency where waves imply a modulus that is not between `SOFTEST` and `STIFFEST`.

    Parameters
    ----------
    data : WaveData
        The data.
    shear : float
        Shear modulus, Pa.

    Raises
    ------
    InputError
        Wavelength and frequency imply a modulus that no soft tissue has.
    """
    if data.frequency.any() and not SOFTEST <= shear <= STIFFEST:
        wanted = f"Hz, 0 at rest: soft tissue has {format_modulus(SOFTEST)} to {format_modulus(STIFFEST)}"
        raise InputError("frequency", f"{data.frequency.max():g}, so that {_implied_modulus(data, shear)}", wanted)


def wavelength_notes(data: WaveData, shear: float) -> list[str]:
    """Return warnings on the wavelength: a modulus of hardly any tissue, or points too far apart.

    Parameters
    ----------
    data : WaveData
        The data.
    shear : float
        Median of |G|, Pa.

    Returns
    -------
    list of str
        The warnings.
    """
    if not data.frequency.any():
        return []
    means, notes = f"at {data.frequency.max():g} Hz {_implied_modulus(data, shear)}", list[str]()
    if not SOFT <= shear <= STIFF:
        notes.append(f"{means}, which few tissues have: is the frequency in Hz, are the points in m?")
    if (along := _wavelength(data, shear) / data.point_spacing) < FEW:
        notes.append(
            f"{means}, and {along:.1f} distances between points: shorter waves cannot be distinguished from it"
        )
    return notes


def tissue_notes(data: WaveData, shear: float) -> list[str]:
    """Return a warning where the modulus is out of the range of the named tissue.

    Parameters
    ----------
    data : WaveData
        Data that may name a tissue.
    shear : float
        Median of |G|, Pa.

    Returns
    -------
    list of str
        The warning, or nothing.
    """
    if data.tissue is None or not data.frequency.any():
        return []
    low, high = TISSUES[data.tissue]
    if low <= shear <= high:
        return []
    times = shear / high if shear > high else low / shear
    beyond = "above" if shear > high else "below"
    usual = f"what {data.tissue} has ({format_modulus(low)} to {format_modulus(high)})"
    asked = "is the frequency in Hz, not rad/s, are points in m, is the pixel size right?"
    return [f"the median modulus of {format_modulus(shear)} is {times:.3g} times {beyond} {usual}: {asked}"]


def modulus_range_factor(tissue: str | None) -> float:
    """Return the largest ratio of a point's modulus to the median of its tissue: √(high/low) of `TISSUES`.

    Without a name it is that of the widest range.

    Examples
    --------
    >>> round(modulus_range_factor("brain"), 1), round(modulus_range_factor(None), 1)
    (5.2, 22.4)
    """
    ranges = TISSUES.values() if tissue is None else [TISSUES[tissue]]
    return float(np.sqrt(max(high / low for low, high in ranges)))


def amplitude_notes(data: WaveData) -> list[str]:
    """Return a warning where displacements are larger than the region. The theory is linear, so that moduli do not change with
    their unit.
    """
    across, most = float(np.ptp(data.points, axis=0).max()), float(np.nanmax(np.abs(data.displacement[:, data.mask])))
    if most <= across:
        return []
    return [
        f"displacements reach {most:.3g} m in a region of {across:.3g} m: are they in m? Moduli do not change with their unit"
    ]


def _implied_modulus(data: WaveData, shear: float) -> str:
    return f"waves of {1e3 * _wavelength(data, shear):.3g} mm mean a shear modulus of {format_modulus(shear)}"


def _wavelength(data: WaveData, shear: float) -> float:
    return float(np.sqrt(shear / data.density) / data.frequency.max())


def format_modulus(value: float) -> str:
    """Return a modulus in words, in Pa, kPa, MPa or GPa."""
    for unit, size in (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.3g} Pa"
