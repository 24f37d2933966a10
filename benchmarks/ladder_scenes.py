"""Does the ladder choose the cheapest model that is good enough, and does it know how good it is?

Scenes from trivial to hard, four of them drawn at random (`_ladder.py`), each asked at 20, 5 and 1 %. Against the richest model
that a scene may have: its error, its computing time over that model's (estimates included), whether a miss is flagged. And for
every axis of every rung on the way at 5 %: what was estimated to change, over what does.

`error` and `true_error`: of the chosen model against the richest one, the largest over the questions; `estimated_error`: what the
ladder says is missing; `effectivity`: estimated over true change, for axes whose true change exceeds the tolerance.

    python benchmarks/ladder_scenes.py [--quick] [--json] [--executor WHO]      last line of --json: a list of records
    python benchmarks/ladder_scenes.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from _command import main, sweep
from _front import figure
from _ladder import Case, cases

from ngbrain import parallel
from ngbrain.errors import SolverError
from ngbrain.ladder import (
    ModelHierarchy,
    SearchResult,
    SolutionCache,
    axes_of,
    estimates,
    relative_difference,
    richest,
    search_models,
)
from ngbrain.scene import Scene

Record = dict
TOLERANCES = (0.2, 0.05, 0.01)
JUDGED = 0.05
QUICK = ("bar pulled 0.1 mm", "bar pressed 20 %, alpha -19", "palpation 0.2 mm, 1 s")


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """A record for each scene and tolerance."""
    scenes = {name: (name, case) for name, case in cases().items() if not quick or name in QUICK}
    found = sweep(of_scene, scenes, executor, lambda made: print(*map(line, made), sep="\n", flush=True))
    return [record for made in found for record in made]


def of_scene(name: str, case: Case) -> list[Record]:
    """The richest model, then three climbs."""
    axes = axes_of(case.scene, case.richest)
    top = richest(axes)
    truth = SolutionCache(ModelHierarchy(case.scene))
    rich = truth(top)
    found = []
    for tolerance in TOLERANCES:
        begun = time.process_time()
        got = search_models(asked(case.scene, tolerance), case.richest)
        cost = time.process_time() - begun
        chosen = got.chosen
        error = float(np.max(np.abs(relative_difference(chosen.answers, rich.answers))))
        record: Record = {"method": "ngbrain:ladder", "scene": name, "tolerance": tolerance}
        record |= {"order": int(chosen.model["order"]), "ndof": chosen.ndof, "error": error, "true_error": error}
        record |= {"estimated_error": float(np.max(got.error)), "cpu_s": cost, "rich_s": rich.cost_s}
        record |= {
            "cost_ratio": cost / rich.cost_s,
            "flagged": bool(got.warnings),
            "flags": got.warnings,
            "converged": True,
        }
        record |= {
            "model": chosen.model,
            "richest": top,
            "ndof_richest": rich.ndof,
            "answers": chosen.answers.tolist(),
            "rich_answers": rich.answers.tolist(),
            "steps": staircase(got, rich.answers),
        }
        record["pairs"] = pairs(got, truth) if tolerance == JUDGED else []
        judged = [p["effectivity"] for p in record["pairs"] if p["true"] > tolerance and p["effectivity"]]
        record["effectivity"] = float(np.median(judged)) if judged else None
        found.append(record)
    return found


def asked(scene: Scene, tolerance: float) -> Scene:
    """The same scene with other tolerances."""
    return replace(scene, quantities=tuple(replace(quantity, tolerance=tolerance) for quantity in scene.quantities))


def staircase(got: SearchResult, answers: np.ndarray) -> list[dict[str, Any]]:
    """Error against cost, rung by rung."""
    return [
        {
            "cost_s": rung.cost_s,
            "error": float(np.max(np.abs(relative_difference(rung.answers, answers)))),
            "taken": " and ".join(rung.next_axes),
            "model": rung.model,
        }
        for rung in got.history
    ]


def pairs(got: SearchResult, truth: SolutionCache) -> list[dict[str, Any]]:
    """Estimated and true change of every axis at every rung, for the question that changes most."""
    found = []
    for k, rung in enumerate(got.history):
        for name, each in rung.estimates.items():
            richer = {**rung.model, name: each.to}
            try:
                change = np.abs(relative_difference(truth(rung.model).answers, truth(richer).answers))
            except SolverError:
                continue
            i = int(np.argmax(change))
            estimated, true = float(np.abs(each.change[i])), float(change[i])
            known = np.isfinite(estimated) and true > 0
            pair = {"rung": k, "axis": name, "level": rung.model[name], "how": each.method, "doubt": each.caution}
            pair |= {"estimated": estimated if np.isfinite(estimated) else None, "true": true}
            found.append(pair | {"effectivity": estimated / true if known else None})
    return found


def chart(records: list[Record], png: str) -> None:
    """Error against cost for each scene at 5 %, rung by rung, the chosen one marked; estimated against true changes."""
    judged = [r for r in records if r["tolerance"] == JUDGED]
    columns = 4
    rows = -(-(len(judged) + 1) // columns)
    plt, made, grid = figure(4 * columns, 3 * rows, columns, rows)
    axes = grid.ravel()
    for axis, r in zip(axes, judged, strict=False):
        cost = [step["cost_s"] / r["rich_s"] for step in r["steps"]]
        error = [max(100 * step["error"], 0.05) for step in r["steps"]]
        axis.step(cost, error, where="post", color="#0072B2", lw=1.2)
        axis.plot(cost, error, "o", color="#0072B2", ms=3)
        axis.plot(cost[-1], error[-1], "o", color="#D55E00", ms=8, mfc="none", mew=2)
        axis.axhline(100 * r["tolerance"], color="#4d4d4d", lw=0.8, ls="--")
        axis.axvline(1, color="#4d4d4d", lw=0.8, ls=":")
        axis.set(xscale="log", yscale="log", xlim=(0.001, 3), ylim=(0.04, 200), title=r["scene"])
        axis.title.set_fontsize(9)
        axis.tick_params(labelsize=7)
    for axis in axes[: len(judged)][-columns:]:
        axis.set_xlabel("computing time / richest model's", fontsize=8)
    for axis in axes[: len(judged)][::columns]:
        axis.set_ylabel("error, %", fontsize=8)
    last = axes[len(judged)]
    for r in judged:
        for p in r["pairs"]:
            colour = "#D55E00" if p["doubt"] else "#0072B2"
            if p["estimated"] is not None and p["how"] != estimates.SOLVED:
                last.plot(max(p["true"], 1e-4), max(p["estimated"], 1e-4), ".", color=colour, ms=4)
    line_of = np.array([1e-4, 1])
    for factor, style in ((1, "-"), (0.3, "--"), (3, "--")):
        last.plot(line_of, factor * line_of, style, color="#4d4d4d", lw=0.8)
    last.axvline(JUDGED, color="#4d4d4d", lw=0.8, ls=":")
    last.set(
        xscale="log",
        yscale="log",
        xlabel="true change of a step",
        ylabel="estimated",
        title="estimates (orange: doubted)",
    )
    last.title.set_fontsize(9)
    last.tick_params(labelsize=7)
    for axis in axes[len(judged) + 1 :]:
        axis.set_axis_off()
    made.savefig(png, dpi=120)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    flag = f", flagged: {'; '.join(r['flags'])}" if r["flags"] else ""
    chosen = ", ".join(f"{axis} {level}" for axis, level in r["model"].items())
    judged = [p for p in r["pairs"] if p["true"] > r["tolerance"] and p["how"] != estimates.SOLVED]
    good = sum(0.3 <= (p["effectivity"] or 0) <= 3 for p in judged)
    told = f", {good} of {len(judged)} changes foretold" if judged else ""
    return (
        f"{r['scene']}, {r['tolerance']:.0%}: error {r['error']:.2%} (said {r['estimated_error']:.2%}), "
        f"{r['cost_ratio']:.2f} of {r['rich_s']:.0f} s{told}{flag}; {chosen}"
    )


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
