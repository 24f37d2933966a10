"""Every solver's error against time with the others beside it: what is compared, its table and its chart.

python benchmarks/_overview.py      draws benchmarks/results/overview.png, of the records of all that is compared
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from _front import MUTED, SPARE, figure, pareto
from _pages import RESULTS, records
from _tables import MISSING, OURS, SAME, Record, cheapest, name, number, ours, percent, seconds, table

CHART = RESULTS / "overview.png"
BLUE = "#0072B2"
NARROW = 30
"""Up to which ratio of its ends an axis has ticks at 1, 2 and 5."""
SLACK = 1.01
"""Errors that are the same but for so much count as the same."""


def _mm(value: float) -> str:
    return f"{number(value)} mm"


@dataclass(frozen=True)
class Problem:
    """What is compared: records of a benchmark that have an error and a cost."""

    title: str
    page: str
    benchmark: str
    of: str
    """What the error is of."""
    where: Callable[[Record], bool] = lambda _: True
    error: str = "error"
    show: Callable[[float], str] = percent
    stays: bool = True
    """Whether an error counts only where dearer records of the method have it too."""
    others: Sequence[str] = ()
    """Textbook methods of this library's own, which count as others."""
    settled: bool = True
    """Whether what ended before it had settled is left out."""
    also: str = ""
    """A cost that is added to the CPU time."""

    def points(self) -> list[Record]:
        """Method, order, error and cost of each record that came to an end."""
        found: list[Record] = []
        for r in records(self.benchmark):
            error, cost = r.get(self.error), r.get("cpu_s")
            if self.where(r) and (r["converged"] or not self.settled) and error and cost:
                method = r["method"].removeprefix(f"{OURS}:") if r["method"] in self.others else r["method"]
                cost += r[self.also] if self.also else 0
                found.append(
                    {"method": method, "order": r.get("order"), "error": error, "cpu_s": cost, "converged": True}
                )
        return found


