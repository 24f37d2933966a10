"""Mixed elements against Griffiths' displacement-only hexahedra (deal.II's FE_Q(1) at ν = .49), where the element alone differs.

Half a slab of white matter (one-term Ogden, the equilibrium of `griffiths2024:white_matter`), 36 x 24 x 48 mm, sides and floor
held, the top free. As on the plane between two spatulas, a face goes its way across and is free along: 12 by 30 mm of it by
the whole way, beside that by less and less over 9 mm. The force is that on the way of the blade. All forms have the same
energy. `error`: of the force, from the finest solution of the same Poisson's ratio. Kinds: `element` (error against
time), `poisson` (one mesh, one small way, from ν = .3 on: what locks), `model` (the finest solution at ν = .49 over that at
K/μ = 1000: what the other model changes, whatever the element).

    python benchmarks/griffiths_locking.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/griffiths_locking.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
import warnings
from typing import Any

import _front
import ngsolve as ngs
import numpy as np
from _command import main
from ngsolve.meshes import MakeStructured3DMesh

from ngbrain.errors import CollapseWarning, SolverError, StabilityWarning
from ngbrain.forward import LoadPath, Material, Problem
from ngbrain.materials import Deformation, constants
from ngbrain.surgery import von_mises
from ngbrain.tensors import deformation_gradient

SIZE, HALF_WIDTH, DEEP, EDGE = (36e-3, 24e-3, 48e-3), 6e-3, 30e-3, 9e-3
SITE = 6e-3
"""Distance (m) from the face and the strip's edges within which stress is evaluated."""
WAY, SMALL = 5.75e-3, 1e-3
LOAD_STEPS = {WAY: 5, SMALL: 1}
THEIRS, OURS = 0.49, 0.4995
"""Poisson's ratios; ours is K/μ = 1000."""
POISSON = (0.3, 0.45, THEIRS, OURS)
FINEST = ("Q3/Q2", 6.0)
"""Form and cells (mm) of the reference solution. At ν = .49 Q4 is 0.3 % off it for the small way, and Q3 0.5 % for the whole one,

where det F falls to .26: errors of less than some per cent say nothing there.
"""
SIZES = {"Q1": (6.0, 4.0, 3.0, 2.0), "P2/P1": (12.0, 6.0, 4.0)}
EQUAL = 3.0
"""Cells (mm) of Q1 with about the unknowns of P2/P1 at twice that."""


def ratio(nu: float) -> float:
    """K/μ."""
    return 2 * (1 + nu) / (3 * (1 - 2 * nu))


def fall(x: ngs.CoefficientFunction, start: float) -> ngs.CoefficientFunction:
    """1 up to `start`, 0 beyond `EDGE` more, smooth between."""
    t = ngs.IfPos(x - start, ngs.IfPos(start + EDGE - x, (x - start) / EDGE, 1), 0)
    return 1 - 3 * t**2 + 2 * t**3


SHAPE = fall(ngs.y, HALF_WIDTH) * fall(SIZE[2] - ngs.z, DEEP)
"""Share of the travel that a point of the face moves."""


def slab(cells: float, hexes: bool) -> ngs.Mesh:
    """Hexahedra of `cells` mm, or each cut into six tetrahedra."""
    n = [round(1e3 * length / cells) for length in SIZE]
    return MakeStructured3DMesh(
        hexes=hexes,
        nx=n[0],
        ny=n[1],
        nz=n[2],
        mapping=lambda *at: tuple(length * t for length, t in zip(SIZE, at, strict=True)),
    )


def pushed(form: str, cells: float, nu: float, way: float) -> Problem:
    """The unsolved problem of the slab."""
    law = constants("griffiths2024:white_matter").law().equilibrium
    held = {"front|right|bottom": 0, "left": (None, 0, None), "back": (way * SHAPE, None, None)}
    material = {".*": Material(law, ratio(nu) * law.mu)}
    return Problem(slab(cells, form.startswith("Q")), material, held, element=form)


