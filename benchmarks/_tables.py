"""Tables and sentences that pages of results are made of, from the records of benchmarks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

OURS = "ngbrain"
MISSING = "–"
ROUNDING = 1e-12
"""Shares up to which nothing but rounding is left."""
HUNDRED = 100
"""From which on a number has three digits at least."""
SAME = (0.95, 1.05)
"""Ratios of costs between which they are about the same."""
Record = dict[str, Any]


def table(titles: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table of Markdown."""
    lines = ["| " + " | ".join(titles) + " |"]
    lines.append("|" + "---|" * (lines[0].count("|") - 1))
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def listing(found: Iterable[Record], columns: Mapping[str, tuple[str, Callable[[Any], str]]]) -> str:
    """A row for each record: title → the path of a value in it, parts joined by dots, and how it is shown."""
    rows = []
    for record in found:
        cells = []
        for path, show in columns.values():
            value: Any = record
            for part in path.split("."):
                value = value.get(part) if isinstance(value, dict) else None
            cells.append(show(value) if value is not None else "" if path == "reason" else MISSING)
        rows.append(cells)
    return table(columns, rows)


def bullets(lines: Iterable[str]) -> str:
    """A list of Markdown."""
    return "\n".join(f"- {line}" for line in lines)


def number(value: float | None, digits: int = 2) -> str:
    """A number in so many significant digits, thousands apart; what is missing as a dash."""
    if value is None:
        return MISSING
    if value == 0:
        return "0"
    text = f"{value:.{max(digits, 3) if abs(value) >= HUNDRED else digits}g}"
    if "e" in text:
        mantissa, _, power = text.partition("e")
        text = f"{float(text):.0f}" if 0 <= int(power) < 15 else f"{mantissa}e{int(power)}"
    whole, dot, rest = text.partition(".")
    sign, whole = ("-", whole[1:]) if whole.startswith("-") else ("", whole)
    return sign + _thousands(whole) + dot + rest


def count(value: float | None) -> str:
    """A whole number, thousands apart."""
    return MISSING if value is None else _thousands(f"{value:.0f}")


def percent(value: float | None, digits: int = 2) -> str:
    """A share as a percentage."""
    return MISSING if value is None else f"{number(100 * value if abs(value) > ROUNDING else 0, digits)} %"


def seconds(value: float | None, digits: int = 2) -> str:
    """A time in seconds."""
    return MISSING if value is None else f"{number(value, digits)} s"


def spread(values: Iterable[float], show: Callable[[float], str] = number) -> str:
    """The least and the largest of values, or the one that there is."""
    low, high = min(found := list(values)), max(found)
    texts = list(dict.fromkeys((show(low), show(high))))
    return f"{texts[0].removesuffix(' %') if texts[0].endswith(' %') and len(texts) > 1 else texts[0]}" + "".join(
        f" to {text}" for text in texts[1:]
    )


def ours(record: Record) -> bool:
    """Whether a record is of this library."""
    return str(record["method"]).startswith(OURS)


def name(method: str) -> str:
    """A method as pages call it."""
    return method.replace(f"{OURS}:", f"{OURS} ", 1)


def cheapest(records: Iterable[Record], error: float, cost: str = "cpu_s", stays: bool = True) -> Record | None:
    """The record of least cost whose error is no larger.

    stays    whether it counts only where no dearer record of the same method and order has a larger error; else chance may count
    """
    good: list[Record] = []
    done = [r for r in records if r["converged"] and r["error"] is not None and r.get(cost)]
    for method in dict.fromkeys((r["method"], r.get("order")) for r in done):
        for record in sorted((r for r in done if (r["method"], r.get("order")) == method), key=lambda r: -r[cost]):
            if record["error"] <= error:
                good.append(record)
            elif stays:
                break
    return min(good, key=lambda r: r[cost], default=None)


def reach(records: Sequence[Record], errors: Sequence[float], cost: str = "cpu_s", stays: bool = True) -> str:
    """What each method costs until its error is as small as asked, ours first; and the smallest error that it has."""
    methods = sorted(dict.fromkeys(r["method"] for r in records), key=lambda m: not m.startswith(OURS))
    rows = []
    for method in methods:
        of = [r for r in records if r["method"] == method]
        best = min((r["error"] for r in of if r["converged"] and r["error"] is not None), default=None)
        if best is not None:
            costs = [cheapest(of, error, cost, stays) for error in errors]
            rows.append([name(method), *(seconds(r[cost]) if r else MISSING for r in costs), percent(best)])
    return table(["method", *(f"to {percent(error)}" for error in errors), "best error"], rows)


