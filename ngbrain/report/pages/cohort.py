"""The page of a cohort: verdicts, outliers and distributions of many scans or cases."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ngbrain.report.pages.page import write_page
from ngbrain.report.words import duration, number

GOLDEN = 0.618
"""Vertical offset of neighbouring dots, as a part of the strip."""
MOST_DOTS = 150
"""Number of rows above which only those outside the middle nine tenths are drawn."""
BEYOND = 1.5
"""Half-width of the outlier strips in limits; dots beyond are drawn at the ends."""
WORDS = {"ok": "ok", "warning": "with a warning", "excluded": "excluded", "failed": "failed"}


@dataclass(frozen=True)
class Dot:
    """A row of the cohort in a strip plot.

    Parameters
    ----------
    x, y : float
        Position (% of width and height).
    name : str
        Name of the row.
    says : str
        Tooltip.
    link : str
        Its report.
    out : bool
        Whether it is an outlier.
    """

    x: float
    y: float
    name: str
    says: str
    link: str
    out: bool


@dataclass(frozen=True)
class Strip:
    """Strip plot of one number of a group; positions are in % of the width.

    Parameters
    ----------
    name, group, about : str
        Name of the number, the group, and a remark.
    dots : list of Dot
        One dot for each row.
    low, middle, high : float
        Lower quartile, median and upper quartile.
    least, most : str
        Smallest and largest value as text.
    marks : tuple of float
        Positions of the outlier limits.
    """

    name: str
    group: str
    about: str
    dots: list[Dot]
    low: float
    middle: float
    high: float
    least: str
    most: str
    marks: tuple[float, ...] = ()


def build(path: str | os.PathLike[str], result: Mapping[str, Any]) -> Path:
    """Write the page of a cohort's result.

    Parameters
    ----------
    path : str or path-like
        Output file.
    result : mapping of str to Any
        The result.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    MissingExtra
        jinja2 is not installed.
    """
    answers = result["answers"]
    out = {(each["row"], each["key"]) for each in answers["outliers"]}
    keys = list(answers["numbers"])
    spreads = sorted(
        answers["spreads"], key=lambda spread: keys.index(spread["key"])
    )  # groups of a number below each other
    ends = {
        key: (
            min(each["least"] for each in spreads if each["key"] == key),
            max(each["most"] for each in spreads if each["key"] == key),
        )
        for key in {spread["key"] for spread in spreads}
    }
    places = [list(_places(spread, answers)) for spread in spreads]
    tested = [(spread, rows) for spread, rows in zip(spreads, places, strict=True) if not spread["untested"]]
    tested.sort(key=lambda each: -max(map(abs, each[0]["deviations"].values())) / each[0]["limit"])
    untested = dict[str, list[str]]()
    for spread in spreads:
        if spread["untested"]:
            name = " ".join(
                filter(None, (title(answers, spread["key"]), f"({spread['group']})" if spread["group"] else ""))
            )
            untested.setdefault(spread["untested"], []).append(name)
    reasons = dict[tuple[str, str], dict[str, Any]]()
    for name, row in answers["rows"].items():
        if row["verdict"] != "ok":
            reasons.setdefault((row["verdict"], row["reason"]), {})[name] = row
    return write_page(
        Path(path),
        "cohort.html",
        {},
        result=result,
        conclusion=conclusion(result["checks"]),
        words=WORDS,
        rows=answers["rows"],
        reasons=reasons,
        own=list(dict.fromkeys(column for row in answers["rows"].values() for column in row["about"])),
        numbers={key: title(answers, key) for key in answers["numbers"]},
        show=show,
        taken=lambda seconds: "–" if seconds is None else duration(seconds),
        gate=[_gate(spread, rows, out, answers) for spread, rows in tested],
        untested=untested,
        strips=[
            _strip(spread, rows, out, answers, ends[spread["key"]])
            for spread, rows in zip(spreads, places, strict=True)
        ],
        out=out,
    )


def show(value: Any) -> str:
    """A number with four digits, an integer without a decimal point.

    >>> show(639.0), show(16.0123), show(None)
    ('639', '16.01', '–')
    """
    return number(int(value) if isinstance(value, float) and value.is_integer() else value, 4)


def conclusion(checks: Mapping[str, Any]) -> str:
    """How many rows are usable, as a sentence.

    >>> conclusion({"rows": 4, "ok": 1, "warning": 1, "excluded": 0, "failed": 2})
    '2 of 4 rows are usable, 1 of them with a warning; 2 failed.'
    """
    usable = checks["ok"] + checks["warning"]
    text = f"{usable} of {checks['rows']} rows are usable" + (
        f", {checks['warning']} of them with a warning" * bool(checks["warning"])
    )
    return text + "".join(f"; {checks[word]} {word}" for word in ("excluded", "failed") if checks[word]) + "."


def title(answers: Mapping[str, Any], key: str) -> str:
    """Name of a number, with its region and unit.

    Parameters
    ----------
    answers : mapping of str to Any
        The `answers` of a cohort's result.
    key : str
        Key of the number.

    Returns
    -------
    str
        The name.

    Examples
    --------
    >>> title({"numbers": {"volume_ml_grey": {"name": "Volume", "region": "grey", "unit": "ml"}}}, "volume_ml_grey")
    'Volume, grey (ml)'
    """
    of = answers["numbers"][key]
    return ", ".join(filter(None, (of["name"], of["region"]))) + (f" ({of['unit']})" if of["unit"] else "")


def _places(spread: Mapping[str, Any], answers: Mapping[str, Any]) -> Iterator[tuple[str, float, str]]:
    """Name, value and report of the usable rows of a group."""
    for name in spread["rows"]:
        row = answers["rows"][name]
        yield name, row["numbers"][spread["key"]], row["report"]


def _gate(spread: Any, rows: list[tuple[str, float, str]], out: set[tuple[str, str]], answers: Any) -> Strip:
    def place(away: float) -> float:
        return 50 + 48 * min(max(away / spread["limit"], -BEYOND), BEYOND) / BEYOND

    away = spread["deviations"]
    dots = [
        Dot(place(away[name]), _height(i), name, f"{name}: {away[name]:+.1f}", link, (name, spread["key"]) in out)
        for i, (name, _, link) in enumerate(rows)
    ]
    about = f"{spread['n']} rows, limit ±{spread['limit']:.1f}"
    marks = place(-spread["limit"]), place(spread["limit"])
    low, high = map(place, spread["middle_half"])
    return Strip(title(answers, spread["key"]), spread["group"], about, _shown(dots), low, 50.0, high, "", "", marks)


def _strip(
    spread: Any, rows: list[tuple[str, float, str]], out: set[tuple[str, str]], answers: Any, ends: tuple[float, float]
) -> Strip:
    least, most = ends

    def place(value: float) -> float:
        return 50.0 if most <= least else 2 + 96 * (value - least) / (most - least)

    dots = [
        Dot(place(value), _height(i), name, f"{name}: {show(value)}", link, (name, spread["key"]) in out)
        for i, (name, value, link) in enumerate(rows)
    ]
    about = f"{spread['n']} row{'s' if spread['n'] > 1 else ''}, median {show(spread['median'])}"
    if spread["n"] > 1:
        about += f", quartiles {show(spread['low'])} to {show(spread['high'])}"
    low, middle, high = (place(spread[key]) for key in ("low", "median", "high"))
    return Strip(
        title(answers, spread["key"]), spread["group"], about, _shown(dots), low, middle, high, show(least), show(most)
    )


def _height(i: int) -> float:
    return 22 + 56 * ((i * GOLDEN) % 1)


def _shown(dots: list[Dot]) -> list[Dot]:
    if len(dots) <= MOST_DOTS:
        return dots
    order = sorted(dots, key=lambda dot: dot.x)
    end = len(dots) // 20
    return order[:end] + [dot for dot in order[end:-end] if dot.out] + order[-end:]
