"""Tables and sentences of the retraction report: numbers as text, their meaning and their acceptance limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeGuard

from ngbrain.report.words import duration, number
from ngbrain.surgery.measures.dose_response import evidence, excludes_one_half
from ngbrain.surgery.uncertainty.error_budget import FAILED, NOT_COMPUTED, UNDER_WAY
from ngbrain.surgery.uncertainty.verification_runs import HALF, MESH, MILLER, ORDER

EQUAL = 5e-3
"""Values this close, relative to the largest, are called equal."""
ROUNDING = 1e-12
"""Smaller values are shown as 0 in the comparison; checks show them."""


@dataclass(frozen=True)
class TableRow:
    """A row of a table.

    Parameters
    ----------
    name : str
        Name of the quantity.
    unit : str
        Unit.
    cells : list of tuple of str
        (text, remark) for each column.
    """

    name: str
    unit: str
    cells: list[tuple[str, str]]


@dataclass(frozen=True)
class Check:
    """A verification check and its acceptance limit.

    Parameters
    ----------
    name : str
        Name of the check.
    wanted : str
        Acceptance limit in words.
    met : callable or None
        Value → whether the limit is met.
    unit : str
        Unit.
    """

    name: str
    wanted: str
    met: Callable[[float], bool] | None
    unit: str = ""


METRICS: tuple[tuple[str, str, str, bool], ...] = (
    ("peak_pressure_mmHg", "Peak pressure under the blade", "mmHg", True),
    ("peak_tip_pressure_mmHg", "Peak pressure at the tip (last 5 mm)", "mmHg", True),
    ("peak_centre_pressure_mmHg", "Peak pressure in the middle of the face (5 mm across)", "mmHg", True),
    ("peak_force_N", "Peak force on the blade", "N", True),
    ("largest_contact_area_mm2", "Largest contact area of the blade", "mm²", True),
    ("s_above_20_mmHg", "Time above 20 mmHg, in all", "s", True),
    ("longest_s_above_20_mmHg", "Time above 20 mmHg, longest without a break", "s", True),
    ("s_above_30_mmHg", "Time above 30 mmHg, in all", "s", True),
    ("longest_s_above_30_mmHg", "Time above 30 mmHg, longest without a break", "s", True),
    ("margin_to_20_mmHg", "Margin to 20 mmHg (negative: above it)", "mmHg", False),
    ("dose_mmHg_min", "Dose: pressure × time", "mmHg min", True),
    (
        "s_perfusion_below_10_mmHg",
        "Time with less than 10 mmHg of perfusion pressure (MAP less pressure), in all",
        "s",
        True,
    ),
    (
        "longest_s_perfusion_below_10_mmHg",
        "Time with less than 10 mmHg of perfusion pressure, longest without a break",
        "s",
        True,
    ),
    ("min_perfusion_reserve_mmHg", "Smallest perfusion reserve: MAP less the larger of pressure and ICP", "mmHg", True),
    ("working_s", "Working time: at full opening", "s", False),
    ("mps_p50", "Largest principal strain near the site, median", "%", True),
    ("mps_p95", "Largest principal strain near the site, 95th percentile", "%", True),
    ("mps_p99", "Largest principal strain near the site, 99th percentile", "%", True),
    ("mps_max_over_0_5_ml", "Largest principal strain near the site, mean of the worst 0.5 ml", "%", True),
    ("oss_p95", "Octahedral shear strain near the site, 95th percentile", "%", True),
    ("von_mises_p95_kPa", "Von Mises stress near the site, 95th percentile", "kPa", True),
    ("von_mises_max_over_0_5_ml_kPa", "Von Mises stress near the site, mean of the worst 0.5 ml", "kPa", True),
    ("strain_rate_p95_per_s", "Rate of deformation near the site, 95th percentile", "1/s", True),
    ("beyond_fit_ml", "Tissue strained beyond the range its law was fitted to", "ml", True),
    ("compressed_by_35_percent_ml", "Tissue compressed by more than 35 %, where free surfaces fold", "ml", True),
    ("min_net_reaction_N", "Smallest net reaction of the wall (negative: pulled)", "N", False),
    ("min_det_F", "Smallest volume ratio of any point", "", False),
)
"""Key, name, unit, and whether lowest and highest are marked."""

VOLUMES = {
    "window": "Bulge at the craniotomy (negative: sunk in)",
    "cleft": "Tissue into the cleft (negative: cleft widened)",
    "ventricles": "Volume that the ventricles lose",
    "compression": "Volume that tissue loses by compression",
}

CHECKS: dict[str, Check] = {
    "reaction_balance": Check("Blade and skull forces balance (relative)", "at most 1e-4", lambda v: abs(v) <= 1e-4),
    "volume_balance": Check("Displaced volumes add up to zero (relative)", "at most 1e-3", lambda v: abs(v) <= 1e-3),
    "energy_balance": Check(
        "Work of the blade equals that of the tissue (relative)", "at most 0.01", lambda v: abs(v) <= 0.01
    ),
    "dt_halving": Check(
        "Change of the first peak with half the time step (relative)", "less than 0.03", lambda v: abs(v) < 0.03
    ),
    "order_plus_one": Check(
        "Change of the pressure with one polynomial order more (relative; elastic, coarse mesh)", "no limit", None
    ),
    "other_elements": Check(
        "Change of the first peak with elements 1.4 times as large (of a coarse mesh: as small; relative)",
        "no limit",
        None,
    ),
    "min_net_reaction_N": Check(
        "Smallest net reaction of the wall", "not negative: no pull", lambda v: v >= -1e-5, "N"
    ),
    "force_while_off_N": Check("Force while the blade is off", "exactly 0", lambda v: v == 0, "N"),
    "gap_while_off_mm": Check("Smallest gap while the blade is off", "greater than 0", lambda v: v > 0, "mm"),
    "tissue_in_blade": Check(
        "Tissue inside the blade where it presses, mean (of the opening)", "at most 0.01", lambda v: v <= 0.01
    ),
    "deepest_in_blade": Check("Tissue inside the blade, deepest point at its edges (of the opening)", "no limit", None),
    "first_peaks_differ": Check(
        "First peaks of continuous and intermittent differ by (relative; computed once)",
        "at most 1e-6",
        lambda v: abs(v) <= 1e-6,
    ),
    "recontact_opening_below_release_mm": Check(
        "Opening at re-contact, below that at release", "greater than 0", lambda v: v > 0, "mm"
    ),
}


def comparison(answers: Mapping[str, Any]) -> list[TableRow]:
    """A row for each metric and a column for each protocol; lowest and highest are marked in words."""
    rows = []
    for key, name, unit, ranked in METRICS:
        values = [answer.get(key) for answer in answers.values()]
        if any(_is_number(v) for v in values):
            rows.append(_row(name, unit, values, ranked))
    thresholds = sorted({t for a in answers.values() for t in a.get("volume_mps_above", {})}, key=float)
    for threshold in thresholds:
        values = [a.get("volume_mps_above", {}).get(threshold) for a in answers.values()]
        rows.append(_row(_strained(threshold), "ml", values, True))
    for key, name in VOLUMES.items():
        values = [(a.get("volumes_ml") or {}).get(key) for a in answers.values()]
        if any(_is_number(v) for v in values):
            rows.append(_row(f"{name}, at peak strain", "ml", values, False))
    return rows


def headlines(answers: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Protocol and a sentence on its pressure and the time above the thresholds."""
    return [(name, _headline(answer)) for name, answer in answers.items()]


