"""What has come of a cohort: its rows with their verdicts, their statistics, and both as a table and for result.json."""

from __future__ import annotations

import csv
import io
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ngbrain.errors import InputError
from ngbrain.result import Result, Status
from ngbrain.workflows.gate import LEAST_ROWS, LEVEL, GroupStatistics, Outlier
from ngbrain.workflows.rows import EXCLUDED, FAILED
from ngbrain.workflows.summary import Number

OK, WARNING = "ok", "warning"
VERDICTS = (OK, WARNING, EXCLUDED, FAILED)
ROWS, REPORT = "rows", "report.html"


@dataclass(frozen=True)
class ResultRow:
    """A scan or case, and what has come of it.

    Attributes
    ----------
    name, verb : str
    verdict : str
        ok; warning, where a number stands out or the verb warns; excluded, where the verb does not want its answer used; failed.
    reason : str
        Why it is not ok, in a line; "" where it is.
    time_s : float or None
        That the verb took; None where it failed.
    numbers : dict of Number
        The main numbers of its result by key; none where it failed.
    group : str
        What its statistics are parted by.
    about : dict of str
        The list's other columns.
    folder : Path
        With the verb's own results and report.
    input : str
        The files, as in the list's folder.
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
        """Whether its numbers count: it is ok, or merely worth a look."""
        return self.verdict in (OK, WARNING)

    @property
    def report(self) -> str:
        """Its verb's report, relative to the cohort's folder; "" where there is none."""
        there = self.folder / REPORT
        return f"{ROWS}/{self.name}/{REPORT}" if self.numbers and there.exists() else ""


@dataclass(repr=False, eq=False)
class Cohort(Result):
    """The rows of a list with their verdicts, and the statistics of those that are usable.

    Attributes
    ----------
    rows : list of Row
        In the order of the list.
    spreads : list of Spread
        Of every number in every group.
    outliers : list of Outlier
    left_out : list of str
        Rows that are in the folder but no longer in the list.
    folder : Path
    group : str
        The column that groups are of; "" where there are none.
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
        """Verdict → rows, of those that there are."""
        return {verdict: count for verdict, count in self.counts.items() if count}

    @property
    def headline(self) -> str:
        """Rows of each verdict, and where they are."""
        counts = ", ".join(f"{count} {verdict}" for verdict, count in self.value.items())
        return f"{counts}; {self.folder}"

    @property
    def statistics(self) -> dict[str, float]:
        """Rows, and those that were computed in this call."""
        return {"rows": len(self.rows), "computed_now": sum(row.computed for row in self.rows)}

    @property
    def reasons(self) -> list[str]:
        """Rows whose numbers do not count."""
        unusable = [f"{row.name}: {row.verdict}: {row.reason}" for row in self.rows if not row.usable]
        return [*super().reasons, *unusable]

    def to_dict(self) -> dict[str, Any]:
        """As `result.json` has it, but for the run itself."""
        return summarise(self)

    @property
    def counts(self) -> dict[str, int]:
        """How many rows have which verdict."""
        found = Counter(row.verdict for row in self.rows)
        return {verdict: found[verdict] for verdict in VERDICTS}

    def values(self, key: str) -> dict[str, float]:
        """A number of the usable rows that have it, by row.

        Raises `InputError` for a key that no row has.
        """
        found = {row.name: row.numbers[key].value for row in self.rows if row.usable and key in row.numbers}
        if not found:
            known = sorted({each for row in self.rows for each in row.numbers})
            raise InputError("key", repr(key), f"one of {', '.join(known) or 'none: no row is usable'}")
        return found


def describe(outlier: Outlier, number: Number) -> str:
    """In words: which number stands out, and by how much."""
    spread = outlier.spread
    unit = f" {number.unit}" if number.unit else ""
    of = f"{number.name} of {number.region}" if number.region else number.name
    where = f"{abs(outlier.deviation):.1f} robust standard deviations {'above' if outlier.deviation > 0 else 'below'}"
    return f"{of} {outlier.value:.4g}{unit} is {where} the median {spread.median:.4g}{unit} (limit {spread.limit:.1f})"


def table(done: Cohort) -> str:
    """A line for each row: verdict, reason, the list's own columns and the main numbers (CSV)."""
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


def _described(spread: GroupStatistics, done: Cohort) -> dict[str, Any]:
    """A spread as result.json has it, with how many units every row, and the middle half of the rows, is from the median."""
    values = {row.name: row.numbers[spread.key].value for row in done.rows if row.name in spread.rows}
    away = {name: spread.deviation(value) for name, value in values.items()}
    half = [spread.deviation(spread.low), spread.deviation(spread.high)]
    return asdict(spread) | {"n": spread.n, "bounds": list(spread.bounds), "deviations": away, "middle_half": half}


def summarise(done: Cohort) -> dict[str, Any]:
    """The cohort as result.json has it, but for the run itself."""
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
            "spreads": [_described(spread, done) for spread in done.spreads],
            "outliers": [
                {"row": each.row, "key": each.key, "value": each.value, "group": each.spread.group}
                | {"deviation": each.deviation, "limit": each.spread.limit}
                for each in done.outliers
            ],
        },
    }
