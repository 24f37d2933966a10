"""Do intervals of whole inversions hold the truth as often as they say? Several draws of the noise, data from other elements.

plane   CV-G of `ngbrain.inverse.phantoms` on every second of its 51 × 51 points, made in bilinear elements, 2 % noise, twenty draws
space   a block of 3 cm, moduli with a smooth bump, two loads at 60 Hz, made in tetrahedra of fourth order, 2 % noise, six draws

Each is inverted with every choice left to `invert`; error bars follow with the prior that fits best (`evidence`), and with the
regulariser of the inversion as before. `error` is |coverage - .95| at 95 %, over all points of both maps and all draws; `l2` the
relative error of storage and loss. CPU time of one thread for a draw: `cpu_s` the inversion, `bars_s` the error bars.

    python benchmarks/uncertainty_seeds.py [--quick] [--json] [--executor WHO]      last line of --json: a list of records
    python benchmarks/uncertainty_seeds.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache

import ngsolve as ngs
import numpy as np
from _command import main, sweep
from _coverage import chart as coverage_chart
from _coverage import coverage, told
from netgen.csg import CSGeometry, OrthoBrick, Pnt
from scipy.special import ndtri

from ngbrain import parallel
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.harmonic.problem import Harmonic, Wave
from ngbrain.inverse.discretise import Discretisation, in_elements
from ngbrain.inverse.invert import invert
from ngbrain.inverse.phantoms import Phantom
from ngbrain.inverse.uncertainty import Uncertainty, uncertainty
from ngbrain.io.waves import WaveData
from ngbrain.materials import Shearing
from ngbrain.mesh.grid import boxes

Record = dict
MAPS = ("storage", "loss")
PRIORS = {"own": "naive: the inversion's regulariser", "best": "ngbrain:evidence"}
SIDE, BULK, MODULUS = 0.03, 3e4, (2400.0, 1000.0)


def plane() -> tuple[WaveData, Discretisation]:
    """Every second point."""
    data = Phantom.named("CV-G").measured().data()
    grid = data.structured
    assert grid is not None
    chosen = np.zeros(grid.shape, bool)
    chosen[::2, ::2] = True
    at = np.flatnonzero(grid.flat(chosen))
    truth = {name: values[at] for name, values in data.truth.items()}
    about = {"poisson": data.poisson, "truth": truth}
    coarse = WaveData(
        data.points[at], data.displacement[:, at], data.frequency, data.density, "isotropic", "viscoelastic", **about
    )
    return coarse, in_elements(coarse)


def bump(x, y, z, exp):  # type: ignore[no-untyped-def]
    """1.6 at the middle of the bump, 1 far from it."""
    return 1 + 0.6 * exp(-((x - 0.014) ** 2 + (y - 0.016) ** 2 + (z - 0.015) ** 2) / 1e-2**2)


def block(order: int = 4, spacing: float = 2.5e-3) -> tuple[WaveData, Discretisation]:
    """Waves in tetrahedra; hexahedra to invert them."""
    geometry = CSGeometry()
    geometry.Add(OrthoBrick(Pnt(0, 0, 0), Pnt(SIDE, SIDE, SIDE)).bc("all"))
    mesh = ngs.Mesh(geometry.GenerateMesh(maxh=0.01))
    share = bump(ngs.x, ngs.y, ngs.z, ngs.exp)
    x, y, z = (1e-5 * each / SIDE for each in (ngs.x, ngs.y, ngs.z))
    drives = [(z, 1e-5 - z, x), (y, 1e-5 - x, 0.5 * y + 0.5 * x)]
    law = Shearing(MODULUS[0] * share + 1j * (MODULUS[1] * share))
    waves = [Wave(60.0, {"all": drive}) for drive in drives]
    body = Harmonic(mesh, law, waves, bulk=BULK, form=f"P{order}", held="all", quadrature=order + 2)
    line = np.linspace(0, SIDE, round(SIDE / spacing) + 1)
    points = np.array([[x, y, z] for z in line for y in line for x in line])
    observe = evaluation(ngs.H1(mesh, order=order), np.clip(points, 1e-9, SIDE - 1e-9))
    u = [observe @ gfu.vec.FV().NumPy().reshape(3, -1).T for gfu in body.solve()]
    truth = complex(*MODULUS) * bump(*points.T, np.exp)
    about = {"bulk": BULK, "truth": {"shear": truth}}
    data = WaveData(points, u, [60.0] * 2, 1000.0, "isotropic", "viscoelastic", **about)
    line = np.linspace(0, SIDE, 4)
    mesh = boxes(np.ones((3, 3, 3), bool), line, line, line)
    return data, Discretisation(mesh, "P3", 2, None, np.ones(len(points), bool))


CASES = {"plane": (plane, 0.02, 20), "space": (block, 0.02, 6)}
"""What makes data and elements, noise, and draws: in space one takes 80 to 95 s."""


def scores(bars: Uncertainty) -> np.ndarray:
    """How many standard deviations the truth is off, of ln storage and ln loss at all points."""
    truth, found, reach = bars.data.truth_views, bars.arrays(), ndtri(0.975)
    parts = []
    for name in MAPS:
        low, high = np.log(found[f"{name}_low"]), np.log(found[f"{name}_high"])
        off = np.log(np.real(truth[name])) - (low + high) / 2
        parts.append((off / ((high - low) / 2 / reach))[np.isfinite(low)])
    return np.concatenate(parts)


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """Two records for each case, one for each prior."""
    seeds = {"plane": range(2)} if quick else {case: range(number) for case, (_, _, number) in CASES.items()}
    draws = {f"{case}, seed {seed}": (case, seed) for case, own in seeds.items() for seed in own}
    found = dict(zip(draws.values(), sweep(drawn, draws, executor), strict=True))
    return [record for case, own in seeds.items() for record in measured(case, [found[case, seed] for seed in own])]


@dataclass
class Draw:
    """What one draw of the noise led to: by prior, scores, errors of the maps and CPU time (s); and that of the inversion."""

    off: dict[str, np.ndarray]
    errors: dict[str, list[float]]
    bars_s: dict[str, float]
    spent: float
    ndof: int


@cache
def made(case: str) -> tuple[WaveData, Discretisation]:
    """Exact data and elements of a case, made once in each process."""
    return CASES[case][0]()


def drawn(case: str, seed: int) -> Draw:
    """An inversion and its error bars."""
    exact, elements = made(case)
    begun = time.process_time()
    found = invert(exact.with_noise(CASES[case][1], seed), elements, tell=lambda _: None)
    inverted = time.process_time()
    bars = uncertainty(found, prior="own")
    between = time.process_time()
    by = {"own": bars, "best": bars.with_best_prior()}
    ended = time.process_time()
    return Draw(
        {prior: scores(each) for prior, each in by.items()},
        {prior: [each.found.answers[name]["relative_l2_error"] for name in MAPS] for prior, each in by.items()},
        {"own": between - inverted, "best": ended - inverted},
        inverted - begun,
        found.model["n_unknowns"],
    )


def measured(case: str, draws: list[Draw]) -> list[Record]:
    """One record for each prior."""
    return [
        {
            "method": label,
            "case": case,
            "order": 3,
            "ndof": draws[-1].ndof,
            "noise": CASES[case][1],
            "seeds": len(draws),
            **coverage(np.concatenate([draw.off[prior] for draw in draws])),
            "coverage_by_draw": [float(np.mean(np.abs(draw.off[prior]) < ndtri(0.975))) for draw in draws],
            "l2": np.mean([draw.errors[prior] for draw in draws], axis=0).tolist(),
            "cpu_s": float(np.mean([draw.spent for draw in draws])),
            "bars_s": float(np.mean([draw.bars_s[prior] for draw in draws])),
            "converged": True,
        }
        for prior, label in PRIORS.items()
    ]


def line(r: Record) -> str:
    """A record to read."""
    storage, loss = (100 * each for each in r["l2"])
    spent = f"{r['bars_s']:.0f} s after {r['cpu_s']:.0f} s"
    return f"{r['case']}, {r['method']}: {told(r)}; storage {storage:.2g} %, loss {loss:.2g} %, {spent}"


def chart(records: list[Record], png: str) -> None:
    """Coverage against level."""
    coverage_chart(records, png, lambda r: f"{r['case']}, {100 * r['noise']:g} % noise", "points", 3.2)


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
