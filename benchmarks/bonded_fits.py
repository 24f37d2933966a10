"""Constants of brain tissue from cubes glued to plates: full-field fits against fits that assume homogeneous deformation.

known    a cube of 5 mm of a one-term Ogden law (1442 Pa, -19.2), pressed and pulled by a tenth and sheared by a fifth; 11 points of
         each curve by elements of fourth order (1.25 mm), with noise of 0, 1 and 2 % of each curve's peak, ten seeds. Fitted with
         homogeneous specimens and with cubes of several meshes and orders. `error` is the larger of the relative errors of μ and
         α; of seeds the median, with the worst beside it
search   the same, coarse, without noise, from half of both constants, by three optimisers with the same derivatives: `sets` of
         equilibria of all cubes, `solves` with all their tangents
measured Budday's mean curves of four regions: constants and R² of both, `error` between one mesh and the next finer one

    python benchmarks/bonded_fits.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/bonded_fits.py --chart FILE.png < records.json
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from _command import main
from _front import figure
from scipy.optimize import minimize

from ngbrain.inverse import BondedFit, BondedSpecimen
from ngbrain.materials import Ogden, lab

Record = dict
TRUTH = {"mu": 1442.0, "alpha": -19.2}
GUESS = {"mu": 721.0, "alpha": -9.6}
TESTS = {"compression": ("uniaxial", 1.0, 0.9), "tension": ("uniaxial", 1.0, 1.1), "shear": ("shear", 0.0, 0.2)}
HOMOGENEOUS = "homogeneous"
MESHES = {
    "ngbrain:P2/P1": (("P2/P1", 0.0025), ("P2/P1", 0.00167), ("P2/P1", 0.00125)),
    "ngbrain:P3/P2": (("P3/P2", 0.0025), ("P3/P2", 0.00167)),
}
NOISY = ("P3/P2", 0.0025)
REGIONS = ("cortex", "corona_radiata", "basal_ganglia", "corpus_callosum")


def cube(form: str, maxh: float) -> BondedSpecimen:
    """A cube of 5 mm."""
    return BondedSpecimen(form=form, maxh=maxh)


def exact(quick: bool) -> list[lab.Curve]:
    """The known tissue's curves."""
    finest, curves = cube("P4/P3", 0.0025 if quick else 0.00125), []
    for name, (mode, rest, far) in TESTS.items():
        where = np.linspace(rest, far, 11)
        curves.append(lab.Curve(mode, where, finest.stress(Ogden(**TRUTH), mode, where), name))
    return curves


def noisy(curves: list[lab.Curve], noise: float, seed: int) -> list[lab.Curve]:
    """Curves with noise relative to each peak."""
    random = np.random.default_rng(seed)
    sigmas = [noise * np.abs(c.stress).max() for c in curves]
    return [
        lab.Curve(c.mode, c.stretches, c.stress + sigma * random.normal(size=len(c.stress)), c.name)
        for c, sigma in zip(curves, sigmas, strict=True)
    ]


def off(parameters: dict[str, float]) -> float:
    """The larger relative error."""
    return max(abs(parameters[name] / TRUTH[name] - 1) for name in TRUTH)


def fitted(case: str, method: str, fit: Callable[[], lab.Fit], **more: Any) -> Record:
    """A fit as a record."""
    begun = time.process_time()
    found = fit()
    made = {"case": case, "method": method, "ndof": None, "cpu_s": time.process_time() - begun, "converged": True}
    known = {name: list(ends) for name, ends in found.confidence.items()}
    return made | {"parameters": found.parameters, "confidence": known, "r2": found.r2, **more}