def stress(body: Problem) -> tuple[float, float]:
    """Mean and 95th percentile (Pa) of the von Mises stress under the strip and `SITE` around."""
    points = body.mesh.MapToAllElements(body.tissue.rules, ngs.VOL)
    F = deformation_gradient(body.u).MakeVariable()
    (material,) = body.materials.values()
    P = material.energy(Deformation.from_gradient(F), body.p).Diff(F)
    x, volume = (
        np.asarray(f(points))
        for f in (ngs.CF((ngs.x, ngs.y, ngs.z)), ngs.Norm(ngs.Det(ngs.specialcf.JacobianMatrix(3))))
    )
    (rule,) = body.tissue.rules.values()
    near = (x[:, 0] < SITE) & (x[:, 1] < HALF_WIDTH + SITE) & (x[:, 2] > SIZE[2] - DEEP - SITE)
    weights = (np.tile(np.array(rule.weights), body.mesh.ne) * volume.ravel())[near]
    values = von_mises(*(np.asarray(f(points)).reshape(-1, 3, 3)[near] for f in (F, P)))
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    return float(values @ weights / weights.sum()), float(values[order][np.searchsorted(share, 0.95)])


def solved(form: str, cells: float, nu: float, way: float) -> dict:
    """Force and stress on one mesh."""
    start = time.process_time()
    body = pushed(form, cells, nu, way)
    of = {
        "method": f"ngbrain:{form}" if "/" in form else f"{form} alone",
        "order": body.element.order,
        "ndof": body.fes.ndof,
    }
    of |= {"cells_mm": cells, "nu": nu, "way_mm": 1e3 * way}
    try:
        record = LoadPath(body).solve(steps=LOAD_STEPS[way])
    except SolverError as error:
        return of | {
            "converged": False,
            "reason": str(error)[:120],
            "cpu_s": time.process_time() - start,
            "error": None,
        }
    cpu = time.process_time() - start
    mean, p95 = stress(body)
    lost = 1e6 * ngs.Integrate(1 - ngs.Det(deformation_gradient(body.u)), body.mesh, order=4)
    found: dict[str, Any] = {"N": body.conjugate(ngs.CF((SHAPE, 0, 0)), "back"), "mean_Pa": mean, "p95_Pa": p95}
    found |= {"lost_ml": float(lost), "min_det_F": float(record.min_det_F)}
    return of | found | {"converged": True, "cpu_s": cpu, "error": None}


def measure(quick: bool) -> list[dict]:
    """All records; `quick` has the small travel and coarse meshes only."""
    warnings.simplefilter("ignore", CollapseWarning)
    warnings.simplefilter("ignore", StabilityWarning)
    ways = (SMALL,) if quick else (SMALL, WAY)
    finest = {(nu, way): solved(*FINEST, nu, way) for nu in (THEIRS, OURS) for way in ways}
    records = [r | {"kind": "finest"} for r in finest.values()]
    for way in ways:
        for form, sizes in SIZES.items():
            for nu in (THEIRS, OURS):
                for cells in sizes[: 2 if quick else None]:
                    records.append(solved(form, cells, nu, way) | {"kind": "element"})
    for nu in () if quick else POISSON:
        finest[nu, SMALL] = finest.get((nu, SMALL)) or solved(*FINEST, nu, SMALL)
        for form, cells in (("Q1", EQUAL), ("P2/P1", 2 * EQUAL)):
            records.append(solved(form, cells, nu, SMALL) | {"kind": "poisson"})
    for r in records:
        best = finest[r["nu"], r["way_mm"] / 1e3]
        if r["converged"] and best["converged"] and r["kind"] != "finest":
            r["N_over_finest"], r["error"] = r["N"] / best["N"], abs(r["N"] / best["N"] - 1)
            r["p95_over_finest"] = r["p95_Pa"] / best["p95_Pa"]
    for way in ways:
        soft, stiff = finest[THEIRS, way], finest[OURS, way]
        if soft["converged"] and stiff["converged"]:
            of = {
                "kind": "model",
                "N_over_ours": soft["N"] / stiff["N"],
                "p95_over_ours": soft["p95_Pa"] / stiff["p95_Pa"],
            }
            records.append(soft | of | {"cpu_s": soft["cpu_s"] + stiff["cpu_s"]})
    return records