def _headline(answer: Mapping[str, Any]) -> str:
    peak = answer.get("peak_pressure_mmHg")
    text = f"pressure under the blade reached at most {number(peak)} mmHg"
    if _is_number(peak) and peak <= 20:
        return f"{text}: never above 20 mmHg, with {number(answer.get('margin_to_20_mmHg', 20 - peak))} mmHg to spare."
    parts = []
    for threshold in (20, 30):
        total: Any = answer.get(f"s_above_{threshold}_mmHg")
        longest: Any = answer.get(f"longest_s_above_{threshold}_mmHg")
        if _is_number(total):
            broken = _is_number(longest) and longest < total * (1 - EQUAL)
            rest = f" (at most {duration(longest)} without a break)" if broken else ""
            parts.append(f"above {threshold} mmHg for {duration(total)}{rest}")
    return f"{text}; it was {' and '.join(parts)}." if parts else f"{text}."


def findings(answers: Mapping[str, Any], given: list[str]) -> list[str]:
    """Sentences of the comparison, metric by metric.

    Parameters
    ----------
    answers : mapping of str to Any
        Protocol → answers.
    given : list of str
        Sentences of the result, which are used if there are any.

    Returns
    -------
    list of str
        The sentences.
    """
    if given:
        return list(given)
    found = []
    for key, name, unit, ranked in METRICS:
        values = {n: a.get(key) for n, a in answers.items()}
        if not ranked or len(values) < 2 or not all(_is_number(v) for v in values.values()):
            continue
        listed = ", ".join(f"{n} {_shown(v, unit)}" for n, v in sorted(values.items(), key=lambda item: item[1]))
        marks = _marks(list(values.values()))
        lowest = [n for n, mark in zip(values, marks, strict=True) if mark == "lowest"]
        verdict = f"lowest with {' and '.join(lowest)}" if lowest else "equal"
        found.append(f"{name}: {verdict} ({listed}{' ' + unit if unit else ''}).")
    return found


