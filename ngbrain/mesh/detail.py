"""How much of the anatomy a question needs: which route and size, by what was measured on one head."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

TABLE = "detail.json"
"""The records of `benchmarks/mesh_routes.py`, a copy of `benchmarks/mesh_routes.json`."""
QUESTIONS: Mapping[str, tuple[str, str, float]] = {
    "mean pressure under a dent of 5 mm": ("error", "cpu_s", 0.05),
    "95th percentile of the strain around it": ("strain_error", "cpu_s", 0.05),
    "displacement in tissue by a wave of 50 Hz": ("wave_error", "wave_s", 0.1),
}
"""Question → keys of its difference and of its CPU time in a record, and how exactly it is asked by itself."""


@dataclass(frozen=True)
class Need:
    """What a question needs.

    within       difference asked for, relative
    known        how well the finest mesh is itself known: its difference from the one that comes nearest to it
    route, size  of the cheapest mesh that differs by no more than that from the finest one, m; None where none does
    order        of its elements; cpu_s of mesh and solution
    difference   of that mesh
    """

    question: str
    within: float
    known: float
    route: str | None = None
    size: float = 0.0
    order: int = 0
    cpu_s: float = 0.0
    difference: float = 0.0

    def __str__(self) -> str:
        """In a sentence."""
        start = f"{self.question} within {self.within:.0%}"
        if self.route is None:
            return f"{start}: no mesh that was measured is sure to do; the finest is known to {self.known:.1%}"
        mesh = f"{self.route} of {1e3 * self.size:g} mm, order {self.order}"
        return f"{start}: {mesh} ({self.difference:.1%} from the finest, {self.cpu_s:.0f} s)"


@cache
def _records() -> tuple[dict, ...]:
    return tuple(json.loads(files("ngbrain.mesh").joinpath(TABLE).read_text()))


def need(question: str, within: float | None = None, records: tuple[dict, ...] | None = None) -> Need:
    """The cheapest mesh for one of `QUESTIONS`, by records of the benchmark (those that come with the library).

    Differences are from the finest mesh of all routes, so that what a route leaves out counts as what its elements do. A
    mesh does if its difference and that by which the finest mesh is known add up to no more than `within`. One head, MNI152,
    one site, one law of tissue: a guide, no bound.

    >>> records = ({"method": "ngbrain:hull", "size_mm": 9, "order": 2, "error": 0.03, "cpu_s": 4.0, "converged": True},)
    >>> finest = {"method": "ngbrain:lattice", "size_mm": 5, "order": 2, "error": 0.0, "cpu_s": 9.0, "converged": True}
    >>> print(need("mean pressure under a dent of 5 mm", 0.08, (*records, finest)))
    mean pressure under a dent of 5 mm within 8%: hull of 9 mm, order 2 (3.0% from the finest, 4 s)
    """
    key, spent, usual = QUESTIONS[question]
    within = usual if within is None else within
    rows = [r for r in (records or _records()) if r["converged"] and r.get(key) is not None]
    known = min((r[key] for r in rows if r[key] > 0), default=float("inf"))
    enough = [r for r in rows if r[key] + known <= within]
    if not enough:
        return Need(question, within, known)
    best = min(enough, key=lambda r: float(r[spent]))
    route = str(best["method"]).removeprefix("ngbrain:")
    return Need(
        question, within, known, route, 1e-3 * best["size_mm"], int(best["order"]), float(best[spent]), float(best[key])
    )


def needs() -> tuple[Need, ...]:
    """Of all questions."""
    return tuple(map(need, QUESTIONS))
