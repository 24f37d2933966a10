"""Numbers that stand out from those of the other rows: a test that is blind to the outliers themselves.

Of the rows of a group, each number is measured from their median in units of the spread Qn (Rousseeuw and Croux 1993), which up to
half of the rows cannot spoil, and which wastes less of the others than the median absolute deviation (82 % efficient at normal
numbers, not 37 %). Numbers that are positive in every row are compared by their logarithms.

A number stands out beyond the quantile of Student's t with 0.82 (n - 1) degrees of freedom at which, were all rows normal draws,
5 % of all cohorts would have a single outlier in any row and number: the level is 5 % over how many are tested in all. At 12 rows
and 20 numbers that is 6 of these units, at 100 rows 4.5. Of fewer than 6 rows nothing can be said.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

LEVEL = 0.05
"""How many cohorts without an outlier are said to have one."""
LEAST_ROWS = 6
EFFICIENCY = 0.82
"""Of Qn at normal numbers."""
_NORMAL = 2.2219
_SMALL = {2: 0.399, 3: 0.994, 4: 0.512, 5: 0.844, 6: 0.611, 7: 0.857, 8: 0.669, 9: 0.872}
"""By how much Qn of so few is to be corrected (Croux and Rousseeuw 1992)."""


@dataclass(frozen=True)
class GroupStatistics:
    """How a number is spread over the rows of a group.

    Attributes
    ----------
    key, group : str
        The number's key; the group's name, "" where rows are not grouped.
    rows : tuple of str
        Those that have it.
    median, low, high : float
        And quartiles.
    least, most : float
        The smallest and the largest.
    unit_step : float
        Qn, of logarithms where `logarithmic`; 0 where no test is made.
    logarithmic : bool
    limit : float
        From how many such units on a row stands out.
    untested : str
        Why no test is made; "" where one is.
    """

    key: str
    group: str
    rows: tuple[str, ...]
    median: float
    low: float
    high: float
    least: float
    most: float
    unit_step: float = 0.0
    logarithmic: bool = False
    limit: float = 0.0
    untested: str = ""

    @property
    def n(self) -> int:
        """How many rows have it."""
        return len(self.rows)

    def deviation(self, value: float) -> float:
        """How many units a value is above the median."""
        if not self.unit_step:
            return 0.0
        if self.logarithmic:
            return float(np.log(value / self.median) / self.unit_step)
        return (value - self.median) / self.unit_step

    @property
    def bounds(self) -> tuple[float, float]:
        """Between which values no row stands out."""
        away = self.limit * self.unit_step
        if self.logarithmic:
            return self.median * float(np.exp(-away)), self.median * float(np.exp(away))
        return self.median - away, self.median + away


@dataclass(frozen=True)
class Outlier:
    """A number of a row that stands out: `deviation` units of its spread above the median, negative below."""

    row: str
    key: str
    value: float
    spread: GroupStatistics
    deviation: float


def find_outliers(
    numbers: Mapping[str, Mapping[str, float]], groups: Mapping[str, str], extremes: Collection[str] = ()
) -> tuple[list[GroupStatistics], list[Outlier]]:
    """The spread of every number in every group, and the rows that stand out.

    Parameters
    ----------
    numbers : mapping
        Row → number's key → value.
    groups : mapping
        Row → name of its group.
    extremes : collection of str
        Keys of numbers that are the smallest or largest of many, as a mesh's smallest angle is. These lie close together with a
        long tail on one side, so that no normal draw is like them: they are not tested.

    Returns
    -------
    spreads : list of Spread
    outliers : list of Outlier

    Examples
    --------
    >>> volumes = {name: {"volume": v} for name, v in zip("abcdefgh", (31, 29, 33, 30, 28, 32, 30, 95))}
    >>> spreads, outliers = find_outliers(volumes, dict.fromkeys(volumes, ""))
    >>> [(each.row, round(each.deviation, 1)) for each in outliers]
    [('h', 11.8)]
    """
    values = dict[tuple[str, str], dict[str, float]]()
    for row, of in numbers.items():
        for key, value in of.items():
            values.setdefault((key, groups[row]), {})[row] = value
    scales = {at: _scale(np.array(list(of.values())), at[0] in extremes) for at, of in values.items()}
    tests = sum(len(of) for at, of in values.items() if not scales[at][2])
    spreads, outliers = list[GroupStatistics](), list[Outlier]()
    for (key, group), of in values.items():
        found = np.array(list(of.values()))
        low, median, high = (float(each) for each in np.percentile(found, [25, 50, 75]))
        step, logarithmic, untested = scales[key, group]
        least, most = float(found.min()), float(found.max())
        limit = 0.0 if untested else float(stats.t.isf(LEVEL / tests / 2, EFFICIENCY * (len(of) - 1)))
        spread = GroupStatistics(
            key, group, tuple(of), median, low, high, least, most, step, logarithmic, limit, untested
        )
        spreads.append(spread)
        outliers += [
            Outlier(row, key, value, spread, away)
            for row, value in of.items()
            if not untested and abs(away := spread.deviation(value)) > limit
        ]
    return spreads, outliers


def qn(values: np.ndarray) -> float:
    """The spread Qn of at least two numbers: about the first quartile of what two of them differ by, a standard deviation of
    normal ones.

    >>> round(qn(np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 1000.0])), 2)
    3.81
    """
    n, half = len(values), len(values) // 2 + 1
    small = _SMALL.get(n) or (n / (n + 1.4) if n % 2 else n / (n + 3.8))
    i, j = np.triu_indices(n, 1)
    nth = half * (half - 1) // 2 - 1
    return small * _NORMAL * float(np.partition(np.abs(values[i] - values[j]), nth)[nth])


def _scale(values: np.ndarray, extreme: bool) -> tuple[float, bool, str]:
    """The unit of a number's spread, whether of logarithms, and why none is known."""
    if len(values) < LEAST_ROWS:
        return 0.0, False, f"{len(values)} row{'s' if len(values) > 1 else ''}: fewer than {LEAST_ROWS}"
    if extreme:
        return 0.0, False, "an extreme of many, which its verb judges"
    logarithmic = bool((values > 0).all())
    step = qn(np.log(values) if logarithmic else values)
    if step <= 1e-12 * max(1.0, float(np.abs(values).max())):
        return 0.0, False, "half of the rows have the same value"
    return step, logarithmic, ""