ESTIMATED_BY = {"dt_halving": HALF, "order_plus_one": ORDER, "other_elements": MESH}
"""Check → the verification run that it needs."""
MISSING = {
    UNDER_WAY: "Checks under way when this page was written; they are added as they finish: {}.",
    FAILED: "Checks that failed, so that their estimates are not known: {}.",
    NOT_COMPUTED: "Error estimates not computed: {}. They were left out on request; a resumed run can add them.",
}


def missing(status: Mapping[str, str]) -> list[str]:
    """Sentences on the checks without a result, with the reason."""
    found = {why: [name for name, now in status.items() if now == why] for why in MISSING}
    return [MISSING[why].format(", ".join(names)) for why, names in found.items() if names]


def checks(values: Mapping[str, Any], status: Mapping[str, str]) -> list[tuple[str, str, str, str]]:
    """Rows of the table of checks.

    Parameters
    ----------
    values : mapping of str to Any
        Check → value.
    status : mapping of str to str
        Verification run → its status.

    Returns
    -------
    list of tuple of str
        Name, value with unit, acceptance limit, verdict.
    """
    rows = []
    for key, value in values.items():
        check = CHECKS.get(key, Check(key.replace("_", " "), "–", None))
        shown = f"{number(value)} {check.unit}".strip()
        if not _is_number(value):
            verdict = _missing_reason(status.get(ESTIMATED_BY[key])) if key in ESTIMATED_BY else "does not apply"
        elif check.met is None:
            verdict = "for information"
        else:
            verdict = "met" if check.met(float(value)) else "NOT MET"
        rows.append((check.name, shown, check.wanted, verdict))
    return rows


def _missing_reason(status: str | None) -> str:
    """Reason for a missing value of a check."""
    return status if status in MISSING else "not known"


def regions(answers: Mapping[str, Any]) -> tuple[list[str], list[tuple[str, str, list[str]]]]:
    """Columns of the table of strained tissue, and its rows: region, protocols, volumes (ml) above each strain and beyond the fit.

    Protocols with the same volumes of a region share a row.
    """
    columns: list[str] = []
    rows: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for name, answer in answers.items():
        for region, volumes in (answer.get("volume_mps_above_by_region_ml") or {}).items():
            columns = [f"above {100 * float(threshold):g} %" for threshold in volumes] + ["beyond its fit"]
            beyond = (answer.get("beyond_fit_by_region_ml") or {}).get(region)
            shown = tuple(number(value, 2) for value in (*volumes.values(), beyond))
            rows.setdefault((region, shown), []).append(name)
    return columns, [(region, ", ".join(names), list(shown)) for (region, shown), names in sorted(rows.items())]


