"""Whether maps of an inversion can be used at all: reasons against them, from the misfit and from the numbers themselves.

An inversion always finds something: where the data are no waves of a body, noise is said to be as large as it takes. So that is
judged: how much of the waves is left over, beside the noise that was stated (or that a smooth fit leaves).
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
"""Part of the waves (rms) that is left over at most: a living brain's, one slice, leave .2."""
BEYOND, TOLERATED = 4.0, 0.06
"""How many times the stated noise may be left over, and the part of the waves that may be in any case: errors of elements."""
TORN = 0.01
"""Share of the displacements beside a jump: the seam through a grid of 100 points has 2 to 3 %, living brains have up to .4 %."""
OUT = 0.05
"""Share of the points that may have a modulus that no tissue has, or that the rest of the same tissue does not: rims, vessels.
Fluid is no tissue, and has no place in the mask."""


def reasons_against(
    data: WaveData,
    maps: Mapping[str, Array],
    stated: float,
    found: float,
    volume: float | None = None,
    torn: float = 0.0,
) -> list[str]:
    """Why maps are not to be used; empty where nothing speaks against them. Nothing at rest is judged by its moduli.

    stated   noise relative to the waves' rms, as it was given or as a smooth fit leaves it
    found    that the misfit of the maps says
    volume   |∇·u| over |∇×u| of the waves (`quality.OctahedralShearStrain`)
    torn     share of the displacements beside a jump, likewise
    """
    reasons, left = [], "of the displacements (rms) are not explained"
    if found > MOST:
        reasons.append(f"{100 * found:.0f} % {left}: they are no waves of such a body")
    elif found > max(TOLERATED, BEYOND * stated):
        reasons.append(
            f"{100 * found:.2g} % {left}: noise of {100 * stated:.2g} % and the error of elements would leave less"
        )
    if not data.frequency.any():
        return reasons
    if torn > TORN:
        what = "tissue moves without jumps: are parts of two scans together, or is a phase wrapped?"
        reasons.append(f"{100 * torn:.2g} % of the displacements lie beside a jump: {what}")
    shear = np.abs(shear_modulus_map(data, maps))
    reasons += modulus_reasons(shear[data.mask & np.isfinite(shear)], data.tissue)
    if volume is not None and volume > 1 and bulk_ratio(data) > LOCKING:
        change = f"the waves change volume {volume:.2g} times as much as they turn, and tissue that resists it has no such waves"
        reasons.append(f"{change}: are components swapped, or is one turned?")
    if data.lacks_imaginary(stated):
        reasons.append("imaginary parts are missing: no loss can be told from real parts; data without any are elastic")
    return reasons


def modulus_reasons(shear: Array, tissue: str | None) -> list[str]:
    """What speaks against the moduli |G*| (n,) Pa of a map's points: the median, or a share of them that is no tissue's.

    A median that is none of the tissue's may be an error of a unit, which the waves cannot tell (`believable.of_tissue` warns);
    points far from their own median are no unit's, but of a map that the data do not determine.

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
        reasons.append(f"{100 * beyond:.2g} % of the moduli are none of soft tissue, which has {range_}")
    most, what = modulus_range_factor(tissue), tissue or "tissue"
    if (far := float(np.mean((shear < median / most) | (shear > median * most)))) > OUT:
        off = f"more than {most:.2g} times off their median of {format_modulus(median)}"
        reasons.append(f"{100 * far:.2g} % of the moduli are {off}: no {what} varies like that")
    return reasons
