"""Parameters of relaxing tissue from what a press and hold shows, by data of finer elements, higher order and shorter steps.

A cube of 5 mm glued between two plates that come together by 15 % in 1 s and hold for a minute; an eighth of it is meshed, films
on its planes of symmetry. The glued edges are singular: elements there decide how stiff the cube seems. *Prony terms* and *spring
and dashpot* from the force at 24 times, the modulus unknown too; *two regions*, layers, from eight landmarks and the force at the
end of the ramp and of the hold. Data: third order, .1 mm at the glued edges, 96 steps (`estimate`'s: 24), and noise (of the
rms of each observation). Looked for by `estimate` from a factor of 2 to 3 off, without a prior; of one set of data with 1 % noise
its objective is descended by L-BFGS and Newton-CG too.

`mismatch`: without noise, how far the searching mesh's data at the truth are from the fine one's, rms, the worst observation;
`mismatch_shape`: with the best factor. `error`: the largest of `errors`; `within`: part of the 95 % intervals that hold the
truth; `run_s`: CPU time of a run from rest; `in_runs`: `cpu_s` over it; `jacobians`: all derivatives of a run at once;
`misfit`: over what noise leaves.

    python benchmarks/inversion_relaxing.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/inversion_relaxing.py --chart FILE.png < records.json
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from _command import main
from _front import figure
from _optimisers import COLOURS, OPTIMISERS
from netgen.occ import Box, Glue, OCCGeometry, X, Y, Z

from ngbrain.errors import NgbrainError
from ngbrain.forward import Displacements, Force, Material, Problem, RigidContact, RunModel, SlidingSupport
from ngbrain.inverse import BoundedTransform, OptimisationResult, ParameterEstimate, Transform, Unknown, estimate
from ngbrain.materials import Law, Maxwell, NeoHooke, Prony, Viscous
from ngbrain.surgery import Drive, ToolMotion

Record = dict
Numbers = dict[str, float]
SIDE, BULK, FILM, PENALTY, SOFT = 2.5e-3, 1e6, 1e9, 1e9, 1e-6
PRESS = ToolMotion("press", (0.0, 1.0, 61.0), (0.0, 0.15 * SIDE, 0.15 * SIDE))
POINTS = SIDE * np.random.default_rng(3).uniform(0.15, 0.85, (8, 3))
SEEN = np.concatenate([np.linspace(0.25, 1, 4), 1 + np.geomspace(0.2, 60, 20)])
FINER = np.unique(np.concatenate([SEEN, np.linspace(0, 1, 17)[1:], 1 + np.geomspace(0.05, 60, 61)]))
NOISE, SEEDS = (0.01, 0.02), 5
OTHERS = {name.lower(): search for name, search in OPTIMISERS.items() if name != "Levenberg-Marquardt"}
OURS = "levenberg-marquardt"

LOST = 0.5
"""Largest relative error of a parameter above which a search has failed, whatever it says of itself."""


@dataclass(frozen=True)
class Grid:
    """Size of elements (m) and that at the glued edges, their order, times (s) of steps."""

    name: str
    maxh: float
    edge: float
    order: int = 2
    times: tuple[float, ...] = tuple(SEEN)


DATA = Grid("data", 1.25e-3, 0.1e-3, 3, tuple(FINER))
ROUGH_DATA = Grid("data", 1.25e-3, 0.3e-3, 3, tuple(FINER))
COARSE, FINE = Grid("2.5 mm", 2.5e-3, 2.5e-3), Grid(".15 mm", 1.25e-3, 0.15e-3)


@dataclass(frozen=True)
class Case:
    """What is looked for: tissues of given parameters, truth, start; `heights` of layers, as parts of the cube's half."""

    tissues: Callable[[Mapping[str, ngs.Parameter]], dict[str, Law | Viscous]]
    truth: Numbers
    start: Numbers
    transforms: Mapping[str, Transform]
    heights: tuple[float, ...] = (1.0,)
    seen: tuple[float, ...] = tuple(SEEN)

    @property
    def whole(self) -> bool:
        """Of one tissue, seen by its force alone."""
        return len(self.heights) == 1


