"""Infarct probability under a retractor: published animal counts and the interval that they imply."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import scipy

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.units import MINUTE

CONFIDENCE = 0.95
HELD_MINUTES = 15.0
"""Duration of retraction in each animal (minutes)."""
MISSING = 0.05
"""Fraction of that duration that a sustained pressure may miss, for the loading ramp."""
HALVINGS = 40
"""Bisection steps in the search for a sustained pressure."""
COUNTS = {20.0: (1, 6), 30.0: (5, 6), 40.0: (6, 6)}
"""Retraction pressure (mmHg) → rats with an infarct, out of how many: Rosenorn & Diemer 1985, 10.3171/jns.1985.63.4.0608."""
SOURCE = "Rosenørn & Diemer 1985, 10.3171/jns.1985.63.4.0608"
CONDITIONS = f"rats, a constant pressure for {HELD_MINUTES:.0f} minutes, 6 animals at each"


def interval(infarcts: int, animals: int) -> tuple[float, float]:
    """Exact (Clopper-Pearson) 95 % confidence interval of a probability.

    Parameters
    ----------
    infarcts, animals : int
        Animals with an infarct, and all animals.

    Returns
    -------
    tuple of float

    References
    ----------
    Clopper & Pearson 1934, 10.1093/biomet/26.4.404.

    Examples
    --------
    >>> [round(p, 4) for p in interval(6, 6)]
    [0.5407, 1.0]
    """
    found = scipy.stats.binomtest(infarcts, animals).proportion_ci(CONFIDENCE, method="exact")
    return float(found.low), float(found.high)


def probability_lower_bound(mmHg: float) -> float:  # noqa: N803
    """Lower bound for a pressure (mmHg) sustained for 15 minutes: that of the largest dose not above it, 0 below all doses."""
    return max((interval(*counts)[0] for dose, counts in COUNTS.items() if dose <= mmHg), default=0.0)


def probability_upper_bound(mmHg: float) -> float:  # noqa: N803
    """Upper bound for a pressure (mmHg) sustained for 15 minutes: that of the smallest dose not below it, 1 above all; 0 without
    pressure.
    """
    if mmHg <= 0:
        return 0.0
    return min((interval(*counts)[1] for dose, counts in COUNTS.items() if dose >= mmHg), default=1.0)


def sustained_pressure(pressure: TimeCurve, seconds: float) -> float:
    """The largest pressure that a curve exceeds for a given time without interruption.

    Parameters
    ----------
    pressure : TimeCurve
        Pressure over time (s).
    seconds : float
        Duration (s).

    Returns
    -------
    float
        0 if the tissue is never loaded that long.

    Examples
    --------
    >>> round(sustained_pressure(TimeCurve([0.0, 10.0, 20.0], [0.0, 40.0, 0.0], [0.0, 10.0, 20.0]), 5.0), 6)
    30.0
    """

    low, high = 0.0, pressure.peak
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        longest = pressure.above(middle)[1]
        low, high = (middle, high) if longest >= seconds * (1 - 1e-9) else (low, middle)
    return low


def infarct_probability(pressure: TimeCurve) -> dict[str, Any]:
    """The interval of infarct probabilities that the counts imply for a pressure curve (mmHg).

    The only assumption: a lower pressure, a shorter time or interruptions do no more harm. So the probability is at least that of
    the pressure sustained for 15 minutes (less 5 %) without interruption. It is at most that of 15 minutes at the peak, if the
    tissue is loaded for no longer in total; otherwise there is no upper bound. Each end is a 97.5 % bound, so that the interval
    has at least 95 % coverage; the difference between rat and patient is not included. `_at_held` is the interval of 15 minutes at
    the sustained pressure alone, None where no pressure is sustained for so long.
    """
    minutes = pressure.above(0.0)[0] / MINUTE
    even = sustained_pressure(pressure, (1 - MISSING) * HELD_MINUTES * MINUTE)
    peak = pressure.peak
    high = probability_upper_bound(peak) if minutes <= HELD_MINUTES else 1.0
    return {
        "pressure_held_15_min_mmHg": even,
        "pressed_min": minutes,
        "infarct_probability_95_at_held": [probability_lower_bound(even), probability_upper_bound(even)]
        if even
        else None,
        "infarct_probability_95": [probability_lower_bound(even), high],
    }


def excludes_one_half(interval: Sequence[float]) -> bool:
    """Whether an interval of a probability (low, high) excludes one half; only such an interval is reported.

    With six animals at a pressure most intervals contain one half. They add nothing to prior knowledge, and their ends ("0 to 64
    %") read like a finding: the counts themselves (`evidence`) are reported instead.

    Examples
    --------
    >>> [excludes_one_half(interval(*counts)) for counts in COUNTS.values()]
    [False, False, True]
    """
    low, high = interval
    return not low <= 0.5 <= high


def evidence(even: float, peak: float, minutes: float) -> str:
    """What the animal counts imply for a pressure curve, in words.

    Parameters
    ----------
    even : float
        Pressure (mmHg) sustained for 15 minutes without interruption, see `infarct_probability`.
    peak : float
        Largest pressure (mmHg).
    minutes : float
        Total loading time.

    Returns
    -------
    str

    Examples
    --------
    >>> evidence(21.5, 28.0, 15.0)
    'at least as harmful as 20 mmHg (1 of 6 rats), at most as harmful as 30 mmHg (5 of 6 rats)'
    >>> evidence(0.0, 146.0, 60.0)
    'no bound: not sustained at 20 mmHg or more for 15 minutes, but loaded longer or more strongly than any rat'
    """
    if peak <= 0:
        return "no pressure"
    below = max((dose for dose in COUNTS if dose <= even), default=None)
    above = min((dose for dose in COUNTS if dose >= peak), default=None) if minutes <= HELD_MINUTES else None
    bounds = [("at least", below), ("at most", above)]
    said = [f"{word} as harmful as {dose:g} mmHg ({_counted(dose)})" for word, dose in bounds if dose is not None]
    least = f"not sustained at {min(COUNTS):g} mmHg or more for {HELD_MINUTES:g} minutes"
    return ", ".join(said) or f"no bound: {least}, but loaded longer or more strongly than any rat"


def _counted(dose: float) -> str:
    infarcts, animals = COUNTS[dose]
    return f"{infarcts} of {animals} rats"


def dose_response_points() -> dict[str, Any]:
    """The counts with their intervals, source and conditions."""
    doses = [
        {"pressure_mmHg": dose, "infarcts": counts[0], "animals": counts[1], "probability_95": list(interval(*counts))}
        for dose, counts in COUNTS.items()
    ]
    return {"source": SOURCE, "conditions": CONDITIONS, "points": doses}
