"""The result of a cohort: rows with verdicts, statistics, and both as a table and for result.json."""

from __future__ import annotations

import csv
import io
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ngbrain.errors import InputError
from ngbrain.look import BriefText
from ngbrain.result import Result, Status
from ngbrain.workflows.gate import LEAST_ROWS, LEVEL, GroupStatistics, Outlier
from ngbrain.workflows.rows import EXCLUDED, FAILED
from ngbrain.workflows.summary import Number

OK, WARNING = "ok", "warning"
VERDICTS = (OK, WARNING, EXCLUDED, FAILED)
ROWS, REPORT = "rows", "report.html"


@dataclass(frozen=True, repr=False)
class ResultRow(BriefText):
    """A scan or case, and its result.

    Attributes
    ----------
    name, verb : str
    verdict : str
        ok; warning, for an outlier or a warning of the verb; excluded, if the verb advises against its answer; failed.
    reason : str
        Why it is not ok; empty if it is.
    time_s : float or None
        Computing time of the verb; None if it failed.
    numbers : dict of Number
        The main numbers of its result by key; empty if it failed.
    group : str
        Its group in the statistics.
    about : dict of str
        The list's free columns.
    folder : Path
        With the verb's results and report.
    input : str
        File names.
    computed : bool
        In this call, not in an earlier one.
    """

    name: str
    verb: str
    verdict: str
    reason: str
    time_s: float | None
    numbers: dict[str, Number] = field(repr=False)
    group: str
    about: dict[str, str] = field(repr=False)
    folder: Path = field(repr=False)
    input: str = field(repr=False)
    computed: bool = field(repr=False)

    @property
    def usable(self) -> bool:
        """Whether its numbers count: the verdict is ok or warning."""
        return self.verdict in (OK, WARNING)

    @property
    def report(self) -> str:
        """Path of its report, relative to the cohort's folder; empty without one."""
        there = self.folder / REPORT
        return f"{ROWS}/{self.name}/{REPORT}" if self.numbers and there.exists() else ""


@dataclass(repr=False, eq=False)
class Cohort(Result):
    """The rows of a list with their verdicts, and the statistics of the usable ones.

    Attributes
    ----------
    rows : list of ResultRow
        In the order of the list.
    spreads : list of GroupStatistics
        For every number in every group.
    outliers : list of Outlier
    left_out : list of str
        Rows in the folder that are no longer in the list.
    folder : Path
    group : str
        The column of the groups; empty without groups.
    status : Status
        How it ended.
    """

    rows: list[ResultRow]
    spreads: list[GroupStatistics]
    outliers: list[Outlier]
    left_out: list[str]
    folder: Path
    group: str = ""
    status: Status = field(default=Status.CONVERGED, kw_only=True)

    @property
    def value(self) -> dict[str, int]:
        """Verdict → number of rows, without zeros."""
        return {verdict: count for verdict, count in self.counts.items() if count}

    @property
    def headline(self) -> str:
        """Number of rows by verdict, and the folder."""
        counts = ", ".join(f"{count} {verdict}" for verdict, count in self.value.items())
        return f"{counts}; {self.folder}"

    @property
    def statistics(self) -> dict[str, float]:
        """Number of rows, and of those computed in this call."""
        return {"rows": len(self.rows), "computed_now": sum(row.computed for row in self.rows)}

    @property
    def reasons(self) -> list[str]:
        """Rows whose numbers do not count."""
        unusable = [f"{row.name}: {row.verdict}: {row.reason}" for row in self.rows if not row.usable]
        return [*super().reasons, *unusable]

    def to_dict(self) -> dict[str, Any]:
        """As in `result.json`, without the data of the run."""
        return summarise(self)

    @property
    def counts(self) -> dict[str, int]:
        """Verdict → number of rows."""
        found = Counter(row.verdict for row in self.rows)
        return {verdict: found[verdict] for verdict in VERDICTS}

    def values(self, key: str) -> dict[str, float]:
        """Row → a number of the usable rows that have it; raises `InputError` for a key that no row has."""
        found = {row.name: row.numbers[key].value for row in self.rows if row.usable and key in row.numbers}
        if not found:
            known = sorted({each for row in self.rows for each in row.numbers})
            raise InputError("key", repr(key), f"one of {', '.join(known) or 'none: no row is usable'}")
        return found