PROBLEMS = {
    "Prony terms": Case(
        lambda p: {"tissue": Prony(NeoHooke(p["mu"]), [p["fast"], p["slow"]], [p["tau_fast"], p["tau_slow"]])},
        {"mu": 900.0, "fast": 0.35, "tau_fast": 1.5, "slow": 0.3, "tau_slow": 20.0},
        {"mu": 1500.0, "fast": 0.15, "tau_fast": 4.0, "slow": 0.15, "tau_slow": 50.0},
        {"fast": BoundedTransform(0.0, 0.5), "slow": BoundedTransform(0.0, 0.5)},
    ),
    "spring and dashpot": Case(
        lambda p: {"tissue": Viscous(NeoHooke(p["rest"]), (Maxwell(NeoHooke(p["spring"]), p["eta"]),))},
        {"rest": 300.0, "spring": 700.0, "eta": 4000.0},
        {"rest": 800.0, "spring": 300.0, "eta": 1500.0},
        {},
    ),
    "two regions": Case(
        lambda p: {name: Prony(NeoHooke(mu), [0.5], [5.0]) for name, mu in p.items()},
        {"low": 1200.0, "high": 500.0},
        {"low": 500.0, "high": 1200.0},
        {},
        (0.5, 1.0),
        (1.0, 61.0),
    ),
}


def eighth(names: list[str], heights: tuple[float, ...], grid: Grid) -> ngs.Mesh:
    """Of the cube, layer upon layer from the glued face (`bottom`) to the middle plane (`top`)."""
    layers, low = [], 0.0
    for name, height in zip(names, heights, strict=True):
        layer = Box((0, 0, low), (SIDE, SIDE, height * SIDE))
        layer.mat(name)
        layer.faces.Max(X).name = layer.faces.Max(Y).name = "free"
        layer.faces.Min(X).name, layer.faces.Min(Y).name = "left", "front"
        layers.append(layer)
        low = height * SIDE
    layers[0].faces.Min(Z).name, layers[-1].faces.Max(Z).name = "bottom", "top"
    glued = layers[0].faces.Min(Z).edges
    glued.Max(X).maxh = glued.Max(Y).maxh = grid.edge
    shape = Glue(layers) if len(layers) > 1 else layers[0]
    return ngs.Mesh(OCCGeometry(shape).GenerateMesh(maxh=grid.maxh, grading=0.4))


def model(problem: Case, values: Numbers, grid: Grid) -> RunModel:
    """The run; the plane that presses is that of symmetry."""
    p = {name: ngs.Parameter(value) for name, value in values.items()}
    tissues, drive = problem.tissues(p), Drive(PRESS)
    mesh = eighth(list(tissues), problem.heights, grid)
    plate = RigidContact("top", lambda x: SIDE - drive.parameter - x[2], PENALTY, SOFT)
    films = [SlidingSupport.on(mesh, wall, FILM) for wall in ("left", "front")]
    materials = {name: Material(law, BULK) for name, law in tissues.items()}
    body = Problem(mesh, materials, {"bottom": 0}, contacts=[plate, *films], element=f"P{grid.order}/P{grid.order - 1}")
    observables = [Force("top", (0, 0, 1))] if problem.whole else [Force("top", (0, 0, 1)), Displacements(POINTS)]
    return RunModel(body, drive, np.concatenate([[0.0], grid.times]), p, observables, problem.seen)


class Counts:
    """Of what a model did since `begin`: runs, Jacobians and gradients, and its CPU time."""

    NAMES = ("runs", "jacobians", "gradients")

    def __init__(self, of: RunModel) -> None:
        for name, method in zip(self.NAMES, ("run", "forwards", "backwards"), strict=True):
            setattr(of.replay, method, self._watched(name, getattr(of.replay, method)))
        self.begin()

    def begin(self) -> None:
        """From nothing on."""
        self.of, self.begun = dict.fromkeys(self.NAMES, 0), time.process_time()

    def spent(self, run: float) -> Record:
        """So far, also over the time of a run."""
        cpu_s = time.process_time() - self.begun
        return {"cpu_s": cpu_s, "in_runs": cpu_s / run, **self.of}

    def _watched(self, name: str, method: Callable) -> Callable:
        def called(*arguments: object) -> object:
            self.of[name] += 1
            return method(*arguments)

        return called


def rms(data: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(data**2)))


