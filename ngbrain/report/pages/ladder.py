"""The page of the cheapest adequate model of a loaded body: answers, omitted effects, sequence of models."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.report.pages import first_answers
from ngbrain.report.pages.page import write_page
from ngbrain.report.pictures.style import figure, png, style
from ngbrain.report.words import display_unit

LEAST, MOST = 1e-3, 10.0
"""Range of the changes drawn: from this many per cent up to this many times."""


def build(path: str | os.PathLike[str], result: Mapping[str, Any]) -> Path:
    """Write the page of a result with error estimates of its quantities.

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
        matplotlib or jinja2 is not installed.
    """
    return write_page(
        Path(path),
        "ladder.html",
        {"way": _plot_search(result)},
        result=result,
        answers=answers(result),
        left_out=omitted_effects(result),
        first=first_answers.rows(result.get("first_answers") or {}),
        first_sentence=first_answers.sentence(result.get("first_answers") or {}),
    )


def answers(result: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of the answer table: quantity, value with unit, estimated error, tolerance."""
    rows = []
    for each in result["answers"]:
        unit, factor = display_unit(each["unit"])
        shown = f"{each['value'] * factor:.4g} {unit}".strip()
        rows.append((each["quantity"], shown, percent(each["error_estimate"]), percent(each["tolerance"])))
    return rows


def omitted_effects(result: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of the table of omitted effects: what the model lacks, its largest change of an answer, the method, doubts."""
    rows = [(each["what"], _largest(each["change"]), each["method"], each["caution"]) for each in result["left_out"]]
    return [(what, percent(change), *rest) for what, change, *rest in sorted(rows, key=lambda row: -(row[1] or np.inf))]


def percent(share: float | None) -> str:
    """A relative number in per cent; "unknown" for None.

    >>> percent(0.0123), percent(None)
    ('1.2 %', 'unknown')
    """
    return "unknown" if share is None else f"{100 * share:.2g} %"


def _largest(change: Sequence[float | None]) -> float | None:
    return None if None in change else max(abs(c or 0.0) for c in change)


def _worst(rung: Mapping[str, Any]) -> float:
    found = _largest(rung["error_bound"])
    return MOST if found is None else found


def _plot_search(result: Mapping[str, Any]) -> bytes:
    """Plot the estimated error of each model over the time spent."""
    with style():
        made = figure(4.2)
        axis = made.add_axes((0.09, 0.13, 0.89, 0.84))
        rungs = result["models"]
        cost = [rung["cost_s"] for rung in rungs]
        missing = [max(100 * min(_worst(rung), MOST), LEAST) for rung in rungs]
        axis.step(cost, missing, where="post", color="#0072B2", lw=1.5)
        axis.plot(cost, missing, "o", color="#0072B2")
        axis.plot(cost[-1:], missing[-1:], "o", color="#D55E00", ms=11, mfc="none", mew=2)
        for x, y, rung in zip(cost, missing, rungs, strict=True):
            axis.annotate(
                " and ".join(rung["next_axes"]) or "chosen",
                (x, y),
                xytext=(5, 6),
                textcoords="offset points",
                fontsize=9,
            )
        tolerance = 100 * min(each["tolerance"] for each in result["answers"])
        axis.axhline(tolerance, color="#4d4d4d", lw=1, ls="--")
        axis.set(xlabel="computing time including estimates (s)", ylabel="estimated error (%)")
        axis.set(yscale="log", ylim=(0.5 * min(*missing, tolerance), 2 * max(*missing, tolerance)))
        axis.set_xlim(0, 1.15 * cost[-1])
        return png(made)