def describe(outlier: Outlier, number: Number) -> str:
    """An outlier in words.

    Parameters
    ----------
    outlier : Outlier
    number : Number

    Returns
    -------
    str
    """
    spread = outlier.spread
    unit = f" {number.unit}" if number.unit else ""
    of = f"{number.name} of {number.region}" if number.region else number.name
    where = f"{abs(outlier.deviation):.1f} robust standard deviations {'above' if outlier.deviation > 0 else 'below'}"
    return f"{of} {outlier.value:.4g}{unit} is {where} the median {spread.median:.4g}{unit} (limit {spread.limit:.1f})"


def table(done: Cohort) -> str:
    """CSV table with a line for each row: verdict, reason, the list's free columns and the main numbers."""
    keys = list(dict.fromkeys(key for row in done.rows for key in row.numbers))
    own = list(dict.fromkeys(column for row in done.rows for column in row.about))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", "verb", "input", "verdict", "reason", "time_s", *own, *keys])
    for row in done.rows:
        seconds_ = "" if row.time_s is None else f"{row.time_s:.1f}"
        numbers = [repr(row.numbers[key].value) if key in row.numbers else "" for key in keys]
        others = [row.about.get(column, "") for column in own]
        writer.writerow([row.name, row.verb, row.input, row.verdict, row.reason, seconds_, *others, *numbers])
    return text.getvalue()


def _statistics_as_dict(spread: GroupStatistics, done: Cohort) -> dict[str, Any]:
    """Statistics as in result.json, with the standardised deviation of every row and of the quartiles."""
    values = {row.name: row.numbers[spread.key].value for row in done.rows if row.name in spread.rows}
    away = {name: spread.deviation(value) for name, value in values.items()}
    half = [spread.deviation(spread.low), spread.deviation(spread.high)]
    return asdict(spread) | {"n": spread.n, "bounds": list(spread.bounds), "deviations": away, "middle_half": half}


def summarise(done: Cohort) -> dict[str, Any]:
    """The cohort as in result.json, without the data of the run."""
    known = {key: number for row in done.rows for key, number in row.numbers.items()}
    numbers = {
        key: {"name": number.name, "unit": number.unit, "region": number.region} for key, number in known.items()
    }
    untested = sum(bool(spread.untested) for spread in done.spreads)
    warnings = [f"{row.name}: {row.verdict}: {row.reason}" for row in done.rows if row.verdict != OK]
    if done.left_out:
        warnings.append(f"no longer in the list, but still in the folder: {', '.join(done.left_out)}")
    return {
        "verb": "cohort",
        "checks": {
            **done.counts,
            "rows": len(done.rows),
            "computed_now": sum(row.computed for row in done.rows),
            "spreads_tested": len(done.spreads) - untested,
            "spreads_untested": untested,
            "outliers": len(done.outliers),
        },
        "rule": {"level": LEVEL, "least_rows": LEAST_ROWS},
        "warnings": warnings,
        "left_out": done.left_out,
        "group": done.group,
        "answers": {
            "rows": {
                row.name: {
                    "verb": row.verb,
                    "verdict": row.verdict,
                    "reason": row.reason,
                    "time_s": row.time_s,
                    "group": row.group,
                    "about": row.about,
                    "report": row.report,
                    "numbers": {key: number.value for key, number in row.numbers.items()},
                }
                for row in done.rows
            },
            "numbers": numbers,
            "spreads": [_statistics_as_dict(spread, done) for spread in done.spreads],
            "outliers": [
                {"row": each.row, "key": each.key, "value": each.value, "group": each.spread.group}
                | {"deviation": each.deviation, "limit": each.spread.limit}
                for each in done.outliers
            ],
        },
    }