@dataclass
class Race:
    """The cheapest of ours and of the others for one error."""

    error: float
    ours: Record | None
    other: Record | None
    cost: str

    @property
    def ratio(self) -> float | None:
        """Our cost over theirs."""
        return self.ours[self.cost] / self.other[self.cost] if self.ours and self.other else None

    @property
    def behind(self) -> bool:
        """Whether the others are there at a lower cost, or we are not there."""
        return self.ours is None if self.ratio is None else self.ratio >= SAME[1]

    def __str__(self) -> str:
        texts = [f"{seconds(r[self.cost])} ({name(r['method'])})" for r in (self.ours, self.other) if r]
        if self.ratio is not None:
            return f"{percent(self.error)} takes {' against '.join(texts)}"
        absent = "no other reaches" if self.ours else f"{OURS} does not reach"
        return f"{percent(self.error)} takes {texts[0]}, and {absent} it"


def races(records: Sequence[Record], errors: Iterable[float], cost: str = "cpu_s", stays: bool = True) -> list[Race]:
    """Ours against the best of the others, for each error that anybody reaches."""
    mine, others = [r for r in records if ours(r)], [r for r in records if not ours(r)]
    found = [Race(e, cheapest(mine, e, cost, stays), cheapest(others, e, cost, stays), cost) for e in errors]
    return [race for race in found if race.ours or race.other]


def verdict(records: Sequence[Record], errors: Iterable[float], cost: str = "cpu_s", stays: bool = True) -> str:
    """Where the others are ahead, with both costs, then where we are, with the ratio."""
    found = races(records, errors, cost, stays)
    behind, ahead = [r for r in found if r.behind], [r for r in found if not r.behind]
    shares = [race.ratio for race in ahead if race.ratio is not None]
    alone = [percent(race.error) for race in ahead if race.ratio is None]
    at = ", ".join(percent(race.error).removesuffix(" %") for race in ahead if race.ratio is not None)
    parts = [f"Behind: {'; '.join(map(str, behind))}."] if behind else []
    parts += [f"Ahead or even at {at} %: {spread(shares)} of the best other's time."] if shares else []
    parts += [f"No other reaches {', '.join(alone)}."] if alone else []
    return " ".join(parts)


def race(records: Sequence[Record], errors: Iterable[float], cost: str = "cpu_s", stays: bool = True) -> str:
    """Ours beside the best of the others, a row for each error."""
    rows = []
    for of in races(records, errors, cost, stays):
        sides = [f"{seconds(r[cost])}, {name(r['method'])}" if r else MISSING for r in (of.ours, of.other)]
        rows.append([percent(of.error), *sides, number(of.ratio)])
    return table(("error", "ngbrain's cheapest", "cheapest other", "ratio"), rows)


def compared(records: Sequence[Record], errors: Sequence[float], cost: str = "cpu_s", stays: bool = True) -> str:
    """Ours beside the best of the others, then every method."""
    return f"{race(records, errors, cost, stays)}\n\n{reach(records, errors, cost, stays)}"


def _thousands(digits: str) -> str:
    return f"{int(digits):,}".replace(",", " ") if len(digits) > 4 else digits


FIELDS = {
    "youngs": "E", "storage": "G'", "loss": "G''", "mu": "μ", "zeta": "ζ", "phi": "φ",
    "shear_along": "μ(1+φ)", "shear_stretch": "μ(1+ζ)", "size": "abs(G*)",
}  # fmt: skip
"""What pages call fields of moduli."""


def by_field(errors: Mapping[str, float], digits: int = 2) -> str:
    """Errors of fields, one unit behind all."""
    return ", ".join(f"{FIELDS[key]} {number(100 * error, digits)}" for key, error in errors.items()) + " %"


def median_and_worst(several: Sequence[Mapping[str, float]]) -> str:
    """Errors of fields over seeds: the median, the worst in brackets."""
    texts = []
    for key in several[0]:
        values = [100 * errors[key] for errors in several]
        texts.append(f"{FIELDS[key]} {number(median(values))} ({number(max(values))})")
    return ", ".join(texts) + " %"