PROBLEMS = (
    Problem("Cube pressed smoothly", "statics", "statics_smooth", "force"),
    Problem("Cook's membrane", "statics", "statics_cook", "rise of the corner"),
    Problem("Bonded cube pressed by a fifth", "statics", "statics_block", "force"),
    Problem(
        "Shear waves, thirteen wave lengths", "harmonic_waves", "harmonic_order", "displacement",
        lambda r: (r["kL"], r["xi"]) == (80.0, 0.0),
    ),
    Problem(
        "Relaxing block, steps of half an hour", "viscoelastic_blocks", "retraction_time", "peak and dose",
        lambda r: r["study"] == "steps",
    ),
    Problem(
        "Relaxing block, meshes", "viscoelastic_blocks", "retraction_time", "dose", lambda r: r["study"] == "space",
    ),
    Problem(
        "A Maxwell branch's step", "materials", "flow_steps", "overstress", lambda r: r["case"].endswith(" s"),
        others=("ngbrain:backward Euler",),
    ),
    Problem(
        "Constants of a glued cube", "materials", "bonded_fits", "constants", lambda r: r["case"] == "known" and r["noise"] == 0,
    ),
    Problem("Surface of a head", "meshes", "head_mesh", "distance", error="error_mm", show=_mm),
    Problem("Tissues of a head", "meshes", "tissue_meshes", "interfaces", lambda r: not r["graded"], error="mean_mm", show=_mm),
    Problem(
        "Gradient of a linear cube, solve and all", "derivatives", "gradient_cost_statics", "gradient",
        lambda r: r["case"] == "linear" and r["ndof"] == 46875, also="forward_s",
    ),
    Problem(
        "Stiffness from waves, 1 % noise", "elastography", "inversion_noise", "G*", lambda r: r["noise"] == 0.01, stays=False,
    ),
    Problem("Stiffness in a block", "elastography_in_space", "inversion_space", "ln abs(G*)"),
    Problem(
        "Stiffness in a head", "elastography_in_space", "elastography_head", "medians and contrast",
        lambda r: not r["method"].startswith(("MRE134", "truth")), settled=False,
    ),
    Problem(
        "Surrogate, compression, 1 % noise", "surrogate", "surrogate_error", "E of a spot",
        lambda r: r["modality"] == "compression" and r["noise"] == 0.01 and not r["grain"] and r["sample"] == 0
        and r["family"] == "gaussian_width", others=("ngbrain:1/strain", "ngbrain:NLI"), stays=False,
    ),
    Problem(
        "Retraction, meshes", "retraction", "retraction_mesh", "worst number", lambda r: r["head"] == "mni152",
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Result:
    """Ours and the best of the others at the smallest error that both have."""

    problem: Problem
    error: float | None
    mine: Record | None
    other: Record | None
    best: tuple[float | None, float | None]
    """The smallest error, ours and theirs."""

    @property
    def behind(self) -> bool:
        """Whether another is cheaper at the error that both have, or more exact than we are at all."""
        worse = None not in self.best and self.best[1] < self.best[0]
        return worse or bool(self.mine and self.other and self.mine["cpu_s"] >= SAME[1] * self.other["cpu_s"])


def results() -> list[Result]:
    """What is found for each problem."""
    found = []
    for problem in PROBLEMS:
        points = problem.points()
        sides = [r for r in points if ours(r)], [r for r in points if not ours(r)]
        best = _smallest(sides[0], problem.stays), _smallest(sides[1], problem.stays)
        error = None if None in best else SLACK * max(best)
        rows = [cheapest(side, error, stays=problem.stays) if error else None for side in sides]
        found.append(Result(problem, error, *rows, best))
    return found


def _smallest(points: list[Record], stays: bool) -> float | None:
    """The smallest error that counts as reached."""
    return min((r["error"] for r in points if cheapest(points, r["error"], stays=stays)), default=None)


def overview() -> str:
    """A row for each problem."""
    rows = []
    for r in results():
        costs = [f"{seconds(x['cpu_s'])}, {name(x['method'])}" if x else MISSING for x in (r.mine, r.other)]
        best = [r.problem.show(error) if error else MISSING for error in r.best]
        ratio = number(r.mine["cpu_s"] / r.other["cpu_s"]) if r.mine and r.other else MISSING
        link = f"[{r.problem.title}]({r.problem.page}.md)"
        rows.append([link, r.problem.of, r.problem.show(r.error) if r.error else MISSING, *costs, ratio, *best])
    titles = (
        "problem", "error of", "smallest error that both have", "ngbrain's cheapest", "cheapest other", "ratio",
        "ngbrain's smallest error", "others'",
    )  # fmt: skip
    return table(titles, rows)


def behind() -> str:
    """Where another is ahead, as a list."""
    lines = []
    for r in results():
        if r.behind and r.mine and r.other:
            show = r.problem.show
            lines.append(
                f"- {r.problem.title}: {show(r.error)} takes {seconds(r.mine['cpu_s'])} ({name(r.mine['method'])}) against"
                f" {seconds(r.other['cpu_s'])} ({r.other['method']}); the smallest errors are {show(r.best[0])} and"
                f" {show(r.best[1])}."
            )
    return "\n".join(lines)


def digest() -> str:
    """What the chart is of."""
    drawn = [(p.title, p.of, p.points()) for p in PROBLEMS]
    return hashlib.sha256(json.dumps(drawn, ensure_ascii=False).encode()).hexdigest()


def fresh(png: Path = CHART) -> bool:
    """Whether the chart is of these records."""
    return png.exists() and f"Description\0{digest()}".encode() in png.read_bytes()


def chart(png: Path = CHART) -> None:
    """A panel for each problem: ours strong, a line for each other library, what no other point beats joined."""
    columns = 4
    rows = -(-len(PROBLEMS) // columns)
    plt, made, grid = figure(4.2 * columns, 3.3 * rows, columns, rows)
    for axes, problem in zip(grid.ravel(), PROBLEMS, strict=False):
        points, length = problem.points(), problem.show is _mm
        spare = iter(SPARE * 4)
        for library in sorted({_library(r) for r in points}, key=lambda each: each == OURS):
            of = [(r["cpu_s"], r["error"] * (1 if length else 100)) for r in points if _library(r) == library]
            strong = library == OURS
            colour = BLUE if strong else MUTED.get(library) or next(spare)
            look: dict[str, Any] = {"color": colour, "zorder": 4 if strong else 3, "marker": "o" if strong else "s"}
            axes.loglog(*zip(*of, strict=True), ls="", ms=3.5 if strong else 3, alpha=0.45, **look)
            axes.loglog(*zip(*pareto(of), strict=True), lw=2.4 if strong else 1.3, ms=5, label=library, **look)
        axes.set(xlabel="CPU time (s)", ylabel=f"{problem.of} ({'mm' if length else '%'})", title=problem.title)
        axes.title.set_fontsize(10)
        for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            few = high < NARROW * low
            axis.set_major_locator(plt.matplotlib.ticker.LogLocator(subs=(1, 2, 5) if few else (1,)))
            axis.set_major_formatter(plt.matplotlib.ticker.FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(plt.matplotlib.ticker.NullFormatter())
        axes.grid(alpha=0.25, lw=0.6)
        axes.legend(fontsize=7, frameon=False, loc="best")
    for axes in grid.ravel()[len(PROBLEMS) :]:
        axes.set_axis_off()
    made.savefig(png, dpi=100, metadata={"Description": digest()})
    plt.close(made)


def _library(record: Record) -> str:
    """Who made a point."""
    method = record["method"]
    if ours(record):
        return OURS
    first = method.partition(",")[0]
    return first.split()[0] if first.split()[0] in MUTED or first.startswith(("torch", "JAX", "dolfinx")) else first


if __name__ == "__main__":
    chart()
