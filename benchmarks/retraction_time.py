"""Error against time of pressing relaxing tissue: our stepping against plain NGSolve, several steps, orders and meshes.

A 20 mm block on a rigid base (Ogden and Neo-Hooke, two relaxing branches, K/μ = 1000) is pressed by 3 mm in 4 s by a
rigid plate and held. `continuous`: to 40 s; error: of the dose ∫ force dt (a monotone cubic between events), relative to order 3 on
a finer mesh with steps 8 times shorter. `half an hour`: to 1800 s on one mesh, so that errors are those of steps alone; error: of
the peak force, `dose_error`: of the dose, relative to steps by their error with a tolerance of 10⁻⁷. The peer is what one would
write in plain NGSolve: backward Euler for the branches, `ngsolve.solvers.Newton` with a new factorisation every iteration, the
plate as a penalty, even steps.

    python benchmarks/retraction_time.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/retraction_time.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import product
from typing import Any

import _front
import ngsolve as ngs
import numpy as np
from _command import main
from ngsolve.solvers import Newton as NgsolveNewton

from ngbrain.errors import SolverError, require
from ngbrain.forward.body import Body, Material
from ngbrain.forward.contact import Contact
from ngbrain.forward.steps import Control, ErrorControl, StepControl
from ngbrain.forward.transient import Transient
from ngbrain.materials import Branch, Deformation, NeoHooke, Ogden, Viscous
from ngbrain.mesh import block
from ngbrain.solvers.newton import Newton
from ngbrain.surgery.injury import curve
from ngbrain.surgery.protocols import Drive, Protocol, continuous
from ngbrain.tensors import isochoric

SIZE, BULK, PENALTY = (0.02, 0.02, 0.02), 1.5e6, 3e8
LAW = Viscous(Ogden(300.0, -12.0), (Branch(Ogden(700.0, -15.0), 2.3), Branch(NeoHooke(500.0), 500.0)))
PROTOCOL, HALF_AN_HOUR = continuous(3e-3, 4.0, 40.0), continuous(3e-3, 4.0, 1800.0, "half an hour")
GRID = (2, 0.01)
"""Order and mesh that half an hour is followed on."""
Forces = tuple[list[float], list[float], int]
"""Times (s), forces (N) and the number of unknowns."""
Grid = tuple[int, float]
Run = tuple[str, float | None, Callable[[], Forces]]
Judge = Callable[[list[float], list[float]], dict]


def contact(level: ngs.CoefficientFunction) -> Contact:
    """The plate: a half space above the block, `level` below the unloaded top."""
    return Contact("top", lambda x: SIZE[2] - level - x[2], PENALTY, 2e-5)


def dose(t: list[float], f: list[float], protocol: Protocol) -> float:
    """∫ force dt (N s) of a monotone cubic between events, which steps end on: holds are followed in few steps."""
    return float(curve(np.array(t), np.array(f), protocol.times).integrate(0.0, protocol.times[-1]))


def up_forces(space: ngs.FESpace) -> np.ndarray:
    """Nodal values of a unit translation along z."""
    gfu = ngs.GridFunction(space)
    gfu.Set(ngs.CF((0, 0, 1)))
    return np.array(gfu.vec.FV().NumPy())


def ours(control: Control, order: int, maxh: float, keep: float = 0.7, protocol: Protocol = PROTOCOL) -> Forces:
    """Our stepping; `keep` 0 renews the factorisation every iteration."""
    drive = Drive(protocol)
    body = Body(block(SIZE, maxh), {"tissue": Material(LAW, BULK)}, "bottom", [contact(drive.parameter)], order)
    up = up_forces(body.fes.components[0])
    newton = Newton(keep=keep, worth=round(9 * keep), max_factorisations=60)
    transient = Transient(body, drive, control, 1e-3, newton)
    t, f = [0.0], [0.0]

    def watch(b: Body, at: object, record: object) -> None:
        t.append(transient.progress.t)
        f.append(float(up @ b.contact_forces()))

    transient.run(watch)
    return t, f, body.fes.ndof


def chosen(dt: float) -> StepControl:
    """Steps of dt at most while the plate moves, and of 8 dt at most while it rests."""
    return StepControl(dt, dt_max=8 * dt)


def even(dt: float) -> StepControl:
    """All of dt."""
    return StepControl(dt, first=1.0, restart=1.0, growth=1.0, dt_max=dt)


def plain(dt: float, order: int, maxh: float, protocol: Protocol = PROTOCOL) -> Forces:
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
    for i in range(round(protocol.times[-1] / dt)):
        now = (i + 1) * dt
        level.Set(protocol.at(now))
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
    return t, f, fes.ndof


def record(
    method: str, dt: float | None, grid: Grid, run: Callable[[], Forces], judge: Judge, protocol: Protocol
) -> dict:
    """One measurement; a failure is a record too."""
    start = time.process_time()
    out = {"method": method, "dt": dt, "order": grid[0], "maxh": grid[1], "protocol": protocol.name}
    try:
        t, f, ndof = run()
        out |= {"ndof": ndof, "n_steps": len(t) - 1, **judge(t, f), "converged": True}
    except Exception as error:
        out |= {"ndof": None, "n_steps": None, "error": None, "converged": False, "reason": str(error)[:120]}
    return out | {"cpu_s": time.process_time() - start}


def pressed(quick: bool) -> list[dict]:
    """Forty seconds on several meshes."""
    steps = (2.0, 1.0, 0.5) if quick else (2.0, 1.0, 0.5, 0.25)
    grids = ((2, 0.02), (2, 0.01)) if quick else ((2, 0.02), (2, 0.01), (2, 0.007), (3, 0.01), (3, 0.007))
    exact = dose(*ours(chosen(steps[-1] / 8), 3, 0.01 if quick else 0.005)[:2], PROTOCOL)

    def judge(t: list[float], f: list[float]) -> dict:
        return {"error": abs(dose(t, f, PROTOCOL) / exact - 1)}

    records = []
    for g in grids:
        runs: list[Run] = [("ngbrain:exponential", dt, lambda g=g, dt=dt: ours(chosen(dt), *g)) for dt in steps]
        runs += [("ngbrain:exponential, factor renewed", 1.0, lambda g=g: ours(chosen(1.0), *g, 0.0))]
        runs += [
            ("plain NGSolve, backward Euler", dt, lambda g=g, dt=dt: plain(dt, *g))
            for dt in ((1.0,) if quick else (1.0, 0.5))
        ]
        records += [record(method, dt, g, run, judge, PROTOCOL) for method, dt, run in runs]
    return records


def held(quick: bool) -> list[dict]:
    """Half an hour on one mesh."""
    grid, protocol = (2, 0.02) if quick else GRID, HALF_AN_HOUR
    t, f, _ = ours(ErrorControl(1e-5 if quick else 1e-7, touch=0.01), *grid, protocol=protocol)
    peak, whole = max(f), dose(t, f, protocol)

    def judge(t: list[float], f: list[float]) -> dict:
        return {"error": abs(max(f) / peak - 1), "dose_error": abs(dose(t, f, protocol) / whole - 1)}

    def stepped(control: Control) -> Callable[[], Forces]:
        return lambda: ours(control, *grid, protocol=protocol)

    tolerances = (1e-2, 1e-3) if quick else (3e-2, 1e-2, 1e-3, 1e-4, 1e-5)
    runs: list[Run] = [("ngbrain:by error", None, stepped(ErrorControl(each, touch=0.1))) for each in tolerances]
    runs += [
        ("ngbrain:chosen beforehand", dt, stepped(StepControl(dt)))
        for dt in ((2.0,) if quick else (2.0, 1.0, 0.5, 0.25))
    ]
    runs += [("ngbrain:even", dt, stepped(even(dt))) for dt in ((4.0,) if quick else (4.0, 2.0, 1.0))]
    if not quick:
        runs += [
            ("plain NGSolve, backward Euler", dt, lambda dt=dt: plain(dt, *grid, protocol)) for dt in (4.0, 2.0, 1.0)
        ]
    return [record(method, dt, grid, run, judge, protocol) for method, dt, run in runs]


def measure(quick: bool) -> list[dict]:
    """All records; `quick` stays under a minute."""
    return pressed(quick) + held(quick)


def chart(records: list[dict], path: str) -> None:
    """Error against CPU time, failures as crosses at the top edge: meshes and steps, then steps alone against their number."""
    plt, figure, (left, middle, right) = _front.figure(14, 4.8, 3)
    short, long = ([r for r in records if r["protocol"] == p.name] for p in (PROTOCOL, HALF_AN_HOUR))
    grids = sorted({(r["order"], r["maxh"]) for r in short}, key=lambda grid: (grid[0], -grid[1]))
    marks = dict(zip(grids, "osvd^DP*", strict=False))
    for (method, colour), grid in product(colours(short).items(), grids):
        rows = [r for r in short if r["method"] == method and (r["order"], r["maxh"]) == grid]
        drawn(left, rows, "cpu_s", marks[grid] + "-", colour)
    lines = require("matplotlib.lines", "report")
    keys = [lines.Line2D([], [], color=colour, label=method) for method, colour in colours(short).items()]
    keys += [
        lines.Line2D([], [], color="grey", ls="", marker=mark, label=f"P{order}, {1e3 * maxh:g} mm")
        for (order, maxh), mark in marks.items()
    ]
    left.legend(handles=keys, fontsize=7, ncols=2, loc="upper right")
    left.set_ylim(top=4 * max(r["error"] for r in short if r["converged"]))
    left.set(xlabel="CPU time (s)", ylabel="relative error of the dose", title="Meshes and steps, 40 s")
    for axes, x in ((middle, "cpu_s"), (right, "n_steps")):
        for method, colour in colours(long).items():
            drawn(axes, [r for r in long if r["method"] == method], x, "o-", colour, method)
    middle.legend(fontsize=7)
    middle.set(xlabel="CPU time (s)", ylabel="relative error of the peak force", title="Steps alone, half an hour")
    right.set(xlabel="steps", ylabel="relative error of the peak force", title="The same by number of steps")
    for axes in (left, middle, right):
        axes.grid(alpha=0.3, which="both")
    figure.savefig(path, dpi=150)
    plt.close(figure)


def colours(records: list[dict]) -> dict[str, str]:
    """Method → colour."""
    found = ("#0072B2", "#56B4E9", "#009E73", "#D55E00")
    methods = list(dict.fromkeys(r["method"] for r in records))
    return {method: found[-1] if method.startswith("plain") else found[k] for k, method in enumerate(methods)}


def drawn(axes: Any, rows: list[dict], x: str, style: str, colour: str, label: str | None = None) -> None:
    """Of one method; what failed is a cross on top."""
    good, bad = ([r for r in rows if r["converged"] is state] for state in (True, False))
    axes.loglog([r[x] for r in good], [r["error"] for r in good], style, color=colour, ms=5, label=label)
    for r in bad:
        axes.plot(r["cpu_s"], 0.97, "x", color=colour, ms=9, transform=axes.get_xaxis_transform())


def line(r: dict) -> str:
    """A record to read."""
    error = f"{r['error']:.1e}" if r["converged"] else "failed"
    step = "" if r["dt"] is None else f"dt {r['dt']}"
    where = f"{r['method']:<36} P{r['order']} {1e3 * r['maxh']:3.0f} mm"
    return f"{where}  {step:<8} {r['n_steps']} steps {error:>8}  {r['cpu_s']:6.1f} s"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