def chart(records: list[dict], path: str) -> None:
    """Relative force against time, errors against ν, and both differences side by side."""
    plt, figure, (small, whole, locks) = _front.figure(16, 5.2, 3)
    looks = {("Q1 alone", THEIRS): ("#D55E00", "s-"), ("Q1 alone", OURS): ("#D55E00", "s:")}
    looks |= {("ngbrain:P2/P1", THEIRS): ("#0072B2", "o-"), ("ngbrain:P2/P1", OURS): ("#0072B2", "o:")}
    names = {THEIRS: "ν = .49", OURS: "K/μ = 1000"}
    models = {r["way_mm"]: r["N_over_ours"] for r in records if r["kind"] == "model"}
    for axes, way in ((small, 1e3 * SMALL), (whole, 1e3 * WAY)):
        for (method, nu), (colour, style) in looks.items():
            rows = [
                r
                for r in records
                if r["kind"] == "element" and (r["method"], r["nu"], r["way_mm"]) == (method, nu, way)
            ]
            rows = [r for r in rows if r["converged"]]
            axes.plot(
                [r["cpu_s"] for r in rows],
                [100 * (r["N_over_finest"] - 1) for r in rows],
                style,
                color=colour,
                label=f"{method}, {names[nu]}",
            )
            for r in rows if nu == THEIRS else ():
                axes.annotate(
                    f"{r['cells_mm']:g} mm",
                    (r["cpu_s"], 100 * (r["N_over_finest"] - 1)),
                    (4, 4),
                    textcoords="offset points",
                    fontsize=7,
                )
        axes.axhline(0, color="#999999", lw=0.8)
        title = f"pushed {way:g} mm"
        if way in models:
            title += f"; ν = .49 itself, over K/μ = 1000: {100 * (models[way] - 1):+.0f} %"
        axes.set(xscale="log", xlabel="CPU time, one thread (s)", ylabel="force, off by (%)", title=title)
        axes.grid(alpha=0.25, lw=0.6)
        axes.legend(fontsize=8, frameon=False)
    for method, colour in (("Q1 alone", "#D55E00"), ("ngbrain:P2/P1", "#0072B2")):
        rows = [r for r in records if r["kind"] == "poisson" and r["method"] == method and r["converged"]]
        label = f"{method}, {rows[0]['cells_mm']:g} mm, {rows[0]['ndof']} unknowns" if rows else method
        locks.plot(
            [ratio(r["nu"]) for r in rows],
            [100 * (r["N_over_finest"] - 1) for r in rows],
            "o-",
            color=colour,
            label=label,
        )
    locks.axhline(0, color="#999999", lw=0.8)
    locks.set(
        xscale="log",
        xlabel="K/μ (ν = .3, .45, .49, .4995)",
        ylabel="force, off by (%)",
        title="What locks: pushed 1 mm",
    )
    locks.grid(alpha=0.25, lw=0.6)
    locks.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def line(r: dict) -> str:
    """One record as text."""
    what = f"{r['kind']:<8} {r['method']:<14} {r['cells_mm']:4g} mm {r['ndof']:6d} unknowns, ν {r['nu']}, {r['way_mm']:g} mm"
    if not r["converged"]:
        return f"{what}  {r['reason']}"
    text = f"{what}  {r['N']:.5g} N, {r['mean_Pa']:.0f} and {r['p95_Pa']:.0f} Pa, det F {r['min_det_F']:.2f}, {r['cpu_s']:.1f} s"
    for name in ("N_over_finest", "p95_over_finest", "N_over_ours", "p95_over_ours"):
        text += f", {name} {r[name]:.3f}" if name in r else ""
    return text


if __name__ == "__main__":
    main(__doc__ or "", measure, chart, line)
