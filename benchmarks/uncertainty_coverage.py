"""Do intervals hold the truth as often as they say? Truths drawn from what is assumed of them, each measured and inverted once.

A viscoelastic square at 50 Hz (CV-G of `ngbrain.inverse.phantoms.benchmark`), its ln storage and ln loss Gaussian fields,
noise on every
point, boundary included; data and inversion share mesh and elements, so that noise is all there is to be uncertain of. Then a
level of p has to cover p of all nodes of all repetitions. Rivals: moduli plus or minus so many standard deviations, in Pa; the
boundary's displacements taken as exact, as published inversions do. Weights of regularisers are those that the truth was drawn
with, but for one method, which finds them by the evidence. `error` is |coverage - .95| at 95 %; `negative` is the share of lower
ends below zero; CPU time of one thread for a repetition: `cpu_s` all of it, `bars_s` after the inversion.

    python benchmarks/uncertainty_coverage.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/uncertainty_coverage.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from _command import main, sweep
from _coverage import chart as coverage_chart
from _coverage import coverage, told
from scipy.special import ndtri

from ngbrain import parallel
from ngbrain.adjoint import Reduced
from ngbrain.inverse import (
    Evidence,
    FixedWeights,
    GaussNewton,
    ParameterFields,
    Phantom,
    PhantomInversion,
    Posterior,
    WeightPolicy,
    draw_phantom,
    matern,
)

Record = dict
NODES, WEIGHT, LENGTH = 9, 2.0, 0.03
"""Fields deviate by about .3 in ln, over bumps of 3 cm in a square of 12."""
NOISES = (0.01, 0.05, 0.2)
FIELDS = ("storage", "loss")


def prior(space, x):  # type: ignore[no-untyped-def]
    """What truths are drawn from."""
    return matern(space, x, LENGTH)


def as_it_is(inversion: PhantomInversion) -> Reduced:
    """With the boundary unknown."""
    return inversion.reduced


def exact_boundary(inversion: PhantomInversion) -> Reduced:
    """With the boundary as measured."""
    reduced = inversion.reduced
    unknowns = {name: reduced.unknowns.unknowns[name] for name in FIELDS}
    fields = ParameterFields(reduced.unknowns.theta(inversion.start), inversion.model.blocks, unknowns)
    return Reduced(reduced.model, reduced.misfit, fields, reduced.regularisers, reduced.weights)


def of_logarithms(off: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """How many deviations the truth is off: intervals are transformed."""
    return off / deviation


def of_moduli(off: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """The same in Pa, slope times deviation."""
    return np.expm1(off) / deviation


METHODS: dict[str, tuple[Callable, type[WeightPolicy], Callable]] = {
    "ngbrain:posterior": (as_it_is, FixedWeights, of_logarithms),
    "ngbrain:posterior, weights found": (as_it_is, Evidence, of_logarithms),
    "naive ± in Pa": (as_it_is, FixedWeights, of_moduli),
    "naive exact boundary": (exact_boundary, FixedWeights, of_logarithms),
}


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """One record for each method and noise."""
    number, noises = (12, NOISES[1:2]) if quick else (120, NOISES)
    every = {f"{method}, noise {noise:g}": (method, noise, number) for noise in noises for method in METHODS}
    return sweep(record, every, executor)


def record(method: str, noise: float, number: int) -> Record:
    """Coverage over so many truths and their noise."""
    problem, policy, score = METHODS[method]
    scores, below, after, begun, settled = [], [], 0.0, time.process_time(), True
    for seed in range(number):
        measured = draw_phantom(Phantom.from_name("CV-G", NODES), prior, WEIGHT, seed).simulate_measurements(
            noise, seed
        )
        reduced = problem(measured.inversion(prior, WEIGHT))
        found = GaussNewton(reduced, policy()).descend(reduced.unknowns.start)
        arrived = time.process_time()
        posterior = Posterior(reduced.evaluate(found.x))
        for name in FIELDS:
            deviation = posterior.deviation(name)
            off = np.log(measured.truth[name]) - found.x[posterior.blocks[name]]
            scores.append(score(off, deviation))
            below.append(deviation * ndtri(0.975) > 1 if score is of_moduli else np.zeros(len(off), bool))
        after += time.process_time() - arrived
        settled &= found.converged
    return {
        "method": method,
        "order": 1,
        "ndof": len(FIELDS) * NODES**2,
        "cpu_s": (time.process_time() - begun) / number,
        "converged": settled,
        "bars_s": after / number,
        "noise": noise,
        "repetitions": number,
        "negative": float(np.mean(below)),
    } | coverage(np.array(scores))


def chart(records: list[Record], png: str) -> None:
    """A panel for each noise."""
    ordered = sorted(records, key=lambda r: r["noise"])
    coverage_chart(ordered, png, lambda r: f"{100 * r['noise']:g} % noise", "nodes", 4.0)


def line(r: Record) -> str:
    """One record as text."""
    return f"{r['method']:<34} {100 * r['noise']:>3g} % noise, {r['repetitions']} times: {told(r)}, {r['cpu_s']:.2f} s"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
