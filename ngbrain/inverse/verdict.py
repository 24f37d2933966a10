"""Whether maps of an inversion can be used at all: reasons against them, from the misfit and from the numbers themselves.

An inversion always finds something: where the data are no waves of a body, noise is said to be as large as it takes. So that is
judged: how much of the waves is left over, beside the noise that was stated (or that a smooth fit leaves).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ngbrain.inverse.answers import median_shear
from ngbrain.inverse.believable import SOFT, STIFF, pascal
from ngbrain.io.waves import WaveData

Array = np.ndarray
MOST = 0.4
"""Part of the waves (rms) that is left over at most: a living brain's, one slice, leave .2."""
BEYOND, TOLERATED = 4.0, 0.06
"""How many times the stated noise may be left over, and the part of the waves that may be in any case: errors of elements."""


def reasons_against(data: WaveData, maps: Mapping[str, Array], stated: float, found: float) -> list[str]:
    """Why maps are not to be used; empty where nothing speaks against them. Nothing at rest is judged by its moduli.

    stated   noise relative to the waves' rms, as it was given or as a smooth fit leaves it
    found    that the misfit of the maps says
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
    shear = median_shear(data, dict(maps))
    if not SOFT <= shear <= STIFF:
        range_ = f"{pascal(SOFT)} to {pascal(STIFF)}"
        reasons.append(
            f"the median modulus is {pascal(shear)}, where soft tissue has {range_}: frequency in Hz? points in m?"
        )
    if data.lacks_imaginary(stated):
        reasons.append("imaginary parts are missing: no loss can be told from real parts; data without any are elastic")
    return reasons