def mismatch(of: RunModel, truth: Numbers, data: np.ndarray) -> Record:
    """At the truth, without noise."""
    found = of.evaluate(np.array(list(truth.values()))).data
    pairs = [(found[:, part], data[:, part]) for part in of.observation_slices]
    best = [np.sum(a * b) / np.sum(a * a) for a, b in pairs]
    return {
        "mismatch": max(rms(a - b) / rms(b) for a, b in pairs),
        "mismatch_shape": max(rms(s * a - b) / rms(b) for s, (a, b) in zip(best, pairs, strict=True)),
    }


def noisy(of: RunModel, data: np.ndarray, noise: float, seed: int) -> np.ndarray:
    """A part of each observation's rms."""
    made, random = data.copy(), np.random.default_rng(20260101 + seed)
    for part in of.observation_slices:
        made[:, part] += noise * rms(data[:, part]) * random.normal(size=data[:, part].shape)
    return made


def searches(name: str, grid: Grid, data: np.ndarray, noise: float, seed: int, others: bool) -> list[Record]:
    """By `estimate`, and of the same objective by the others."""
    problem = PROBLEMS[name]
    of = model(problem, problem.start, grid)
    begun = time.process_time()
    of.evaluate(of.theta)
    run = time.process_time() - begun
    common = {"problem": name, "grid": grid.name, "noise": noise, "seed": seed, "order": grid.order}
    common |= {"ndof": of.body.fes.ndof, "tetrahedra": of.body.mesh.ne, "steps": len(of.replay.grid) - 1, "run_s": run}
    common |= mismatch(of, problem.truth, data)
    of.evaluate(np.array(list(problem.start.values())))
    measured = noisy(of, data, noise, seed)
    unknowns = {key: Unknown(problem.start[key], transform) for key, transform in problem.transforms.items()}

    def record(method: str, spent: Record, found: OptimisationResult | ParameterEstimate, misfit: float) -> Record:
        values = {key: float(v[0]) for key, v in got.problem.unknowns.values(found.x).items()}
        errors = {key: values[key] / value - 1 for key, value in problem.truth.items()}
        made = {"method": f"ngbrain:{method}", **common, "errors": errors, "error": max(map(abs, errors.values()))}
        made |= {"misfit": misfit, **spent, "converged": found.converged, "reason": ""}
        if method == OURS:
            bands = {key: got.posterior.interval(key) for key in problem.truth}
            ends = {key: [float(np.min(band.low)), float(np.max(band.high))] for key, band in bands.items()}
            inside = [ends[key][0] <= value <= ends[key][1] for key, value in problem.truth.items()]
            made |= {"intervals": ends, "within": sum(inside) / len(inside)}
        print(line(made), file=sys.stderr, flush=True)
        return made

    counts = Counts(of)
    got = estimate(of, measured, noise, unknowns=unknowns)
    made = [record(OURS, counts.spent(run), got, got.misfit)]
    for method, search in OTHERS.items() if others else ():
        counts.begin()
        try:
            found = search(got.problem, got.problem.unknowns.start)
        except NgbrainError as error:
            failed = {"errors": {}, "error": None, "misfit": None, **counts.spent(run)}
            made.append({"method": f"ngbrain:{method}", **common, **failed, "converged": False, "reason": str(error)})
        else:
            made.append(record(method, counts.spent(run), found, found.level.ratio))
    return made


def measure(quick: bool) -> list[Record]:
    """All problems on the coarse mesh, with noises and seeds; on the fine one the first of them."""
    if quick:
        return solved("Prony terms", ROUGH_DATA, {(COARSE, NOISE[0]): 1})
    seeds = {(COARSE, noise): SEEDS for noise in NOISE} | {(FINE, NOISE[0]): 1}
    return [r for name in PROBLEMS for r in solved(name, DATA, seeds)]


def solved(name: str, finest: Grid, seeds: Mapping[tuple[Grid, float], int]) -> list[Record]:
    """One problem, with so many seeds for each mesh and noise; by all optimisers on the coarse mesh."""
    exact = model(PROBLEMS[name], PROBLEMS[name].truth, finest)
    data, records = exact.evaluate(exact.theta).data, []
    for (grid, noise), number in seeds.items():
        for seed in range(number):
            others = grid == COARSE and noise == NOISE[0] and seed == 0
            records += searches(name, grid, data, noise, seed, others)
    return records


