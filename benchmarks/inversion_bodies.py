"""Inversions of all eight models in elements of our own: isotropic or fibres, elastic or viscoelastic, compressible or nearly not.

Waves simulated with fifth order on triangles, sampled on a grid, without noise and with 2 % (three seeds); elements, noise,
regulariser and weight are `invert`'s choice. Three records for each, as it reports them: `waves` is the convex start alone,
`uniform` descends from uniform fields, `both` from where `waves` ends; `chosen` says whose maps it gives. `error` is that of the
shear modulus (storage, Young's or μ), relative L2; with fibres in nearly incompressible tissue, where waves do not tell μ alone,
that of μ(1 + φ) or μ(1 + ζ), the larger one. All are in `errors`. CPU time of one thread, of all three together.

    python benchmarks/inversion_bodies.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/inversion_bodies.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from itertools import product

import numpy as np
from _bodies import BULK, waves
from _command import main, sweep
from _front import figure

from ngbrain import parallel
from ngbrain.inverse import fibre_shear_moduli, invert
from ngbrain.io import WaveData

Record = dict
BODIES = tuple(product(("isotropic", "transversely_isotropic"), ("elastic", "viscoelastic"), BULK))
FINE, COARSE = 41, 25
"""Points along a side: of the first three bodies, which take seconds there; of the others."""
NOISE, SEEDS = 0.02, 3
WANTED = {0.0: 0.01, NOISE: 0.04}
"""Of G′ or μ."""
COLOURS = {"waves": "#0072B2", "uniform": "#E69F00", "both": "#009E73"}


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """All of them; isotropic compressible bodies where it has to be quick."""
    every: dict[str, tuple] = {}
    for body in (BODIES[0], BODIES[2]) if quick else BODIES:
        n = 17 if quick else FINE if body in BODIES[:3] else COARSE
        for noise, seed in ((0.0, 0), *((NOISE, seed) for seed in range(1 if quick else SEEDS))):
            every[f"{', '.join(body)}, noise {noise:g}, seed {seed}"] = body, n, noise, seed
    return [r for found in sweep(rows, every, executor) for r in found]


def rows(body: tuple[str, str, str], n: int, noise: float, seed: int) -> list[Record]:
    """The starts of one set of data."""
    data, begun = waves(*body, n=n), time.process_time()
    found = invert(data.with_noise(noise, seed))
    spent, made = time.process_time() - begun, []
    ndof = found.final_state.problem.model.body.fes.ndof if found.final_state else None
    for row in found.starts:
        errors = errors_of(data, row.maps)
        told = body[0] != "isotropic" and body[2] != "compressible"
        error = max(errors["shear_along"], errors["shear_stretch"]) if told else next(iter(errors.values()))
        record = {"method": "ngbrain:invert", "body": " ".join(body), "points": n, "noise": noise, "seed": seed}
        record |= {"start": row.name, "chosen": row.name == found.chosen, "order": 1, "ndof": ndof}
        record |= {"error": error, "errors": errors, "cpu_s": spent, "converged": row.converged}
        made.append(record | {"regulariser": found.regulariser, "misfit_over_expected": row.misfit / row.expected})
    return made


def errors_of(data: WaveData, maps: dict[str, np.ndarray]) -> dict[str, float]:
    """Of each map, and with fibres of what waves tell of them."""
    truth = {name: np.real(values) for name, values in data.truth_views.items()}
    errors = {name: _off(values, truth[name]) for name, values in maps.items() if name in truth}
    if "zeta" in maps:
        wanted = fibre_shear_moduli(truth)
        errors |= {name: _off(values, wanted[name]) for name, values in fibre_shear_moduli(maps).items()}
    return errors


def _off(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def chart(records: list[Record], png: str) -> None:
    """Every run's error by body and start; the bound; what did not converge is hollow."""
    plt, made, axes = figure(12, 4.8, 2)
    bodies = list(dict.fromkeys(r["body"] for r in records))
    short = {"transversely_isotropic": "fibres", " nearly incompressible": " nearly\nincompr.", " ": "\n"}
    names = []
    for body in bodies:
        for long, name in short.items():
            body = body.replace(long, name)
        names.append(body)
    for axis, (noise, wanted) in zip(axes, WANTED.items(), strict=True):
        for r in (r for r in records if r["noise"] == noise):
            k = list(COLOURS).index(r["start"])
            where = bodies.index(r["body"]) + 0.25 * (k - 1) + 0.05 * (r["seed"] - 1)
            face = COLOURS[r["start"]] if r["converged"] else "none"
            axis.plot(where, 100 * r["error"], "o", color=COLOURS[r["start"]], mfc=face, ms=5)
        axis.axhline(100 * wanted, color="#b22222", lw=1, ls="--")
        axis.set(yscale="log", title=f"{100 * noise:g} % noise" if noise else "no noise")
        axis.set_xticks(range(len(bodies)), names, fontsize=6.5)
        axis.set_yticks([1, 2, 3, 4] if noise else [0.3, 0.5, 1, 2, 5, 10, 20, 40])
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter("")
        axis.grid(True, axis="y", alpha=0.3)
    for start, text in (("waves", "measured waves alone"), ("uniform", "uniform start"), ("both", "both")):
        axes[0].plot([], [], "o", color=COLOURS[start], label=text)
    axes[0].plot([], [], "o", color="#4d4d4d", mfc="none", label="no end found")
    axes[0].plot([], [], "--", color="#b22222", label="asked for")
    axes[0].set_ylabel("error of the shear modulus, %")
    made.legend(loc="outside lower center", ncols=5, fontsize=8)
    made.savefig(png, dpi=140)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    errors = ", ".join(f"{name} {100 * value:.3g} %" for name, value in r["errors"].items())
    return f"{r['body']:50} {100 * r['noise']:g} % seed {r['seed']} {r['start']:8} {errors}; {r['cpu_s']:.0f} s"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
