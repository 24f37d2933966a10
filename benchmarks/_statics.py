"""What the statics benchmarks share: a case on many solvers, elements and meshes, one process each, and its chart."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

import _command
from _front import bars, figure, front, looks
from _peers import available, run

REPEATS, LONG = 3, 15.0
"""A case's time is the median of so many runs, unless one takes more CPU seconds than `LONG`."""
TIMEOUT = 240.0

Size = int | tuple[int, int]
"""Cells along an edge; or these and how often corners are refined."""


@dataclass(frozen=True)
class Method:
    """An element of a solver on meshes of these sizes; --quick takes the first `quick` of them."""

    solver: str
    element: str
    sizes: tuple[Size, ...]
    quick: int = 0


@dataclass(frozen=True)
class Benchmark:
    """A case and what it is measured with.

    reference   the value that errors are relative to
    alike       error at which the chart's bars compare where time goes
    title       of the chart: the case in a line
    compared    methods with a bar
    """

    about: str
    case: str
    reference: float
    alike: float
    title: str
    methods: tuple[Method, ...]
    compared: tuple[str, ...]

    def measure(self, quick: bool) -> list[dict]:
        """One record for each method and mesh; peers that are not installed are left out."""
        records, here = [], available()
        for method in self.methods:
            if method.solver not in here:
                continue
            for size in method.sizes[: method.quick] if quick else method.sizes:
                records.append(self.record(method, size, 1 if quick else REPEATS))
        return records

    def record(self, method: Method, size: Size, repeats: int) -> dict:
        """The run with the median time, with the shortest and the longest."""
        n, corners = size if isinstance(size, tuple) else (size, 0)
        runs: list[dict] = []
        while len(runs) < repeats and not (runs and long(runs[-1])):
            runs.append(run(method.solver, self.case, n, method.element, timeout=TIMEOUT, corners=corners))
        middle = median(r["cpu_s"] or 0.0 for r in runs)
        found = min(runs, key=lambda r: abs((r["cpu_s"] or 0.0) - middle))
        if runs[-1]["cpu_s"] is not None:
            times = [r["cpu_s"] for r in runs]
            found |= {"cpu_s_min": min(times), "cpu_s_max": max(times)}
        error = abs(found["value"] / self.reference - 1) if found["converged"] else None
        return found | {"error": error, "mesh": f"{n}+{corners}" if corners else f"{n}"}

    def chart(self, records: list[dict], path: str) -> None:
        """Error against time, and where the time goes at a like error."""
        plt, made, (left, right) = figure(15.5, 7.4, 2, width_ratios=(1.15, 1))
        styles = looks(r["method"] for r in records)
        front(records, left, title=self.title, ylabel="relative error", styles=styles, size="mesh")
        alike = [r for m in self.compared if (r := nearest((r for r in records if r["method"] == m), self.alike))]
        labels = [f"{r['method']}\nn = {r['mesh']}, error {percent(r['error'])}" for r in alike]
        bars(alike, right, labels, title=f"Where the time goes at an error near {percent(self.alike)}")
        made.savefig(path, dpi=150)
        plt.close(made)

    def main(self) -> None:
        """The command line."""
        _command.main(self.about, self.measure, self.chart, line)


def long(record: dict) -> bool:
    """Whether a run is not worth repeating: it took long, or ended without a record."""
    return record["cpu_s"] is None or record["cpu_s"] > LONG


def nearest(records: Iterable[dict], error: float, factor: float = 4.0) -> dict | None:
    """The record whose error is nearest to one, None if none is within a factor."""
    found = [(abs(math.log(r["error"] / error)), i, r) for i, r in enumerate(records) if r["error"]]
    return min(found)[2] if found and min(found)[0] < math.log(factor) else None


def time_to(records: Iterable[dict], error: float) -> float | None:
    """CPU seconds in which a method reaches an error: interpolated between its meshes, log-log; None if it does not.

    Between the finest mesh above the error and the next; a method whose meshes are all below it has its cheapest's time.
    """
    rows = sorted((r for r in records if r["error"]), key=lambda r: r["ndof"])
    if rows and all(r["error"] <= error for r in rows):
        return rows[0]["cpu_s"]
    for a, b in reversed(list(pairwise(rows))):
        if b["error"] <= error < a["error"]:
            share = math.log(a["error"] / error) / math.log(a["error"] / b["error"])
            return a["cpu_s"] * (b["cpu_s"] / a["cpu_s"]) ** share
    return None


def percent(error: float) -> str:
    """An error in per cent, two digits."""
    return f"{100 * error:.2g} %"


def line(r: dict) -> str:
    """One record as text."""
    result = f"{r['error']:.1e}" if r["converged"] else "failed"
    text = f"{r['method']:<24} {r['mesh']:>6} {r['ndof'] or 0:8d} unknowns  {result:>8}  {r['cpu_s'] or 0:7.2f} s"
    counts = "".join(f", {r[name]} {name}" for name in ("newton", "factorisations", "cuts") if r.get(name) is not None)
    return f"{text}{counts}  {r['reason']}".rstrip()
