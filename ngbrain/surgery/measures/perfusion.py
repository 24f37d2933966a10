"""The perfusion reserve under a blade for a patient's arterial and intracranial pressure."""

from __future__ import annotations

from typing import Any

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.scene import Patient

LOW_MMHG = 10.0
"""Local perfusion pressure MAP - BRP below which, for more than 6 to 8 minutes, 5 of 6 patients had infarcts: Rosenorn 1987,
10.1007/BF01402364.
"""


def perfusion(patient: Patient, pressure: TimeCurve) -> dict[str, Any]:
    """Times with MAP - BRP below 10 mmHg, and the smallest perfusion reserve.

    The reserve is MAP - max(BRP, ICP), with the mean arterial pressure MAP and the intracranial pressure ICP of the patient (0 if
    it is not given) and the brain retraction pressure BRP in mmHg.

    Parameters
    ----------
    patient : Patient
    pressure : TimeCurve
        Retraction pressure (mmHg) over time (s).

    Returns
    -------
    dict
        Total and longest uninterrupted time (s), smallest reserve (mmHg); empty without a MAP.

    Examples
    --------
    >>> pressed = TimeCurve([0.0, 10.0, 20.0], [0.0, 40.0, 0.0], [0.0, 10.0, 20.0])
    >>> perfusion(Patient(mean_arterial_pressure=30.0, intracranial_pressure=12.0), pressed)["min_perfusion_reserve_mmHg"]
    -10.0
    """
    if patient.mean_arterial_pressure is None:
        return {}
    total, longest = pressure.above(patient.mean_arterial_pressure - LOW_MMHG)
    highest = max(pressure.peak, patient.intracranial_pressure or 0.0)
    return {
        f"s_perfusion_below_{LOW_MMHG:.0f}_mmHg": total,
        f"longest_s_perfusion_below_{LOW_MMHG:.0f}_mmHg": longest,
        "min_perfusion_reserve_mmHg": patient.mean_arterial_pressure - highest,
    }
