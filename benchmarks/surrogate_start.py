"""The trained operator as initial guess of an inversion: Gauss-Newton from its map, and from a uniform field.

Waves of test samples with 1 % noise, every second of the operator's 51 × 51 points, in elements of the inversion's own; smooth
fields, weights by the evidence. Error of the first modulus and solves (factors of the waves and of the steps) after every round.
`error` is that after the last round; `solves_to` the solves until the error is within a tenth of the lesser of the two ends'.

    python benchmarks/surrogate_start.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/surrogate_start.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import product
from statistics import median

import numpy as np
from _command import main, sweep
from _front import figure
from surrogate_error import ACROSS, measured

from ngbrain import parallel
from ngbrain.adjoint import Reduced
from ngbrain.errors import SolverError
from ngbrain.inverse import (
    ElastographyProblem,
    GaussNewton,
    LeastSquares,
    discretise,
    elastography,
    noise_deviation,
    smooth,
    unknowns_from_maps,
)
from ngbrain.io import WaveData
from ngbrain.surrogate import predict

Record = dict
FAMILIES, SAMPLES, NOISE = ("gaussian_width", "sinc", "inclusions", "tumour"), 3, 0.01
ROUNDS, NEAR = 10, 1.1
COLOURS = {"surrogate": "#0072B2", "uniform": "#E69F00"}


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """Two records for each sample."""
    samples = product(FAMILIES[:1], range(1)) if quick else product(FAMILIES, range(SAMPLES))
    every = {f"{family} {index}": (family, index) for family, index in samples}
    return [r for found in sweep(rows, every, executor) for r in found]


def rows(family: str, index: int) -> list[Record]:
    """Records of both initial guesses of a sample."""
    data = measured("waves", family, index, NOISE)
    maps = predict(data).maps
    few = np.arange(len(data.points)).reshape(ACROSS, ACROSS)[::2, ::2].ravel()
    picked = {"points": data.points[few], "displacement": data.displacement[:, few], "mask": None, "dirichlet": None}
    data = replace(data, **picked, truth={name: values[few] for name, values in data.truth.items()})
    maps = {name: values[few] for name, values in maps.items()}
    if "loss" in maps:  # logarithms are looked for
        maps["loss"] = np.maximum(maps["loss"], 0.01 * maps["storage"])
    records = [way(data, start, maps) | {"family": family, "sample": index} for start in COLOURS]
    best = NEAR * min(r["error"] for r in records)
    for r in records:
        r["solves_to"] = next((n for n, error in zip(r["solves"], r["errors"], strict=True) if error <= best), None)
        r["converged"] = r["solves_to"] is not None
    return records


def way(data: WaveData, start: str, maps: dict[str, np.ndarray]) -> Record:
    """Errors by iteration from one initial guess."""
    begun = time.process_time()
    experiment = ElastographyProblem(data, discretise(data))
    sigma = noise_deviation(data, NOISE)
    unknowns = experiment.unknowns(sigma)
    names = [name for name in unknowns.blocks if name != "boundary"]
    x = unknowns_from_maps(experiment, unknowns, maps) if start == "surrogate" else experiment.uniform(unknowns, 1.0)
    regularisers = {name: smooth(experiment.space, unknowns.start[unknowns.blocks[name]]) for name in names}
    weights = dict.fromkeys(names, elastography.invert.FIRST if start == "surrogate" else elastography.invert.FAR)
    problem = Reduced(experiment.model, LeastSquares(experiment.measured, sigma), unknowns, regularisers, weights)

    def error() -> float:
        name, truth = next(iter(data.truth_views.items()))
        found = experiment.maps(unknowns, x)[name]
        return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))

    solves, errors = [0], [error()]
    for _ in range(ROUNDS):
        try:
            x = GaussNewton(problem).descend(x, 1).x
        except SolverError:
            break
        solves.append(experiment.model.solves.factorisations)
        errors.append(error())
    made: Record = {"method": f"ngbrain:GN from {start}", "order": 3, "ndof": experiment.body.fes.ndof, "start": start}
    return made | {"solves": solves, "errors": errors, "error": errors[-1], "cpu_s": time.process_time() - begun}


def chart(records: list[Record], png: str) -> None:
    """Error over solves from both starts, family by family."""
    families = list(dict.fromkeys(r["family"] for r in records))
    plt, made, axes = figure(3.2 * len(families), 3.6, len(families), squeeze=False, sharey=True)
    for panel, family in zip(axes[0], families, strict=True):
        for r in records:
            if r["family"] == family:
                style = "-" if r["converged"] else ":"
                panel.plot(
                    r["solves"], [100 * e for e in r["errors"]], style, marker=".", color=COLOURS[r["start"]], lw=1.4
                )
        panel.set(title=family, xlabel="factorisations", yscale="log")
        panel.grid(True, which="both", alpha=0.25)
    axes[0][0].set_ylabel("relative error, %")
    for start, colour in COLOURS.items():
        axes[0][0].plot(
            [], [], "-", color=colour, label=f"from {'the operator' if start == 'surrogate' else 'a uniform field'}"
        )
    axes[0][0].plot([], [], "k:", label="never near the better end")
    axes[0][0].legend(fontsize=7)
    made.savefig(png, dpi=130)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    first, last = 100 * r["errors"][0], 100 * r["errors"][-1]
    text = f"{r['family']} {r['sample']} from {r['start']:<9} {first:.1f} to {last:.2f} %"
    return f"{text}, {r['solves_to']} solves, {r['cpu_s']:.0f} s"


def ratio(records: list[Record]) -> tuple[float, int]:
    """Median ratio of solves (operator's to uniform start) where both converge, and how often only the uniform start does not."""
    pairs = list(zip(records[::2], records[1::2], strict=True))
    both = [a["solves_to"] / max(b["solves_to"], 1) for a, b in pairs if a["converged"] and b["converged"]]
    return median(both), sum(a["converged"] and not b["converged"] for a, b in pairs)


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
