"""Tables of the page on the ladder."""

import numpy as np
from _pages import records
from _tables import Record, bullets, number, percent, table

WORDS = {
    "tissue": {"each": "", "one": "one tissue"},
    "fibres": {"all": "fibres", "none": "no fibres"},
    "strain": {"finite": "finite strain", "linear": "linear"},
    "time": {"flowing": "finite viscosity", "relaxed": "moduli relaxed", "instantaneous": "instantaneous"},
    "inertia": {"all": "inertia", "none": ""},
    "loss": {"all": "loss", "none": "no loss"},
    "contact": {"all": "sliding", "none": ""},
    "space": {"plane": "section", "solid": ""},
    "order": {"1": "P2/P1", "2": "P3/P2"},
    "mesh": {
        "0": "coarsest elements", "0+": "some elements halved", "1": "elements halved",
        "1+": "some elements quartered", "2": "elements quartered",
    },
}  # fmt: skip
"""What a model is called by the level of each of its axes."""
JUDGED, FACTOR = 0.05, (0.3, 3)
"""From which change of an answer on estimates are judged, and within which factor they are right."""


def _by_scene() -> dict[str, dict[float, Record]]:
    found: dict[str, dict[float, Record]] = {}
    for r in records("ladder_scenes"):
        found.setdefault(r["scene"], {})[r["tolerance"]] = r
    return found


def behind() -> str:
    every = records("ladder_scenes")
    missed = [r for r in every if r["error"] > r["tolerance"]]
    silent = [r for r in missed if not r["flagged"]]
    dear = [
        f"{r['scene']} at {percent(r['tolerance'])} ({number(r['cost_ratio'])})"
        for r in every
        if r["cost_ratio"] >= 1.05
    ]
    misses = "; ".join(f"{r['scene']} at {percent(r['tolerance'])} ({percent(r['error'])})" for r in missed)
    return bullets([
        f"Dearer than the richest model: {', '.join(dear)} times its time.",
        f"Off by more than was asked: {misses or 'none'}; without a flag {len(silent)} of {len(every)}.",
    ])  # fmt: skip


def conclusion() -> str:
    texts = []
    for tolerance in sorted({r["tolerance"] for r in records("ladder_scenes")}, reverse=True):
        of = [r for r in records("ladder_scenes") if r["tolerance"] == tolerance]
        held = sum(r["error"] <= tolerance for r in of)
        middle = number(np.median([r["cost_ratio"] for r in of]))
        texts.append(f"{percent(tolerance)}, {held} of {len(of)} within it, {middle} of the time")
    texts.append(f"all, {number(np.median([r['cost_ratio'] for r in records('ladder_scenes')]))} of the time")
    pairs = [p for r in records("ladder_scenes") for p in r["pairs"] if p["true"] > JUDGED]
    foretold = [p for p in pairs if p["how"] != "solved"]
    near = sum(FACTOR[0] <= (p["effectivity"] or 0) <= FACTOR[1] for p in foretold)
    return (
        f"Scenes within the tolerance, and the median of the time over the richest model's: {'; '.join(texts)}. Changes of"
        f" more than {percent(JUDGED)} of the answer are foretold as three tenths to three times in {near} of {len(foretold)}"
        " (steps that were solved for not counted)."
    )


def scenes() -> str:
    rows = []
    for scene, at in _by_scene().items():
        order = sorted(at, reverse=True)
        errors = [f"{percent(at[t]['error'])}{'*' if at[t]['flagged'] else ''}" for t in order]
        costs = [number(at[t]["cost_ratio"]) for t in order]
        rows.append([scene, *errors, *costs, f"{number(at[order[0]]['rich_s'], 3)} s", _words(at[order[1]]["model"])])
    tolerances = [percent(t) for t in sorted(next(iter(_by_scene().values())), reverse=True)]
    titles = [f"error at {t}" for t in tolerances] + [f"time at {t}" for t in tolerances]
    return table(("scene", *titles, "richest model's time", f"model at {tolerances[1]}"), rows)


def _words(model: dict[str, str]) -> str:
    return ", ".join(word for axis, level in model.items() if (word := WORDS.get(axis, {}).get(level, "")))