def known(quick: bool) -> list[Record]:
    """Records without noise for all meshes, with noise for one."""
    curves, records = exact(quick), []

    def of(method: str, fit: Callable[[], lab.Fit], **more: Any) -> None:
        made = fitted("known", method, fit, **more)
        records.append(made | {"error": off(made["parameters"])})
        print(line(records[-1]), file=sys.stderr, flush=True)

    for noise in (0.0,) if quick else (0.0, 0.01, 0.02):
        for seed in range(10 if noise else 1):
            data = noisy(curves, noise, seed)
            start = lab.fit(Ogden, data, GUESS, starts=1).parameters
            told: dict[str, Any] = {"noise": noise, "seed": seed, "order": 0, "maxh": None}
            of(HOMOGENEOUS, lambda data=data: lab.fit(Ogden, data, GUESS, starts=1), **told)
            for method, meshes in MESHES.items():
                for form, maxh in meshes[: 1 if quick else None]:
                    if noise and (form, maxh) != NOISY:
                        continue
                    told |= {"order": int(form[1]), "maxh": maxh}
                    fit = cube(form, maxh).fit
                    of(method, lambda fit=fit, data=data, start=start: fit(Ogden, data, start), **told)
    return records


SEARCHES = ("Levenberg-Marquardt", "Newton-CG", "L-BFGS-B")


def searches(quick: bool) -> list[Record]:
    """Three optimisers on one problem."""
    curves, records = exact(quick), []
    scale = np.array(list(GUESS.values()))
    for method in SEARCHES:
        problem = BondedFit(cube("P2/P1", 0.0025), Ogden, curves, GUESS, {}, {})
        solves = problem.model.solves

        def value(x: np.ndarray, problem: BondedFit = problem) -> float:
            return 0.5 * float(np.sum(problem.misfits(scale * x) ** 2))

        def gradient(x: np.ndarray, problem: BondedFit = problem) -> np.ndarray:
            return scale * (problem.gradient(scale * x).T @ problem.misfits(scale * x))

        def product(x: np.ndarray, p: np.ndarray, problem: BondedFit = problem) -> np.ndarray:
            slope = problem.gradient(scale * x) * scale
            return slope.T @ (slope @ p)

        begun = time.process_time()
        if method == "Levenberg-Marquardt":
            found = problem.best(1, 0).parameters
        else:
            more = {"hessp": product} if method == "Newton-CG" else {}
            ended = minimize(value, np.ones(2), jac=gradient, method=method, **more)
            found = problem.parameter_values(scale * ended.x)
        bodies = len(problem.model.equilibria)
        records.append(
            {
                "case": "search",
                "method": f"ngbrain:{method}",
                "order": 2,
                "ndof": problem.model.equilibria[0].body.fes.ndof,
                "cpu_s": time.process_time() - begun,
                "sets": solves.forward / bodies,
                "solves": solves.incremental / bodies,
                "parameters": found,
                "error": off(found),
                "converged": True,
            }
        )
        print(line(records[-1]), file=sys.stderr, flush=True)
    return records


def measured(quick: bool) -> list[Record]:
    """Records of Budday's regions."""
    records = []
    for region in REGIONS[: 1 if quick else None]:
        data = lab.budday(region)
        homogeneous = fitted("measured", HOMOGENEOUS, lambda data=data: lab.fit(Ogden, data, GUESS), region=region)
        records.append(homogeneous | {"order": 0, "error": None})
        start, before = homogeneous["parameters"], None
        for form, maxh in (("P3/P2", 0.0025),) if quick else (("P3/P2", 0.0025), ("P3/P2", 0.00167)):
            fit = cube(form, maxh).fit
            made = fitted(
                "measured",
                f"ngbrain:{form}",
                lambda fit=fit, data=data, start=start: fit(Ogden, data, start),
                region=region,
                maxh=maxh,
            )
            now = made["parameters"]
            moved = None if before is None else max(abs(now[name] / before[name] - 1) for name in now)
            records.append(made | {"order": int(form[1]), "error": moved})
            before = start = now
        print(*map(line, records[-3:]), sep="\n", file=sys.stderr, flush=True)
    return records


def measure(quick: bool) -> list[Record]:
    """All records."""
    return known(quick) + searches(quick) + measured(quick)


