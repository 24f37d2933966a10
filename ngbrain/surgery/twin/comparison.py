"""Plans side by side: medians and intervals, differences of pairs, decisions, and what the variance comes from.

Many draws of the patient go through each plan's linearised measures. A few of them are whole runs: their logarithms less the
linearised ones are residuals, one for all plans and measures of a draw, which are added to the many by drawing them with
replacement. So the residual's mean corrects the many, its spread widens them, and what plans have in common stays in common. With
m whole runs residuals are spread by √((m + 1)/(m - 1)) about their mean, as a mean of few is uncertain itself.

The numerical error of a measure is a bound: it widens intervals at both ends, and a difference that it can turn round is open.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np

from ngbrain.inverse.uncertainty.interval import LEVEL, CredibleInterval
from ngbrain.surgery.twin.response import unit

Array = np.ndarray
Logs = Mapping[str, Mapping[str, Array]]
"""Plan → measure → logarithm in each draw."""
LINEAR = 1024
"""Number of linearised draws."""
DECIDED = 0.975
"""Share of the draws in which a plan has to be lower for a decision: the interval of 95 % is on one side."""
OPEN = "open"


@dataclass(frozen=True)
class Difference:
    """How one measure differs between two plans, over the draws that they share.

    Parameters
    ----------
    first, second : str
        Plans.
    measure : str
    unit : str
    median : float
        Of first minus second.
    interval_95 : tuple of float
        Of that, with the numerical bound.
    ratio_median : float
        Of first over second.
    ratio_interval_95 : tuple of float
        Of that, with the numerical bound.
    first_lower : int
        Number of draws in which the first one is lower,
    draws : int
        of so many.
    runs_first_lower : int
        The same among whole runs,
    runs : int
        of so many.
    numerical_factor : float
        By how much another mesh may move the ratio, as a factor; NaN where it is not computed.
    decision : str
        The plan that is lower, or "open".
    """

    first: str
    second: str
    measure: str
    unit: str
    median: float
    interval_95: tuple[float, float]
    ratio_median: float
    ratio_interval_95: tuple[float, float]
    first_lower: int
    draws: int
    runs_first_lower: int
    runs: int
    numerical_factor: float
    decision: str

    @property
    def in_words(self) -> str:
        """The decision as a sentence's end."""
        return "open" if self.decision == OPEN else f"{self.decision} lower"

    def to_dict(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self) | {"in_words": self.in_words}


def correct(linear: Logs, whole: Logs, at_whole: Logs, seed: int = 0) -> dict[str, dict[str, Array]]:
    """Linearised draws corrected by a few whole runs.

    Parameters
    ----------
    linear : mapping
        Logarithms of many linearised draws.
    whole : mapping
        Logarithms of few whole runs; may be empty arrays.
    at_whole : mapping
        The linearised ones of the same draws.
    seed : int

    Returns
    -------
    dict
        As `linear`.

    Examples
    --------
    >>> many = {"a": {"q": np.zeros(4)}}
    >>> few, same = {"a": {"q": np.array([0.3, 0.5])}}, {"a": {"q": np.array([0.1, 0.3])}}
    >>> correct(many, few, same)["a"]["q"].round(12).tolist()
    [0.2, 0.2, 0.2, 0.2]
    """
    count = len(next(iter(next(iter(whole.values())).values())))
    if count == 0:
        return {plan: dict(of) for plan, of in linear.items()}
    total = len(next(iter(next(iter(linear.values())).values())))
    which = np.random.default_rng(seed).integers(count, size=total)
    spread = math.sqrt((count + 1) / (count - 1)) if count > 1 else 0.0
    found: dict[str, dict[str, Array]] = {}
    for plan, measures in linear.items():
        found[plan] = {}
        for key, values in measures.items():
            residual = whole[plan][key] - at_whole[plan][key]
            mean = residual.mean()
            found[plan][key] = values + mean + spread * (residual - mean)[which]
    return found


def summarise(logs: Array, value: float, moved: float | None) -> dict[str, Any]:
    """Median and interval of a measure.

    Parameters
    ----------
    logs : (n,) array
        Its logarithm in each draw.
    value : float
        At the prior's centre.
    moved : float, optional
        How far another mesh moves the logarithm.

    Returns
    -------
    dict
        `median`, `interval_95` (with the numerical bound), `at_centre`, `numerical_factor`.

    Examples
    --------
    >>> [round(end, 6) for end in summarise(np.log(np.linspace(1.0, 3.0, 201)), 2.0, 0.0)["interval_95"]]
    [1.05, 2.95]
    """
    values = np.exp(logs)
    interval = CredibleInterval.from_samples(float(np.median(values)), values, LEVEL)
    slack = math.exp(abs(moved)) if moved is not None else 1.0
    return {
        "median": float(interval.value),
        "interval_95": [float(interval.low) / slack, float(interval.high) * slack],
        "at_centre": value,
        "numerical_factor": None if moved is None else slack,
    }