SYMBOLS = {"mu": "μ", "fast": "g₁", "tau_fast": "τ₁", "slow": "g₂", "tau_slow": "τ₂"}
SYMBOLS |= {"rest": "μ∞", "spring": "μ₁", "eta": "η", "low": "μ, low", "high": "μ, high"}
LOOKS = {COARSE.name: ("#D55E00", "o", -0.17), FINE.name: ("#0072B2", "s", 0.17)}
METHODS = {name.lower(): colour for name, colour in COLOURS.items()}


def chart(records: list[Record], png: str) -> None:
    """Errors of all seeds by parameter, and what optimisers cost."""
    plt, made, (first, second, third) = figure(14, 4.4, 3, width_ratios=(1.3, 1.0, 0.9))
    ours = [r for r in records if r["method"].endswith(OURS) and r["noise"] == NOISE[0]]
    for axis, names in ((first, list(PROBLEMS)[:1]), (second, list(PROBLEMS)[1:])):
        keys = [(name, key) for name in names for key in PROBLEMS[name].truth]
        for grid, (colour, marker, aside) in LOOKS.items():
            rows = [r for r in ours if r["grid"] == grid]
            dots = [(i, 100 * r["errors"][k]) for i, (n, k) in enumerate(keys) for r in rows if r["problem"] == n]
            x, y = np.array(dots).T
            off = max(r["mismatch"] for r in rows if r["problem"] in names)
            label = f"elements of {grid}, mismatch " + ("up to " if len(names) > 1 else "") + f"{100 * off:.2g} %"
            axis.plot(x + aside, y, marker, color=colour, ms=5, mfc="none", mew=1.3, label=label)
        axis.axhline(0, color="#888888", lw=0.8)
        axis.set_xticks(range(len(keys)), [SYMBOLS[key] for _, key in keys])
        axis.set(ylabel="error (%)", title=" | ".join(names) + ", 1 % noise", xlim=(-0.6, len(keys) - 0.4))
        axis.margins(y=0.3)
        axis.legend(fontsize=8)
    second.axvline(len(PROBLEMS["spring and dashpot"].truth) - 0.5, color="#888888", lw=0.8, ls=":")
    for k, (method, colour) in enumerate(METHODS.items()):
        rows = [next((r for r in records if compared(r, name, method)), None) for name in PROBLEMS]
        for i, r in enumerate(rows):
            if r is None:
                continue
            x = i + 0.17 * (k - 2)
            third.bar(x, r["in_runs"], 0.15, color=colour, label=method if i == 0 else None)
            failed = "not settled" if not r["converged"] else f"{r['error']:.0%} off" if r["error"] > LOST else ""
            text = f"{r['in_runs']:.0f}" + (f"\n{failed}" if failed else "")
            third.text(x, r["in_runs"], text, ha="center", va="bottom", fontsize=6)
    third.set_xticks(range(len(PROBLEMS)), [name.replace(" ", "\n", 1) for name in PROBLEMS])
    third.set(ylabel="CPU time over that of a run", title=f"Cost, elements of {COARSE.name}")
    third.legend(fontsize=8)
    third.margins(y=0.35)
    for axis in (first, second, third):
        axis.grid(axis="y", alpha=0.25)
    made.savefig(png, dpi=150)
    plt.close(made)


def compared(r: Record, problem: str, method: str) -> bool:
    """Whether a record is of the set of data that all optimisers saw."""
    same = r["problem"] == problem and r["grid"] == COARSE.name and r["noise"] == NOISE[0] and r["seed"] == 0
    return same and r["method"].endswith(method)


def line(r: Record) -> str:
    """One record as text."""
    found = ", ".join(f"{name} {100 * error:+.1f} %" for name, error in r["errors"].items()) or r["reason"]
    where = f"{r['problem']}, {r['grid']} ({100 * r['mismatch']:.2f} % off), {r['noise']:.0%}, seed {r['seed']}"
    spent = f"{r['runs']} runs, {r['jacobians']} Jacobians, {r['gradients']} gradients, {r['cpu_s']:.1f} s"
    return f"{where}, {r['method']}: {found}; {spent}, {r['in_runs']:.0f} runs' time"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
