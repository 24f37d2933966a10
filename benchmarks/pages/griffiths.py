"""Tables of the page on Griffiths' spatulas."""

from _pages import records
from _tables import Record, count, listing, name, number, percent, seconds, table


def _heads() -> list[Record]:
    return [r for r in records("griffiths_scene") if r["kind"] == "head"]


def heads() -> str:
    columns = {
        "head": ("head", str), "steps": ("steps", str), "tetrahedra": ("tets", count), "unknowns": ("ndof", count),
        "a side": ("a_side_mm", lambda x: f"{x} mm"), "steps taken": ("n_steps", count), "rejected": ("rejected", count),
        "CPU time": ("cpu_s", seconds), "peak of the mean pressure": ("peak_mmHg", lambda p: f"{number(p, 3)} mmHg"),
        "force on one blade": ("peak_N", lambda f: f"{number(f)} N"), "left of the pressure": ("left", number),
        "of the force": ("left_force", number), "half gone": ("half_time_min", lambda t: f"{number(t)} min"),
    }  # fmt: skip
    return listing(_heads(), columns)


def theirs() -> str:
    """Ours against the steps of their file."""
    ours, their = (
        next(r for r in _heads() if r["head"] == "idealised" and r["steps"] == of) for of in ("ours", "theirs")
    )
    off = [percent(abs(ours[key] / their[key] - 1), 1) for key in ("peak_mmHg", "left")]
    return (
        f"With the {their['n_steps']} steps of their file the idealised head's peak and what is left differ by {off[0]}"
        f" and {off[1]}. A dash: half of the pressure is never gone."
    )


def stress() -> str:
    rows = [
        [r["head"], tissue, *(f"{number(at[tissue][key] / 1e3)} kPa" for at in (r["stress_opened_Pa"], r["stress_end_Pa"])
                              for key in ("mean", "p95"))]
        for r in _heads() if r["steps"] == "ours" for tissue in r["stress_opened_Pa"]
    ]  # fmt: skip
    return table(("head", "tissue", "mean, opened", "95 %", "mean, at the end", "95 %"), rows)


def columns() -> str:
    shown = {
        "tissue": ("tissue", lambda t: t.replace("_", " ")), "strain": ("strain", percent),
        "peak": ("peak_mmHg", lambda p: f"{number(p)} mmHg"), "left": ("left", number), "error of steps": ("error", percent),
    }  # fmt: skip
    return listing((r for r in records("griffiths_scene") if r["kind"] == "column"), shown)


def elements() -> str:
    shown = {
        "element": ("method", name), "cells": ("cells_mm", lambda h: f"{number(h)} mm"), "unknowns": ("ndof", count),
        "ν": ("nu", str), "way": ("way_mm", lambda w: f"{number(w, 3)} mm"), "force": ("N_over_finest", _off),
        "95 % of the von Mises stress": ("p95_over_finest", _off), "CPU time": ("cpu_s", seconds),
    }  # fmt: skip
    of = ("method", "cells_mm", "nu", "way_mm")
    once = {tuple(r[key] for key in of): r for r in records("griffiths_locking") if r["kind"] in ("poisson", "element")}
    found = once.values()
    return listing(sorted(found, key=lambda r: (r["way_mm"], r["nu"], r["method"], -r["cells_mm"])), shown)


def model() -> str:
    worst = max(r["N_over_finest"] for r in records("griffiths_locking") if r["method"].startswith("Q1"))
    least = min((r for r in records("griffiths_locking") if r["method"].startswith("Q1") and r["kind"] == "element"),
                key=lambda r: (r["nu"], r["cells_mm"]))  # fmt: skip
    texts = [
        f"{percent(1 - r['N_over_ours'])} for {number(r['way_mm'], 3)} mm"
        for r in records("griffiths_locking") if r["kind"] == "model"
    ]  # fmt: skip
    first = f"({_off(least['N_over_finest'])} in force with cells of {number(least['cells_mm'])} mm)"
    return (
        f"At ν = {least['nu']} Q1 locks mildly {first}, which is about as far as it can go: nearer to one half it has up to"
        f" {number(worst)} times the force. The other number is the model's: at their ν the force is lower than at K/μ = 1000 by"
        f" {' and by '.join(texts)}, whatever the element: Ogden's stress outgrows that bulk modulus, and tissue loses volume."
        " At full opening that matters far more than the element."
    )


def _off(ratio: float) -> str:
    return ("+" if ratio > 1 else "") + percent(ratio - 1)
