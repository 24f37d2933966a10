"""Whether maps of an inversion can be used at all: reasons against them, from the misfit and from the values.

An inversion always returns maps. Where the data are not waves of a body, the noise is estimated as large as necessary. So the
residual of the waves is judged against the stated noise (or the residual of a smooth fit).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ngbrain.inverse.data.plausibility import SOFT, STIFF, format_modulus, modulus_range_factor
from ngbrain.inverse.elastography.derived_maps import shear_modulus_map
from ngbrain.inverse.problem.discretisation import LOCKING, bulk_ratio
from ngbrain.io.waves import WaveData

Array = np.ndarray
MOST = 0.4
"""Largest relative residual of the waves (rms): one slice of a living brain leaves .2."""
BEYOND, TOLERATED = 4.0, 0.06
"""Largest ratio of the residual to the stated noise, and the relative residual that is accepted in any case: discretisation
errors."""
LARGEST_DISCONTINUITY = 0.01
"""Largest share of displacements beside a jump: the seam through a grid of 100 points has 2 to 3 %, living brains have up to
.4 %."""
PATCHES = "torn_displacements"
"""Check of an inversion: the share of displacements in patches that were torn off."""
OUT = 0.05
"""Largest share of points whose modulus no tissue has, or that differs too much from the rest of the tissue: rims, vessels.
Fluid is not tissue and does not belong in the mask."""


def reasons_against(
    data: WaveData,
    maps: Mapping[str, Array],
    stated: float,
    found: float,
    volume: float | None = None,
    discontinuity_share: float = 0.0,
    patches: float = 0.0,
) -> list[str]:
    """Return reasons against the use of maps; empty where there is none. Quasi-static maps are not judged by their moduli.

    Parameters
    ----------
    data : WaveData
        The data.
    maps : mapping of str to numpy.ndarray
        Parameter → (n,)
    stated : float
        Noise relative to the rms of the waves, as given, or the residual of a smooth fit.
    found : float
        The same from the misfit of the maps.
    volume : float, optional
        |∇·u| over |∇×u| of the waves (`quality.OctahedralShearStrain`).
    discontinuity_share : float
        Share of displacements beside a jump, likewise.
    patches : float
        Share of displacements in patches that a jump tears off the rest (`outliers.torn_displacements`), which were left out.

    Returns
    -------
    list of str
        The reasons.
    """
    reasons, left = [], "of the displacements (rms) are not explained"
    if found > MOST:
        reasons.append(f"{100 * found:.0f} % {left}: these are not waves of such a body")
    elif found > max(TOLERATED, BEYOND * stated):
        reasons.append(
            f"{100 * found:.2g} % {left}: noise of {100 * stated:.2g} % and the error of elements would leave less"
        )
    if not data.frequency.any():
        return reasons
    if discontinuity_share > LARGEST_DISCONTINUITY:
        what = "tissue moves without jumps: are two scans joined, or is a phase wrapped?"
        reasons.append(f"{100 * discontinuity_share:.2g} % of the displacements lie beside a jump: {what}")
    if patches > LARGEST_DISCONTINUITY:
        what = "is a phase wrapped there? The maps are those of the rest"
        reasons.append(
            f"{100 * patches:.2g} % of the displacements are in patches that a jump tears off the rest: {what}"
        )
    shear = np.abs(shear_modulus_map(data, maps))
    reasons += modulus_reasons(shear[data.mask & np.isfinite(shear)], data.tissue)
    if volume is not None and volume > 1 and bulk_ratio(data) > LOCKING:
        change = (
            f"|div u| of the waves is {volume:.2g} times |curl u|, which nearly incompressible tissue does not allow"
        )
        reasons.append(f"{change}: are components swapped, or is one turned?")
    if data.lacks_imaginary(stated):
        reasons.append(
            "imaginary parts are missing: real parts alone do not determine the loss; data without any are elastic"
        )
    return reasons


def torn_patches(share: float) -> dict[str, float | bool]:
    """Return the check `PATCHES` of a share of torn-off displacements; none where there is none."""
    return {PATCHES: share} if share else {}


def modulus_reasons(shear: Array, tissue: str | None) -> list[str]:
    """Return reasons against the moduli of a map's points.

    These are a median, or a share of points, outside the range of soft tissue. A median outside the range of the named tissue
    may be an error of a unit, which the waves cannot show (`plausibility.tissue_notes` warns). Points far from their own
    median are not explained by a unit: the data do not determine such a map.

    Parameters
    ----------
    shear : numpy.ndarray
        (n,) |G*|, Pa.
    tissue : str or None
        Name of the tissue.

    Returns
    -------
    list of str
        The reasons.

    Examples
    --------
    >>> modulus_reasons(np.geomspace(1e3, 4e3, 100), "brain")
    []
    >>> modulus_reasons(np.geomspace(1e2, 1e5, 100), "brain")
    ['52 % of the moduli are more than 5.2 times off their median of 3.16 kPa: no brain varies like that']
    """
    if not shear.size:
        return []
    median, range_ = float(np.median(shear)), f"{format_modulus(SOFT)} to {format_modulus(STIFF)}"
    if not SOFT <= median <= STIFF:
        found = f"the median modulus is {format_modulus(median)}, where soft tissue has {range_}"
        return [f"{found}: frequency in Hz? points in m?"]
    reasons = []
    if (beyond := float(np.mean((shear < SOFT) | (shear > STIFF)))) > OUT:
        reasons.append(f"{100 * beyond:.2g} % of the moduli are outside the range of soft tissue, {range_}")
    most, what = modulus_range_factor(tissue), tissue or "tissue"
    if (far := float(np.mean((shear < median / most) | (shear > median * most)))) > OUT:
        off = f"more than {most:.2g} times off their median of {format_modulus(median)}"
        reasons.append(f"{100 * far:.2g} % of the moduli are {off}: no {what} varies like that")
    return reasons
