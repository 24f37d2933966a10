"""Outlier detection over the rows of a cohort, robust to the outliers themselves.

For the rows of a group, the deviation of a number from the median is measured in units of the scale estimator Qn (Rousseeuw and
Croux 1993). It has a breakdown point of half of the rows and a higher efficiency than the median absolute deviation (82 % for
normal numbers, not 37 %). Numbers that are positive in every row are compared by their logarithms.

A number is an outlier beyond a quantile of Student's t with 0.82 (n - 1) degrees of freedom, chosen such that 5 % of all cohorts of
normal numbers would have a single outlier in any row and number: the level is 5 % over the number of tests. With 12 rows and 20
numbers that is 6 units, with 100 rows 4.5. Groups of fewer than 6 rows are not tested.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import scipy

LEVEL = 0.05
"""Fraction of cohorts without outliers in which one is reported."""
LEAST_ROWS = 6
EFFICIENCY = 0.82
"""Efficiency of Qn for normal numbers."""
_NORMAL = 2.2219
_SMALL = {2: 0.399, 3: 0.994, 4: 0.512, 5: 0.844, 6: 0.611, 7: 0.857, 8: 0.669, 9: 0.872}
"""Small-sample correction of Qn (Croux and Rousseeuw 1992)."""


@dataclass(frozen=True)
class GroupStatistics:
    """Statistics of a number over the rows of a group.

    Attributes
    ----------
    key, group : str
        The number's key; the group's name, empty without groups.
    rows : tuple of str
        Rows that have the number.
    median, low, high : float
        Median and quartiles.
    least, most : float
        Minimum and maximum.
    unit_step : float
        Qn, of logarithms if `logarithmic`; 0 without a test.
    logarithmic : bool
    limit : float
        Standardised deviation above which a row is an outlier.
    untested : str
        Why there is no test; empty if there is one.
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
        """Number of rows."""
        return len(self.rows)

    def deviation(self, value: float) -> float:
        """Standardised deviation of a value from the median."""
        if not self.unit_step:
            return 0.0
        if self.logarithmic:
            return float(np.log(value / self.median) / self.unit_step)
        return (value - self.median) / self.unit_step

    @property
    def bounds(self) -> tuple[float, float]:
        """Limits between which no row is an outlier."""
        away = self.limit * self.unit_step
        if self.logarithmic:
            return self.median * float(np.exp(-away)), self.median * float(np.exp(away))
        return self.median - away, self.median + away


@dataclass(frozen=True)
class Outlier:
    """A number of a row that is an outlier.

    Attributes
    ----------
    row, key : str
        Row and number.
    value : float
    spread : GroupStatistics
    deviation : float
        Standardised deviation from the median, negative below it.
    """

    row: str
    key: str
    value: float
    spread: GroupStatistics
    deviation: float


def find_outliers(
    numbers: Mapping[str, Mapping[str, float]], groups: Mapping[str, str], extremes: Collection[str] = ()
) -> tuple[list[GroupStatistics], list[Outlier]]:
    """Statistics of every number in every group, and the outliers.

    Parameters
    ----------
    numbers : mapping
        Row → number's key → value.
    groups : mapping of str
        Row → its group.
    extremes : collection of str
        Keys of numbers that are the smallest or largest of many, such as a mesh's smallest angle. Their distribution is skewed, not
        normal: they are not tested.

    Returns
    -------
    spreads : list of GroupStatistics
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
        limit = 0.0 if untested else float(scipy.stats.t.isf(LEVEL / tests / 2, EFFICIENCY * (len(of) - 1)))
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
    """Scale estimator Qn of at least two numbers: about the first quartile of pairwise differences, scaled to a standard deviation.

    Examples
    --------
    >>> round(qn(np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 1000.0])), 2)
    3.81
    """
    n, half = len(values), len(values) // 2 + 1
    small = _SMALL.get(n) or (n / (n + 1.4) if n % 2 else n / (n + 3.8))
    i, j = np.triu_indices(n, 1)
    nth = half * (half - 1) // 2 - 1
    return small * _NORMAL * float(np.partition(np.abs(values[i] - values[j]), nth)[nth])


def _scale(values: np.ndarray, extreme: bool) -> tuple[float, bool, str]:
    """Scale of a number, whether of logarithms, and why there is none."""
    if len(values) < LEAST_ROWS:
        return 0.0, False, f"{len(values)} row{'s' if len(values) > 1 else ''}: fewer than {LEAST_ROWS}"
    if extreme:
        return 0.0, False, "an extreme of many, which its verb judges"
    logarithmic = bool((values > 0).all())
    step = qn(np.log(values) if logarithmic else values)
    if step <= 1e-12 * max(1.0, float(np.abs(values).max())):
        return 0.0, False, "half of the rows have the same value"
    return step, logarithmic, ""
