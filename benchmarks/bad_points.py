"""Waves with gross errors, as at a bad rim, a vessel or a wrapped patch: error of the modulus.

One slice of 162 by 150 mm with motion through it at 50 Hz, pixels of 2.5 mm in an oval mask, G* = 2.0 + 0.8i kPa with two discs of
15 mm, 1.5 and 0.6 times as stiff; 2 % noise. Gross errors: at 1.8 % of all points, all at the rim, .3 of the waves' rms; or at 5,
10 and 20 % of the points anywhere, as large as the waves. `error` is the larger of how far medians of G' and G'' of the
background are off; `contrasts` are medians of |G*| in the discs' cores (5 mm) over that of the background. `invert` is told
nothing.

    python benchmarks/bad_points.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/bad_points.py FILE [--json]           of one's own file of a uniform 2.0 + 0.8i kPa
    python benchmarks/bad_points.py --chart FILE.png < records.json
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from functools import cache

import ngsolve as ngs
import numpy as np
from _command import main, run, sweep
from _front import figure

from ngbrain import parallel
from ngbrain.forward import AntiPlane, HarmonicProblem, Wave, evaluation
from ngbrain.inverse import Inversion, invert
from ngbrain.io import WaveData, read_waves
from ngbrain.materials import Shearing
from ngbrain.mesh import rectangles
from ngbrain.threads import set_threads

Record = dict
G, SIZE, PIXEL, NOISE = 2000 + 800j, (0.1625, 0.15), 2.5e-3, 0.02
DISCS = {1.5: (0.055, 0.075), 0.6: (0.108, 0.07)}
"""Stiffness factors and positions (m)."""
RADIUS, CORE = 7.5e-3, 5e-3
RIM, RIM_SIZE = 0.018, 0.3
CASES = {"none": 0.0, "rim": RIM, "5 %": 0.05, "10 %": 0.1, "20 %": 0.2}


@cache
def slice_of_waves() -> WaveData:
    """Waves without errors, computed with order 4; the border moves as a rigid body."""
    mesh = rectangles(*(np.linspace(0, side, round(side / 5e-3) + 1) for side in SIZE))
    ratio = ngs.CF(1.0)
    for stiff, (x, y) in DISCS.items():
        ratio = ngs.IfPos(RADIUS**2 - (ngs.x - x) ** 2 - (ngs.y - y) ** 2, stiff, ratio)
    law = Shearing(ratio * G.real + 1j * (ratio * G.imag))
    body = HarmonicProblem(
        mesh,
        law,
        [Wave(50.0, {".*": (1e-5,)})],
        form="P4",
        dirichlet=".*",
        kinematics=AntiPlane(),
    )
    (wave,) = body.solve()
    lines = [PIXEL * np.arange(round(side / PIXEL) + 1) for side in SIZE]
    points = np.array([[x, y] for y in lines[1] for x in lines[0]])
    u = evaluation(ngs.H1(mesh, order=4), points) @ wave.vec.FV().NumPy()
    mask = np.linalg.norm((points - points.mean(axis=0)) / SIZE, axis=1) < 0.5
    return WaveData(
        points, u[None, :, None], [50.0], 1000.0, "isotropic", "viscoelastic", mask=mask, motion="anti_plane"
    ).with_noise(NOISE, seed=0)


def spoilt(case: str) -> tuple[WaveData, np.ndarray]:
    """Waves with gross errors, and the mask of their points."""
    data, rng, share = slice_of_waves(), np.random.default_rng(1), CASES[case]
    where = data.border if case == "rim" else data.mask
    wrong = where & (rng.random(len(where)) < share * data.mask.sum() / where.sum())
    size = data.rms[0, 0, 0] * (RIM_SIZE if case == "rim" else 1.0)
    u = data.displacement.copy()
    error = rng.normal(size=(2, wrong.sum())) / np.sqrt(2)
    u[0, wrong, 0] += size * (error[0] + 1j * error[1])
    return replace(data, displacement=u), wrong


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """One record for each case."""
    return sweep(case, {name: (name,) for name in (["10 %"] if quick else CASES)}, executor)


def case(name: str) -> Record:
    """The record of `invert`."""
    data, wrong = spoilt(name)
    begun = time.process_time()
    found = invert(data)
    cpu_s = time.process_time() - begun
    modulus, away = _modulus(found), np.full(len(data.points), np.inf)
    contrasts = {}
    for stiff, place in DISCS.items():
        off = np.linalg.norm(data.points - place, axis=1)
        contrasts[f"{stiff:g}"], away = float(np.nanmedian(np.abs(modulus[off < CORE]))), np.minimum(away, off)
    background = modulus[data.mask & (away > RADIUS + CORE)]
    middle = float(np.nanmedian(np.abs(background)))
    left = data.measured[0, :, 0] & ~found.data.measured[0, :, 0]
    return {
        "method": name,
        **_common(found, background, cpu_s),
        "contrasts": {stiff: value / middle for stiff, value in contrasts.items()},
        "wrong": int(wrong.sum()),
        "left_out": int((left & wrong).sum()),
        "left_out_good": int((left & ~wrong).sum()),
    }


def file(path: str) -> Record:
    """Errors for a file with the truth `G` everywhere."""
    begun = time.process_time()
    found = invert(read_waves(path))
    return {"method": "file", **_common(found, _modulus(found), time.process_time() - begun), "notes": found.warnings}


def _modulus(found: Inversion) -> np.ndarray:
    return np.asarray(found.maps["storage"] + 1j * found.maps["loss"])


def _common(found: Inversion, background: np.ndarray, cpu_s: float) -> Record:
    storage, loss = float(np.nanmedian(background.real)), float(np.nanmedian(background.imag))
    return {
        "order": 3,
        "ndof": found.model["n_unknowns"],
        "error": max(abs(storage / G.real - 1), abs(loss / G.imag - 1)),
        "cpu_s": cpu_s,
        "converged": bool(found.checks["converged"]),
        "usable": found.usable,
        "storage": storage,
        "loss": loss,
    }


def chart(records: list[Record], png: str) -> None:
    """Contrasts by case."""
    plt, made, axes = figure(6, 3.5, 1)
    shown = [r for r in records if "contrasts" in r]
    for stiff in DISCS:
        axes.plot([r["method"] for r in shown], [r["contrasts"][f"{stiff:g}"] for r in shown], "o-", label=f"{stiff:g}")
        axes.axhspan(0.85 * stiff, 1.15 * stiff, alpha=0.2)
    axes.set(xlabel="gross errors", ylabel="contrast")
    axes.legend(frameon=False)
    made.savefig(png, dpi=130)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    more = ""
    if "contrasts" in r:
        contrasts = ", ".join(f"{value:.2f} for {stiff}" for stiff, value in r["contrasts"].items())
        more = f", contrasts {contrasts}; {r['left_out']} of {r['wrong']} left out, {r['left_out_good']} good ones"
    return f"{r['method']}: {1e-3 * r['storage']:.3f} + {1e-3 * r['loss']:.3f}i kPa{more}; {r['cpu_s']:.0f} s"


if __name__ == "__main__":
    if len(sys.argv) > 1 and not sys.argv[1].startswith("-"):
        set_threads(1)
        found = [file(sys.argv[1]) | {"run": run()}]
        print(json.dumps(found) if "--json" in sys.argv else "\n".join(map(line, found)))
    else:
        main(__doc__, measure, chart, line)