def chart(records: list[Record], png: str) -> None:
    """Error over time without noise; error with noise; the constants of the regions."""
    plt, made, (front, noise, regions) = figure(14, 4.4, 3)
    mine = [r for r in records if r["case"] == "known"]
    colours = dict(zip((HOMOGENEOUS, *MESHES), ("#4d4d4d", "#0072B2", "#D55E00"), strict=True))
    for method, colour in colours.items():
        points = [(r["cpu_s"], 100 * r["error"]) for r in mine if r["method"] == method and not r["noise"]]
        front.plot(*zip(*points, strict=True), "o-", color=colour, label=method)
        same = [r for r in mine if r["method"] == method and r["maxh"] in (None, NOISY[1])]
        levels = sorted({r["noise"] for r in same})
        all_of = [[100 * r["error"] for r in same if r["noise"] == n] for n in levels]
        if len(levels) > 1:
            middle = [np.median(e) for e in all_of]
            noise.plot([100 * n for n in levels], middle, "o-", color=colour, label=f"{method}, median")
            noise.plot([100 * n for n in levels], [max(e) for e in all_of], "v:", color=colour, label="worst of ten")
    front.set(xscale="log", yscale="log", xlabel="CPU time (s)", ylabel="error of the worse constant, %")
    front.set(title="known tissue, no noise")
    noise.set(
        yscale="log",
        xlabel="noise, % of each peak",
        ylabel="error of the worse constant, %",
        title=f"with noise, {NOISY[0]} of {1e3 * NOISY[1]:g} mm",
    )
    for k, (name, unit, factor) in enumerate((("mu", "μ (kPa)", 1e-3), ("alpha", "α / -10", -0.1))):
        for method, shift, colour in ((HOMOGENEOUS, -0.2, "#4d4d4d"), ("ngbrain:P3/P2", 0.2, "#D55E00")):
            last = {r["region"]: r for r in records if r["case"] == "measured" and r["method"] == method}
            where = np.arange(len(last)) + shift
            heights = [factor * r["parameters"][name] for r in last.values()]
            spans = [abs(factor * np.diff(r["confidence"][name])[0]) / 2 for r in last.values()]
            marker = "os"[k]
            label = f"{unit}, {method.removeprefix('ngbrain:')}"
            regions.errorbar(
                where + 0.08 * k,
                heights,
                spans,
                fmt=marker,
                color=colour,
                label=label,
                capsize=2,
                mfc="none" if k else colour,
            )
    names = [r["region"].replace("_", "\n") for r in records if r["case"] == "measured" and r["method"] == HOMOGENEOUS]
    regions.set_xticks(range(len(names)), names, fontsize=8)
    regions.set(title="human brain, measured curves; 95 % intervals", ylim=(0, 3.6))
    for axis in (front, noise):
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter("{x:g}")
    for axis in (front, noise, regions):
        axis.legend(fontsize=7, frameon=False)
        axis.grid(alpha=0.25)
    made.savefig(png, dpi=150)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    where = r.get("region") or (f"noise {r['noise']:.0%} seed {r['seed']}" if "noise" in r else "")
    mesh = f" {1e3 * r['maxh']:.2f} mm" if r.get("maxh") else ""
    numbers = ", ".join(f"{name} {value:.4g}" for name, value in r["parameters"].items())
    fits = " R² " + " ".join(f"{value:.3f}" for value in r["r2"].values()) if "r2" in r else ""
    error = "" if r["error"] is None else f", off {r['error']:.2%}"
    sets = f", {r['sets']:.0f} sets of equilibria, {r['solves']:.0f} of solves" if "sets" in r else ""
    return f"{r['case']:9} {r['method']:20}{mesh} {where}: {numbers}{error}{fits}{sets}; {r['cpu_s']:.1f} s"


if __name__ == "__main__":
    main(__doc__ or "", measure, chart, line)