def band(given: Mapping[str, Any], status: Mapping[str, str]) -> list[tuple[str, str, float | None]]:
    """Peak pressure for other material laws: computed ones, then scaled to published moduli.

    Parameters
    ----------
    given : mapping of str to Any
        Results of the other laws.
    status : mapping of str to str
        Verification run → its status.

    Returns
    -------
    list of tuple
        What is changed, how, peak pressure (mmHg).
    """
    rows = [
        (name, "computed" if _is_number(value) else _missing_reason(status.get(MILLER)), value)
        for name, value in (given.get("peak_pressure_mmHg") or {}).items()
    ]
    moduli = given.get("published_moduli_Pa") or {}
    for name, value in sorted((given.get("peak_pressure_by_modulus_mmHg") or {}).items(), key=lambda item: item[1]):
        rows.append((f"as stiff as {name}", f"{number(moduli.get(name))} Pa", value))
    return rows


def error_budget(errors: Mapping[str, Any]) -> list[tuple[str, str, list[str]]]:
    """Error budget of each number: name, unit, and texts of its value, its errors by mesh, order and time step, their sum, and its
    range over materials.
    """
    above = {key: of["part"] for key, of in errors.items() if of.get("quantity") == "volume_mps_above"}
    strained = [(key, _strained(above[key]), "ml") for key in sorted(above, key=lambda key: float(above[key]))]
    rows = []
    for key, name, unit in [(key, name, unit) for key, name, unit, _ in METRICS] + strained:
        if of := errors.get(key):
            moved = [_shown(of.get(kind), unit, 2) for kind in ("mesh", "order", "step", "numerics")]
            low, high = (_shown(value, unit) for value in of["material"])
            rows.append((name, unit, [_shown(of["value"], unit), *moved, low if low == high else f"{low} to {high}"]))
    return rows


def peak_error_sentence(errors: Mapping[str, Any]) -> str:
    """Error budget of the peak pressure of a single opening held to the end, as a sentence; empty without one."""
    if not (of := errors.get("peak_pressure_mmHg")):
        return ""
    words = {"mesh": "mesh", "order": "order", "step": "time steps"}
    known = [f"{words[kind]} {number(of[kind], 2)}" for kind in words if _is_number(of.get(kind))]
    moved = f", errors: {', '.join(known)} mmHg" if known else ""
    low, high = (number(value) for value in of["material"])
    peak = f"Peak of one opening held to the end: {number(of['value'])} mmHg{moved}"
    return f"{peak}; other published tissue: {low} to {high} mmHg."


def _strained(threshold: str) -> str:
    return f"Tissue with principal strain above {100 * float(threshold):g} %"


def risks(answers: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of the risk table: protocol, pressure held for 15 minutes, minutes of pressure, evidence from published counts."""
    rows = []
    for name, answer in answers.items():
        if interval := answer.get("infarct_probability_95"):
            held, pressed = answer["pressure_held_15_min_mmHg"], answer["pressed_min"]
            said = evidence(held, answer["peak_pressure_mmHg"], pressed)
            if excludes_one_half(interval):
                low, high = (number(100 * p, 2) for p in interval)
                said += f"; probability at least {low} %" if interval[0] > 0.5 else f"; probability at most {high} %"
            rows.append((name, f"{number(held)} mmHg" if held else "none", f"{number(pressed, 2)} min", said))
    return rows


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _shown(value: Any, unit: str, digits: int = 3) -> str:
    if _is_number(value) and abs(value) < ROUNDING:
        return "0"
    return number(100 * value if unit == "%" and _is_number(value) else value, digits)


def _row(name: str, unit: str, values: list[Any], ranked: bool) -> TableRow:
    known = ranked and all(_is_number(v) for v in values)
    marks = _marks(values) if known else [""] * len(values)
    return TableRow(name, unit, [(_shown(v, unit), mark) for v, mark in zip(values, marks, strict=True)])


def _marks(values: list[float]) -> list[str]:
    """ "lowest" and "highest" where values differ by more than rounding; ties share the word."""
    low, high = min(values), max(values)
    near = EQUAL * max(abs(low), abs(high))
    if len(values) < 2 or high - low <= near:
        return [""] * len(values)
    return ["lowest" if v - low <= near else "highest" if high - v <= near else "" for v in values]
