"""Coverage of intervals at large strain and in viscoelastic tissue.

*large strain*: a square of Ogden's tissue, ln μ a Gaussian field and α a number, pressed by 15 % and sheared by 20 %; displacements
of 64 points and the plate's force. *relaxing*: a block that a plate presses in 4 s and holds, its force at the end of each step;
μ, g and τ are numbers. Truths of the field are drawn from what is assumed of it, numbers stay, and searches begin with them .3 off
(in ln, or of their size); each repetition has noise of its own. Data and inversion share mesh and elements, so that noise is
all there is to be uncertain of. Then a level of p has to cover p of all nodes and numbers of all repetitions. Rival: values plus
or minus so many standard deviations, where intervals are of logarithms. `refused`: repetitions whose data leave a number open,
which is said. `error` is |coverage - .95| at 95 %; CPU time of one thread for a repetition.

    python benchmarks/uncertainty_models.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/uncertainty_models.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import ngsolve as ngs
import numpy as np
from _command import main, sweep
from _coverage import chart as coverage_chart
from _coverage import coverage, told
from ngsolve.meshes import MakeStructured2DMesh

from ngbrain import parallel
from ngbrain.adjoint import Reduced
from ngbrain.errors import InputError, SolverError
from ngbrain.forward import Displacements, Force, LoadCase, Material, Problem, RigidContact, RunModel, StaticModel
from ngbrain.inverse import (
    FixedWeights,
    LeastSquares,
    LogTransform,
    Metric,
    ParameterFields,
    Posterior,
    ScaledTransform,
    Unknown,
    levenberg_marquardt,
    matern,
)
from ngbrain.materials import NeoHooke, Ogden, Prony
from ngbrain.mesh import block
from ngbrain.surgery import Drive, ToolMotion

Record = dict
Model = StaticModel | RunModel
SIDE, CELLS = 0.1, 6
WEIGHT, LENGTH = 2.0, 0.03
"""ln μ deviates by about .3, over bumps of 3 cm."""
MU, ALPHA = 1e3, -8.0
AWAY = 0.3
"""Distance of the initial guess of numbers from the truth, in ln or relative."""
NOISES = (0.01, 0.05, 0.2)
OURS, NAIVE = "ngbrain:posterior", "naive ± in units"


def large_strain() -> tuple[StaticModel, dict[str, Unknown]]:
    """The square under both loads, and the initial guess."""
    mesh = MakeStructured2DMesh(False, CELLS, CELLS, mapping=lambda x, y: (SIDE * x, SIDE * y))
    mu, alpha = ngs.GridFunction(ngs.H1(mesh, order=1)), ngs.Parameter(ALPHA)
    mu.Set(MU)
    line = (np.arange(8) + 0.5) * SIDE / 8
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    cases = []
    for top in ((0.0, -0.15 * SIDE), (0.2 * SIDE, 0.0)):
        body = Problem(mesh, {".*": Material(Ogden(mu, alpha), 5e4)}, {"bottom": 0, "top": top}, element="P2/P1")
        cases.append(LoadCase(body, [Displacements(points), Force("top")]))
    unknowns = {
        "mu": Unknown(mu.vec.FV().NumPy().copy(), LogTransform()),
        "alpha": Unknown(ALPHA, ScaledTransform(-ALPHA)),
    }
    return StaticModel(cases, {"mu": mu, "alpha": alpha}), unknowns


def relaxing() -> tuple[RunModel, dict[str, Unknown]]:
    """The block under its plate, and the initial guess."""
    drive, side = Drive(ToolMotion("hold", (0.0, 4.0, 40.0), (0.0, 2e-3, 2e-3))), 0.02
    p = {"mu": ngs.Parameter(MU), "g": ngs.Parameter(0.5), "tau": ngs.Parameter(3.0)}
    tissue = Material(Prony(NeoHooke(p["mu"]), [p["g"]], [p["tau"]]), 1e6)
    plate = RigidContact("top", lambda x: side - drive.parameter - x[2], 1e8, 2e-5)
    body = Problem(block((side,) * 3, side), {"tissue": tissue}, {"bottom": 0}, contacts=[plate], element="P2/P1")
    times = np.concatenate([np.linspace(0, 4, 6), 4 + np.geomspace(0.5, 36, 9)])
    return RunModel(body, drive, times, p, [Force("top", (0, 0, 1))]), {
        name: Unknown(q.Get(), LogTransform()) for name, q in p.items()
    }


CASES: dict[str, Callable[[], tuple[Model, dict[str, Unknown]]]] = {"large strain": large_strain, "relaxing": relaxing}


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """Two records for each case and noise."""
    number, noises = (6, NOISES[:1]) if quick else (200, NOISES)
    every = {f"{case}, noise {noise:g}": (case, noise, number) for case in CASES for noise in noises}
    return [r for found in sweep(listed, every, executor) for r in found]


def listed(case: str, noise: float, number: int) -> list[Record]:
    """Records of a case."""
    return list(records(case, noise, number))


def records(case: str, noise: float, number: int) -> Iterator[Record]:
    """Coverage over a number of repetitions, for our intervals and the alternative."""
    model, unknowns = CASES[case]()
    fields = ParameterFields(model.theta, model.blocks, unknowns)
    held = {}
    if case == "large strain":
        space = model.parts["mu"].gfu.space
        held = {"mu": matern(space, fields.start[fields.blocks["mu"]], LENGTH)}
    begun_at = fields.start.copy()  # numbers away from the truth: a search that began there would hardly leave it
    for name in set(fields.blocks) - set(held):
        begun_at[fields.blocks[name]] += AWAY
    off, slopes, deviations, refused, settled, begun = [], [], [], 0, True, time.process_time()
    for seed in range(number):
        random = np.random.default_rng((seed, 5))
        truth = fields.start.copy()
        for name, regulariser in held.items():
            block_ = fields.blocks[name]
            drawn = Metric(WEIGHT * regulariser.matrix(truth[block_])).unwhiten(
                random.normal(size=block_.stop - block_.start)
            )
            truth[block_] += drawn
        data = model.evaluate(fields.theta(truth)).data
        sigma = np.empty(data.shape)
        for where in model.observation_slices:
            sigma[..., where] = noise * np.sqrt(np.mean(data[..., where] ** 2))
        misfit = LeastSquares(data + sigma * random.normal(size=data.shape), sigma)
        reduced = Reduced(model, misfit, fields, held, dict.fromkeys(held, WEIGHT))
        try:
            found = levenberg_marquardt(reduced, begun_at, FixedWeights())
            posterior = Posterior(reduced.evaluate(found.x), min_eigenvalue=0.0)
        except (InputError, SolverError):  # data of this noise leave a number open, which is said
            refused += 1
            continue
        for name, block_ in fields.blocks.items():
            off.append(truth[block_] - found.x[block_])
            deviations.append(posterior.deviation(name))
            slopes.append(np.full(len(off[-1]), isinstance(unknowns[name].transform, LogTransform)))
        settled &= found.converged
    spent = (time.process_time() - begun) / number
    z, deviation, log = (np.concatenate(each) for each in (off, deviations, slopes))
    for method, score in ((OURS, z / deviation), (NAIVE, np.where(log, np.expm1(z), z) / deviation)):
        yield {
            "method": method,
            "case": case,
            "order": 2,
            "ndof": model.size,
            "cpu_s": spent,
            "converged": settled,
            "noise": noise,
            "repetitions": number,
            "refused": refused,
            "numbers": len(score),
        } | coverage(score)


def chart(records: list[Record], png: str) -> None:
    """A panel for each case and noise."""
    coverage_chart(records, png, lambda r: f"{r['case']}, {100 * r['noise']:g} % noise", "numbers", 3.0)


def line(r: Record) -> str:
    """One record as text."""
    which = f"{r['case']:<13} {r['method']:<18} {100 * r['noise']:>3g} % noise, {r['repetitions']} times"
    return f"{which}: {told(r)}, {r['cpu_s']:.2f} s"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
