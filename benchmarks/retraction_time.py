"""Error against time of pressing relaxing tissue: our stepping against plain NGSolve, several steps, orders and meshes.

A 20 mm block on a rigid base (Ogden and Neo-Hooke, two relaxing branches, K/μ = 1000) is pressed by 3 mm in 4 s by a
rigid plate and held to 40 s. Error: of the dose ∫ force dt, relative to order 3 on a finer mesh with steps 8 times
shorter. The peer is what one would write in plain NGSolve: backward Euler for the branches, `ngsolve.solvers.Newton`
with a new factorisation every iteration, the plate as a penalty, even steps.

    python benchmarks/retraction_time.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/retraction_time.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time

import ngsolve as ngs
import numpy as np
from _command import main
from ngsolve.solvers import Newton as NgsolveNewton

from ngbrain.errors import SolverError, require
from ngbrain.forward.body import Body, Material
from ngbrain.forward.contact import Contact
from ngbrain.forward.steps import StepControl
from ngbrain.forward.transient import Transient
from ngbrain.materials import Branch, Deformation, NeoHooke, Ogden, Viscous
from ngbrain.mesh import block
from ngbrain.solvers.newton import Newton
from ngbrain.surgery.protocols import Drive, continuous
from ngbrain.tensors import isochoric

SIZE, BULK, PENALTY = (0.02, 0.02, 0.02), 1.5e6, 3e8
LAW = Viscous(Ogden(300.0, -12.0), (Branch(Ogden(700.0, -15.0), 2.3), Branch(NeoHooke(500.0), 500.0)))
PROTOCOL = continuous(3e-3, 4.0, 40.0)


def contact(level: ngs.CoefficientFunction) -> Contact:
    """The plate: a half space above the block, `level` below the unloaded top."""
    return Contact("top", lambda x: SIZE[2] - level - x[2], PENALTY, 2e-5)


def dose(t: list[float], f: list[float]) -> float:
    """∫ force dt (N s)."""
    return float(np.trapezoid(f, t))


def up_forces(space: ngs.FESpace) -> np.ndarray:
    """Nodal values of a unit translation along z."""
    gfu = ngs.GridFunction(space)
    gfu.Set(ngs.CF((0, 0, 1)))
    return np.array(gfu.vec.FV().NumPy())


def ours(dt: float, order: int, maxh: float, keep: float) -> tuple[float, int, int]:
    """(dose, steps, unknowns) of our stepping; `keep` 0 renews the factorisation every iteration."""
    drive = Drive(PROTOCOL)
    body = Body(block(SIZE, maxh), {"tissue": Material(LAW, BULK)}, "bottom", [contact(drive.parameter)], order)
    up = up_forces(body.fes.components[0])
    newton = Newton(keep=keep, worth=round(9 * keep), max_factorisations=60)
    transient = Transient(body, drive, StepControl(dt, dt_max=8 * dt), 1e-3, newton)
    t, f = [0.0], [0.0]

    def watch(b: Body, at: object, record: object) -> None:
        t.append(transient.progress.t)
        f.append(float(up @ b.contact_forces()))

    transient.run(watch)
    return dose(t, f), transient.progress.steps, body.fes.ndof


def plain(dt: float, order: int, maxh: float) -> tuple[float, int, int]:
    """The peer: plain NGSolve, backward Euler, even steps, no line search, no cut-back."""
    mesh = block(SIZE, maxh)
    fes = ngs.VectorH1(mesh, order=order, dirichlet="bottom") * ngs.H1(mesh, order=order - 1)
    gfu, level = ngs.GridFunction(fes), ngs.Parameter(0.0)
    u, p = fes.TrialFunction()
    tensors = ngs.MatrixValued(ngs.L2(mesh, order=order), 3)
    pulls = [ngs.GridFunction(tensors) for _ in LAW.branches]
    over = [ngs.GridFunction(tensors) for _ in LAW.branches]
    shares = [1 / (1 + dt / branch.tau) for branch in LAW.branches]
    F = ngs.Id(3) + ngs.Grad(u)
    C = isochoric(F.trans * F)
    energy = LAW.density(Deformation.of_stretch(C), shares) + p * (ngs.Det(F) - 1) - p * p / (2 * BULK)
    energy += sum(0.5 * ngs.InnerProduct(pull, C) for pull in pulls)
    form = ngs.BilinearForm(fes)
    form += ngs.Variation(energy.Compile() * ngs.dx)
    plate = contact(level)
    form += ngs.Variation(plate.energy(u).Compile() * plate.measure())
    state = gfu.components[0]
    F = ngs.Id(3) + ngs.Grad(state)
    stresses = [branch.stress(isochoric(F.trans * F)).Compile() for branch in LAW.branches]
    t, f, old = [0.0], [0.0], [ngs.GridFunction(tensors) for _ in LAW.branches]
    for i in range(round(PROTOCOL.times[-1] / dt)):
        now = (i + 1) * dt
        level.Set(PROTOCOL.at(now))
        for pull, h, s, share in zip(pulls, over, old, shares, strict=True):
            pull.vec.data = share * h.vec - share * s.vec
        failed, _ = NgsolveNewton(form, gfu, freedofs=fes.FreeDofs(), maxit=30, maxerr=1e-9, printing=False)
        if failed or not np.all(np.isfinite(gfu.vec.FV().NumPy())):
            raise SolverError(f"no convergence at t = {now:g} s")
        for h, s, share, stress in zip(over, old, shares, stresses, strict=True):
            new = ngs.GridFunction(tensors)
            new.Set(stress)
            h.vec.data = share * (h.vec + new.vec - s.vec)
            s.vec.data = new.vec
        t.append(now)
        f.append(ngs.Integrate(plate.pressure(state) * plate.measure(), mesh))
    return dose(t, f), len(t) - 1, fes.ndof


def record(method: str, run: object, args: tuple, exact: float) -> dict:
    """One measurement; a failure is a record too."""
    start = time.process_time()
    out = {"method": method, "dt": args[0], "order": args[1], "maxh": args[2], "protocol": "continuous"}
    try:
        value, steps, ndof = run(*args)
        out |= {"ndof": ndof, "n_steps": steps, "error": abs(value / exact - 1), "converged": True}
    except Exception as error:
        out |= {"ndof": None, "n_steps": None, "error": None, "converged": False, "reason": str(error)[:120]}
    return out | {"cpu_s": time.process_time() - start}


def measure(quick: bool) -> list[dict]:
    """All records; `quick` stays under a minute."""
    steps = (2.0, 1.0, 0.5) if quick else (2.0, 1.0, 0.5, 0.25)
    grids = ((2, 0.02), (2, 0.01)) if quick else ((2, 0.02), (2, 0.01), (2, 0.007), (3, 0.01), (3, 0.007))
    exact, _, _ = ours(steps[-1] / 8, 3, 0.01 if quick else 0.005, 0.7)
    records = []
    for order, maxh in grids:
        for dt in steps:
            records.append(record("ngbrain:exponential", lambda *a: ours(*a, 0.7), (dt, order, maxh), exact))
        records.append(
            record("ngbrain:exponential, factor renewed", lambda *a: ours(*a, 0.0), (1.0, order, maxh), exact)
        )
        for dt in (1.0,) if quick else (1.0, 0.5):
            records.append(record("plain NGSolve, backward Euler", plain, (dt, order, maxh), exact))
    return records


def chart(records: list[dict], path: str) -> None:
    """Error against CPU time: a colour for each method, a mark for each grid; failures as crosses at the top edge."""
    plt = require("matplotlib.pyplot", "report")
    lines = require("matplotlib.lines", "report")
    figure, axes = plt.subplots(figsize=(8, 5), constrained_layout=True)
    top = 2 * max(r["error"] for r in records if r["converged"])
    grids = sorted({(r["order"], r["maxh"]) for r in records}, key=lambda grid: (grid[0], -grid[1]))
    colours = dict(zip(dict.fromkeys(r["method"] for r in records), ("#0072B2", "#56B4E9", "#D55E00"), strict=False))
    marks = dict(zip(grids, "osvd^DP*", strict=False))
    for method, colour in colours.items():
        for grid, mark in marks.items():
            rows = [r for r in records if r["method"] == method and (r["order"], r["maxh"]) == grid]
            good, bad = ([r for r in rows if r["converged"] is state] for state in (True, False))
            axes.loglog([r["cpu_s"] for r in good], [r["error"] for r in good], mark + "-", color=colour, ms=6)
            axes.loglog([r["cpu_s"] for r in bad], [top] * len(bad), "x", color=colour, ms=10)
    keys = [lines.Line2D([], [], color=colour, label=method) for method, colour in colours.items()]
    keys += [
        lines.Line2D([], [], color="grey", ls="", marker=mark, label=f"P{order}, {1e3 * maxh:g} mm")
        for (order, maxh), mark in marks.items()
    ]
    axes.legend(handles=keys, fontsize=8, ncols=2)
    axes.set(xlabel="CPU time (s)", ylabel="relative error of the dose", title="Pressing and holding relaxing tissue")
    axes.grid(alpha=0.3, which="both")
    figure.savefig(path, dpi=150)


def line(r: dict) -> str:
    """A record to read."""
    error = f"{r['error']:.1e}" if r["converged"] else "failed"
    return f"{r['method']:<36} P{r['order']} {1e3 * r['maxh']:3.0f} mm  dt {r['dt']:<5} {error:>8}  {r['cpu_s']:6.1f} s"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