def compare(
    draws: Logs, whole: Logs, moved: Mapping[str, Mapping[str, float]], measures: Sequence[str]
) -> list[Difference]:
    """Differences of every pair of plans in every measure.

    Parameters
    ----------
    draws : mapping
        Logarithms, in draws that the plans share.
    whole : mapping
        Those of whole runs.
    moved : mapping
        Plan → measure → how far another mesh moves its logarithm; empty where it is not computed.
    measures : sequence of str

    Returns
    -------
    list of Difference

    Examples
    --------
    >>> one, other = np.linspace(0, 1, 100), np.linspace(0, 1, 100) + 0.1
    >>> none = {"a": {"mps_p95": np.empty(0)}, "b": {"mps_p95": np.empty(0)}}
    >>> (found,) = compare({"a": {"mps_p95": one}, "b": {"mps_p95": other}}, none, {}, ["mps_p95"])
    >>> found.first_lower, found.decision, round(found.ratio_median, 3)
    (100, 'a', 0.905)
    """
    return [
        _difference(first, second, measure, draws, whole, moved)
        for first, second in combinations(draws, 2)
        for measure in measures
    ]


def _difference(
    first: str, second: str, measure: str, draws: Logs, whole: Logs, moved: Mapping[str, Mapping[str, float]]
) -> Difference:
    logs = [draws[plan][measure] for plan in (first, second)]
    ratio = logs[0] - logs[1]
    apart = np.exp(logs[0]) - np.exp(logs[1])
    shifts = [moved[plan][measure] for plan in (first, second) if measure in moved.get(plan, {})]
    bound = abs(shifts[0] - shifts[1]) if len(shifts) == 2 else math.nan
    slack = 0.0 if math.isnan(bound) else bound
    low, high = np.quantile(ratio, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    ends = np.quantile(apart, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    room = slack * float(np.median(np.exp(logs[0])) + np.median(np.exp(logs[1]))) / 2
    lower = int(np.sum(ratio < 0))
    runs = whole[first][measure] - whole[second][measure]
    n = len(ratio)
    decision = OPEN
    if lower >= DECIDED * n and high + slack < 0:
        decision = first
    elif n - lower >= DECIDED * n and low - slack > 0:
        decision = second
    return Difference(
        first,
        second,
        measure,
        unit(measure),
        float(np.median(apart)),
        (float(ends[0] - room), float(ends[1] + room)),
        float(np.exp(np.median(ratio))),
        (float(np.exp(low - slack)), float(np.exp(high + slack))),
        lower,
        n,
        int(np.sum(runs < 0)),
        len(runs),
        math.exp(bound) if not math.isnan(bound) else math.nan,
        decision,
    )


def variance_shares(logs: Array, inputs: Array, sources: Sequence[str], rest: Array | None = None) -> dict[str, float]:
    """Share of the variance that each source of uncertainty has: what to measure next.

    Inputs are independent and the logarithm nearly linear in them, so that the squares of its correlations with them add up to
    nearly 1; these are added up over each source.

    Parameters
    ----------
    logs : (n,) array
        Logarithm of a measure, or of a ratio, in linearised draws.
    inputs : (n, k) array
        The draws.
    sources : sequence of str
        Source of each input.
    rest : (n,) array, optional
        What whole runs add to the logarithms.

    Returns
    -------
    dict of float
        Source → share, largest first.

    Examples
    --------
    >>> from ngbrain.surgery.twin.prior import Prior, Uncertain
    >>> inputs = Prior((Uncertain("a", "one", 0.0, 1.0), Uncertain("b", "two", 0.0, 1.0))).draws(512)
    >>> shares = variance_shares(inputs @ [2.0, 1.0], inputs, ["one", "two"])
    >>> {name: round(share, 2) for name, share in shares.items()}
    {'one': 0.8, 'two': 0.2}
    """
    off, scaled = logs - logs.mean(), inputs - inputs.mean(axis=0)
    varies = scaled.std(axis=0) > 0
    scaled = np.where(varies, scaled / np.where(varies, scaled.std(axis=0), 1.0), 0.0)
    slopes, *_ = np.linalg.lstsq(scaled, off, rcond=None)
    parts = dict[str, float]()
    for source, part in zip(sources, slopes**2, strict=True):
        parts[source] = parts.get(source, 0.0) + float(part)
    parts["beyond the linearisation"] = float(np.var(rest)) if rest is not None else 0.0
    total = sum(parts.values()) or 1.0
    return dict(sorted(((name, part / total) for name, part in parts.items() if part > 0), key=lambda each: -each[1]))
