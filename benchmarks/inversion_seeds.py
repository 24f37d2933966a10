"""Noise seeds: Gauss-Newton from measured waves, from uniform fields, and from one after the other.

Published cases (`ngbrain.inverse.phantoms.benchmark`) in their own discretisation, noise on every point, boundary included;
smooth fields,
weights by the evidence. `waves` is the convex start alone, `uniform` descends from the published uniform start (no longer than
`invert` lets it), `both` descends from where `waves` ends. A descent that finds no way down counts as it began. `error` is that
of the first field, all are in `errors`; CPU time of one thread, that of `both` without its start.

    python benchmarks/inversion_seeds.py [--quick] [--json] [--executor WHO]      last line of --json: a list of records
    python benchmarks/inversion_seeds.py --chart FILE.png < records.json
    python benchmarks/inversion_seeds.py --table < records.json      median (worst) of the seeds, %
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from statistics import median

import numpy as np
from _command import main, sweep
from _front import figure

from ngbrain import parallel
from ngbrain.errors import NgbrainError
from ngbrain.inverse import GaussNewton, OptimisationResult, Phantom, elastography

Record = dict
SEEDS = 10
CASES = tuple((case, noise) for case in ("CV-G", "NE-G", "CE-B") for noise in (0.01, 0.02, 0.05))
BOUNDS = {
    ("CV-G", 0.01): {"storage": 0.015, "loss": 0.07},
    ("NE-G", 0.01): {"youngs": 0.03},
    ("CE-B", 0.01): {"youngs": 0.06},
}
"""The required bound of the error."""
COLOURS = {"waves": "#0072B2", "uniform": "#E69F00", "both": "#009E73"}
SYMBOLS = {"youngs": "E", "storage": "G′", "loss": "G″"}


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """Three records for each case, noise level and seed."""
    cases, seeds, nodes = (CASES[:1], 2, 17) if quick else (CASES, SEEDS, None)
    draws = {
        f"{name}, noise {noise:g}, seed {seed}": (name, noise, seed, nodes)
        for name, noise in cases
        for seed in range(seeds)
    }
    return [record for found in sweep(rows, draws, executor) for record in found]


def rows(name: str, noise: float, seed: int, nodes: int | None) -> list[Record]:
    """The three starts of one set of data."""
    measured = Phantom.from_name(name, nodes).simulate_measurements(noise, seed)

    def record(
        start: str, search: Callable[[GaussNewton], OptimisationResult], begin: np.ndarray | None = None
    ) -> tuple:
        inversion = measured.inversion()
        begun, x = time.process_time(), inversion.start if begin is None else begin
        made: Record = {"method": "ngbrain:GN", "order": 1, "ndof": inversion.model.body.fes.ndof, "case": name}
        made |= {"noise": noise, "seed": seed, "start": start, "converged": False}
        try:
            found = search(GaussNewton(inversion.reduced))
        except NgbrainError as error:
            made |= {"reason": str(error)}
        else:
            x = found.x
            made |= {"converged": found.converged, "rounds": len(found.history), "misfit": found.level.ratio}
        errors = inversion.errors(x)
        made |= {"errors": errors, "error": next(iter(errors.values())), "cpu_s": time.process_time() - begun}
        return made, x

    begin, waves = (inversion := measured.inversion()).start, inversion.waves
    first, x = record("waves", lambda search: search.from_waves(begin, waves))
    third, _ = record("both", lambda search: search.descend(x), x)
    second, _ = record("uniform", lambda search: search.descend(begin, elastography.invert.SHORT))
    return [first, second, third]


def spread(records: list[Record], field: str) -> tuple[float, float]:
    """Median and worst error."""
    errors = [r["errors"][field] for r in records]
    return median(errors), max(errors)


def groups(records: list[Record]) -> dict[tuple[str, float], dict[str, list[Record]]]:
    """Case and noise → start → its records."""
    found: dict[tuple[str, float], dict[str, list[Record]]] = {}
    for r in records:
        found.setdefault((r["case"], r["noise"]), {}).setdefault(r["start"], []).append(r)
    return found


def chart(records: list[Record], png: str) -> None:
    """Every seed's error, the median, and the required bound."""
    columns = [
        (case, field, starts)
        for case, starts in groups(records).items()
        for field in next(iter(starts.values()))[0]["errors"]
    ]
    plt, made, axes = figure(9.5, 5)
    for i, (case, field, starts) in enumerate(columns):
        for k, (start, rows) in enumerate(starts.items()):
            at = i + 0.24 * (k - 1)
            errors = 100 * np.array([r["errors"][field] for r in rows])
            axes.plot(at + np.linspace(-0.07, 0.07, len(errors)), errors, ".", color=COLOURS[start], ms=5)
            axes.plot([at - 0.1, at + 0.1], [np.median(errors)] * 2, "-", color=COLOURS[start], lw=2.5)
        if bound := BOUNDS.get(case, {}).get(field):
            axes.plot([i - 0.42, i + 0.42], [100 * bound] * 2, "--", color="#b22222", lw=1.2)
    for start, text in (("waves", "measured waves alone"), ("uniform", "uniform start"), ("both", "both")):
        axes.plot([], [], ".-", color=COLOURS[start], label=text)
    axes.plot([], [], "--", color="#b22222", label="asked for")
    names = [f"{case} {SYMBOLS[field]}\n{100 * noise:g} %" for (case, noise), field, _ in columns]
    axes.set_xticks(range(len(columns)), names)
    axes.set(yscale="log", ylabel="relative error, %")
    axes.set_title("Ten seeds of noise: every one, and their median")
    axes.grid(True, axis="y", alpha=0.3)
    made.legend(loc="outside lower center", ncols=4)
    made.savefig(png, dpi=130)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    errors = ", ".join(f"{name} {100 * value:.3g} %" for name, value in r["errors"].items())
    return f"{r['case']} {100 * r['noise']:g} % seed {r['seed']} {r['start']:<8} {errors}, {r['cpu_s']:.1f} s"


def summary(records: list[Record]) -> str:
    """Median and worst of all seeds, with CPU time, as the rows of a table."""
    lines = []
    for (case, noise), starts in groups(records).items():
        for start, rows in starts.items():
            texts = []
            for field in rows[0]["errors"]:
                middle, worst = spread(rows, field)
                texts.append(f"{SYMBOLS[field]} {100 * middle:.2g} ({100 * worst:.2g})")
            cpu = median(r["cpu_s"] for r in rows)
            lines.append(f"| {case}, {100 * noise:g} % | {start} | {len(rows)} | {', '.join(texts)} | {cpu:.0f} s |")
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1:] == ["--table"]:
        print(summary(json.loads(sys.stdin.read())))
    else:
        main(__doc__, measure, chart, line)
