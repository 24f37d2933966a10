"""Coverage of the intervals of complete inversions: several noise draws, data from other elements.

plane   CV-G of `ngbrain.inverse.phantoms.benchmark` on every second of its 51 × 51 points, made in bilinear elements, 2 %
        noise, twenty draws
space   a block of 3 cm, moduli with a smooth bump, two loads at 60 Hz, made in tetrahedra of fourth order, 2 % noise, six draws
drawn   blocks of 2 cm, so too, but the truth is another one in each of twenty draws: 2 to 4 bumps of either sign anywhere, up to .6
        of ln high and 5 to 12 mm wide, of storage and of loss each by itself
discs   slices of 6 cm with motion through them, made on triangles of fourth order along the edges, 2 % noise: two discs of 12 to 18
        mm and .4 to 3 times the modulus, others in each of eight draws; of the prior that fits best alone

Each is inverted with every choice left to `invert`; error bars follow with the prior that fits best (`evidence`), and with the
regulariser of the inversion as before. `error` is |coverage - .95| at 95 %, over all points of both maps and all draws; `l2` the
relative error of storage and loss. CPU time of one thread for a draw: `cpu_s` the inversion, `bars_s` the error bars.

    python benchmarks/uncertainty_seeds.py [--quick] [--json] [--executor WHO]      last line of --json: a list of records
    python benchmarks/uncertainty_seeds.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
from _command import main, sweep
from _coverage import chart as coverage_chart
from _coverage import coverage, told
from netgen.csg import CSGeometry, OrthoBrick, Pnt
from scipy.special import ndtri

from ngbrain import parallel
from ngbrain.forward import AntiPlane, HarmonicProblem, Wave, evaluation
from ngbrain.inverse import Discretisation, Phantom, Uncertainty, discretise, invert, uncertainty
from ngbrain.io import WaveData
from ngbrain.materials import Shearing
from ngbrain.mesh import boxes

Record = dict
MAPS = ("storage", "loss")
PRIORS = {"own": "naive: the inversion's regulariser", "best": "ngbrain:evidence"}
BULK, MODULUS = 3e4, (2400.0, 1000.0)


def plane() -> tuple[WaveData, Discretisation]:
    """Every second point."""
    data = Phantom.from_name("CV-G").simulate_measurements().data()
    grid = data.grid
    assert grid is not None
    chosen = np.zeros(grid.shape, bool)
    chosen[::2, ::2] = True
    at = np.flatnonzero(grid.flat(chosen))
    truth = {name: values[at] for name, values in data.truth.items()}
    about = {"poisson": data.poisson, "truth": truth}
    coarse = WaveData(
        data.points[at], data.displacement[:, at], data.frequency, data.density, "isotropic", "viscoelastic", **about
    )
    return coarse, discretise(coarse)


Bump = tuple[float, float, float, float, float]
"""Centre, width (m) and height of a bump."""


def share(bumps: list[Bump], x, y, z, exp):  # type: ignore[no-untyped-def]
    """The sum of bumps."""
    return sum(h * exp(-((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2) / w**2) for a, b, c, w, h in bumps)


def block(
    side: float, cells: int, spacing: float, size: float, order: int, moduli: Callable[..., list]
) -> tuple[WaveData, Discretisation]:
    """Waves in tetrahedra of a `size`; hexahedra to invert them. moduli   x, y, z, exp ↦ storage and loss"""
    geometry = CSGeometry()
    geometry.Add(OrthoBrick(Pnt(0, 0, 0), Pnt(side, side, side)).bc("all"))
    mesh = ngs.Mesh(geometry.GenerateMesh(maxh=size))
    x, y, z = (1e-5 * each / side for each in (ngs.x, ngs.y, ngs.z))
    drives = [(z, 1e-5 - z, x), (y, 1e-5 - x, 0.5 * y + 0.5 * x)]
    storage, loss = moduli(ngs.x, ngs.y, ngs.z, ngs.exp)
    waves = [Wave(60.0, {"all": drive}) for drive in drives]
    body = HarmonicProblem(
        mesh, Shearing(storage + 1j * loss), waves, bulk=BULK, form="P4", dirichlet="all", quadrature=order
    )
    line = np.linspace(0, side, round(side / spacing) + 1)
    points = np.array([[x, y, z] for z in line for y in line for x in line])
    observe = evaluation(ngs.H1(mesh, order=4), np.clip(points, 1e-9, side - 1e-9))
    u = [observe @ gfu.vec.FV().NumPy().reshape(3, -1).T for gfu in body.solve()]
    storage, loss = moduli(*points.T, np.exp)
    about = {"bulk": BULK, "truth": {"shear": storage + 1j * loss}}
    data = WaveData(points, u, [60.0] * 2, 1000.0, "isotropic", "viscoelastic", **about)
    line = np.linspace(0, side, cells + 1)
    mesh = boxes(np.ones((cells, cells, cells), bool), line, line, line)
    return data, Discretisation(mesh, "P3", 2, None, np.ones(len(points), bool))


def one_bump() -> tuple[WaveData, Discretisation]:
    """A bump with 1.6 times the modulus at its centre."""
    bump = [(0.014, 0.016, 0.015, 1e-2, 0.6)]
    return block(0.03, 3, 2.5e-3, 0.01, 6, lambda *at: [modulus * (1 + share(bump, *at)) for modulus in MODULUS])


def bumps(seed: int) -> tuple[WaveData, Discretisation]:
    """Several bumps, different for each seed."""
    side, random = 0.02, np.random.default_rng([seed, 1])
    each: list[list[Bump]] = [
        [
            (
                *random.uniform(0, side, 3),
                np.exp(random.uniform(np.log(5e-3), np.log(12e-3))),
                random.uniform(-0.6, 0.6),
            )
            for _ in range(random.integers(2, 5))
        ]
        for _ in MODULUS
    ]

    def moduli(x, y, z, exp):  # type: ignore[no-untyped-def]
        return [modulus * exp(share(own, x, y, z, exp)) for modulus, own in zip(MODULUS, each, strict=True)]

    return block(side, 2, 2e-3, 7e-3, 10, moduli)


def discs(seed: int) -> tuple[WaveData, Discretisation]:
    """Two discs, different for each seed, between a wave from the left and one from below."""
    side, n, random = 0.06, 25, np.random.default_rng([seed, 2])
    centres = side * np.array([[0.3, 0.3], [0.7, 0.68]]) + random.uniform(-3e-3, 3e-3, (2, 2))
    radii, ratios = random.uniform(6e-3, 9e-3, 2), np.exp(random.uniform(np.log(0.4), np.log(3), 2))
    square = occ.Rectangle(side, side).Face()
    square.edges.name = "all"
    spots = [
        occ.Circle(occ.Pnt(*centre), radius).Face() for centre, radius in zip(centres.tolist(), radii, strict=True)
    ]
    parts = [square - spots[0] - spots[1], *spots]
    for part, name in zip(parts, ("around", "first", "second"), strict=True):
        part.faces.name = name
    mesh = ngs.Mesh(occ.OCCGeometry(occ.Glue(parts), dim=2).GenerateMesh(maxh=side / 10)).Curve(4)
    factor = mesh.MaterialCF({"first": ratios[0], "second": ratios[1]}, default=1.0)
    storage, loss = MODULUS
    drives = [(1e-5 * ngs.y / side,), (1e-5 * (1 - ngs.x / side),)]
    body = HarmonicProblem(
        mesh,
        Shearing(factor * (storage + 1j * loss)),
        [Wave(60.0, {"all": drive}) for drive in drives],
        form="P4",
        dirichlet="all",
        kinematics=AntiPlane(),
    )
    line = np.linspace(1e-9, side - 1e-9, n)
    points = np.array([[x, y] for y in line for x in line])
    u = np.array([wave(mesh(*points.T)).reshape(-1, 1) for wave in body.solve()])
    inside = np.linalg.norm(points[:, None] - centres, axis=2) < radii
    shear = (storage + 1j * loss) * np.where(inside[:, 0], ratios[0], np.where(inside[:, 1], ratios[1], 1.0))
    about = {"motion": "anti_plane", "truth": {"shear": shear}}
    data = WaveData(points, u, [60.0] * 2, 1000.0, "isotropic", "viscoelastic", **about)
    return data, discretise(data)


CASES = {
    "plane": (plane, 0.02, 20),
    "space": (one_bump, 0.02, 6),
    "drawn": (bumps, 0.02, 20),
    "discs": (discs, 0.02, 8),
}
"""What makes data and elements, noise, and draws: of `space` one takes 80 to 95 s, of `drawn` 30 s."""
DRAWN = "drawn", "discs"
"""Cases whose truth is another one in each draw."""


def scores(bars: Uncertainty) -> np.ndarray:
    """Error in standard deviations of ln storage and ln loss at all points."""
    truth, found, reach = bars.data.truth_views, bars.arrays(), ndtri(0.975)
    parts = []
    for name in MAPS:
        low, high = np.log(found[f"{name}_low"]), np.log(found[f"{name}_high"])
        off = np.log(np.real(truth[name])) - (low + high) / 2
        parts.append((off / ((high - low) / 2 / reach))[np.isfinite(low)])
    return np.concatenate(parts)


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """A record for each case and prior."""
    seeds = {"plane": range(2)} if quick else {case: range(number) for case, (_, _, number) in CASES.items()}
    draws = {f"{case}, seed {seed}": (case, seed) for case, own in seeds.items() for seed in own}
    found = dict(zip(draws.values(), sweep(drawn, draws, executor), strict=True))
    return [record for case, own in seeds.items() for record in measured(case, [found[case, seed] for seed in own])]


@dataclass
class Draw:
    """Results of one noise draw: scores, errors of the maps and CPU time (s) by prior; and that of the inversion."""

    off: dict[str, np.ndarray]
    errors: dict[str, list[float]]
    bars_s: dict[str, float]
    spent: float
    ndof: int


@cache
def made(case: str, seed: int) -> tuple[WaveData, Discretisation]:
    """Noise-free data and elements; of a seed if the case draws its truth."""
    return CASES[case][0](seed) if case in DRAWN else CASES[case][0]()


def drawn(case: str, seed: int) -> Draw:
    """An inversion and its error bars."""
    exact, elements = made(case, seed if case in DRAWN else 0)
    begun = time.process_time()
    found = invert(exact.with_noise(CASES[case][1], seed), elements, callback=lambda _: None)
    inverted = time.process_time()
    bars = uncertainty.credible_maps.uncertainty(found, prior="own")
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
        if case != "discs" or prior == "best"
    ]


def line(r: Record) -> str:
    """One record as text."""
    storage, loss = (100 * each for each in r["l2"])
    spent = f"{r['bars_s']:.0f} s after {r['cpu_s']:.0f} s"
    return f"{r['case']}, {r['method']}: {told(r)}; storage {storage:.2g} %, loss {loss:.2g} %, {spent}"


def chart(records: list[Record], png: str) -> None:
    """Coverage against level."""
    coverage_chart(records, png, lambda r: f"{r['case']}, {100 * r['noise']:g} % noise", "points", 3.2)


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
