"""Error against time of pressing relaxing tissue: our stepping against plain NGSolve; steps, orders, meshes, contact penalty.

A 20 mm block on a rigid base (Ogden and Neo-Hooke, two relaxing branches, K/μ = 1000) is pressed by 3 mm in 4 s by a rigid plate
and held. The peers are what one would write in plain NGSolve: backward Euler or Crank-Nicolson for the branches,
`ngsolve.solvers.Newton` with a new factorisation every iteration, the plate as a penalty. Studies:

steps     half an hour on one mesh; error: of the peak force or of the dose ∫ force dt (a monotone cubic between events), the
          larger, relative to the same discretisation in space with steps by their error and a tolerance of 10⁻⁷. Steps are even,
          chosen beforehand or by their error; the peers take even ones, and those that ours chose by their error. `fewer`: how
          many even steps of ours have the same error, over these.
space     40 s; error: of the dose, relative to order 3 on a finer mesh with steps 8 times shorter; order 1 is displacements alone
penalty   40 s on one mesh; error: of the peak force, relative to a penalty of 3e11 Pa/m, with and without the contact's offset

    python benchmarks/retraction_time.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/retraction_time.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import _front
import numpy as np
from _command import main
from _relaxing import (
    PENALTY,
    Grid,
    Pressed,
    Rule,
    backward_euler,
    chosen,
    contact,
    crank_nicolson,
    even,
    evenly,
    exponential,
    ours,
    plain,
)

from ngbrain.errors import require
from ngbrain.forward import ErrorControl, StepControl
from ngbrain.surgery import ToolMotion, continuous_retraction

PROTOCOL, HALF_AN_HOUR = (
    continuous_retraction(3e-3, 4.0, 40.0),
    continuous_retraction(3e-3, 4.0, 1800.0, "half an hour"),
)
GRID = (2, 0.01)
"""Order and mesh of the studies of steps and of the penalty."""
SHARE, SOFTNESS = 0.98, 2e-6
"""Of the penetration, what the contact's offset makes up for, and where it sets in softly (m), which the offset leaves."""
PEERS: dict[str, Rule] = {"backward Euler": backward_euler, "Crank-Nicolson": crank_nicolson}
BY_ERROR, EVEN = "ngbrain:by error", "ngbrain:even"
Judge = Callable[[Pressed], dict]


def record(
    study: str, method: str, grid: Grid, run: Callable[[], Pressed], judge: Judge, protocol: ToolMotion, **more: Any
) -> dict:
    """One measurement; a failure is recorded too."""
    start = time.process_time()
    out = {"study": study, "method": method, "order": grid[0], "maxh": grid[1], "protocol": protocol.name, **more}
    try:
        found = run()
        out |= {"ndof": found.ndof, "n_steps": len(found.t) - 1, **judge(found), "converged": True}
    except Exception as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0][:120]
        out |= {"ndof": None, "n_steps": None, "error": None, "converged": False, "reason": reason}
    return out | {"cpu_s": time.process_time() - start}


def against(exact: Pressed) -> Judge:
    """Relative errors of the peak force and of the dose over half an hour; `error` is the larger."""

    def judge(found: Pressed) -> dict:
        peak = abs(found.force.max() / exact.force.max() - 1)
        dose = abs(found.dose(HALF_AN_HOUR) / exact.dose(HALF_AN_HOUR) - 1)
        return {"error": max(peak, dose), "peak_error": peak, "dose_error": dose}

    return judge


def steps(quick: bool) -> list[dict]:
    """Records of half an hour on one mesh."""
    grid, protocol = (2, 0.02) if quick else GRID, HALF_AN_HOUR
    exact = ours(ErrorControl(1e-5 if quick else 1e-7, touch=0.01), protocol, grid)
    peers_exact = plain(exponential, exact.t, protocol, grid)
    runs: list[tuple[str, dict, Callable[[], Pressed], Pressed]] = []
    controls: list[tuple[str, dict, Any]] = [
        (BY_ERROR, {"tolerance": each}, ErrorControl(each, touch=0.1))
        for each in ((1e-2, 1e-3) if quick else (3e-2, 1e-2, 1e-3, 1e-4, 1e-5))
    ]
    controls += [
        ("ngbrain:chosen beforehand", {"dt": dt}, StepControl(dt))
        for dt in ((2.0,) if quick else (2.0, 1.0, 0.5, 0.25))
    ]
    controls += [(EVEN, {"dt": dt}, even(dt)) for dt in ((4.0,) if quick else (4.0, 2.0, 1.0, 0.5))]
    runs += [(method, more, partial(ours, control, protocol, grid), exact) for method, more, control in controls]
    for name, rule in PEERS.items():
        peer = f"plain NGSolve, {name}"
        for dt in (30.0,) if quick else (4.0, 2.0, 1.0):
            runs.append((peer, {"dt": dt}, partial(plain, rule, evenly(dt, protocol), protocol, grid), peers_exact))
        for tolerance in (1e-2,) if quick else (1e-2, 1e-3, 1e-4, 1e-5):
            at = ours(ErrorControl(tolerance, touch=0.1), protocol, grid).t
            run = partial(plain, rule, at, protocol, grid)
            runs.append((f"{peer}, our steps", {"tolerance": tolerance}, run, peers_exact))
    found = [record("steps", m, grid, run, against(best), protocol, **more) for m, more, run, best in runs]
    for r in found:
        if r["method"] == BY_ERROR and r["converged"]:
            r["fewer"] = fewer(r, found)
    return found


def fewer(r: dict, records: list[dict]) -> float | None:
    """Even steps with a record's error over its own, straight between those measured on logarithmic axes; None beyond them."""
    known = sorted((x["error"], x["n_steps"]) for x in records if x["method"] == EVEN and x["converged"])
    if len(known) < 2 or not known[0][0] <= r["error"] <= known[-1][0]:
        return None
    errors, numbers = np.log(known).T
    return float(np.exp(np.interp(np.log(r["error"]), errors, numbers)) / r["n_steps"])


def space(quick: bool) -> list[dict]:
    """Records of orders and meshes, with sufficiently short steps."""
    exact = ours(chosen(1 / 8), PROTOCOL, (3, 0.01) if quick else (3, 0.005)).dose(PROTOCOL)

    def judge(found: Pressed) -> dict:
        return {"error": abs(found.dose(PROTOCOL) / exact - 1)}

    meshes = {1: (0.02, 0.007), 2: (0.02, 0.01)} if quick else {1: (0.02, 0.01, 0.007, 0.005)}
    meshes |= {} if quick else {2: (0.02, 0.01, 0.007, 0.005), 3: (0.02, 0.01, 0.007)}
    found = []
    for grid in [(order, maxh) for order, sizes in meshes.items() for maxh in sizes]:
        runs: list[tuple[str, Callable[[], Pressed]]] = []
        if grid[0] > 1:  # ours has a pressure of order k - 1
            runs += [("ngbrain:exponential", partial(ours, chosen(1.0), PROTOCOL, grid))]
            runs += [("ngbrain:exponential, factor renewed", partial(ours, chosen(1.0), PROTOCOL, grid, keep=0.0))]
        run = partial(plain, backward_euler, evenly(1.0, PROTOCOL), PROTOCOL, grid)
        runs += [("plain NGSolve, backward Euler", run)]
        found += [record("space", method, grid, run, judge, PROTOCOL, dt=1.0) for method, run in runs]
    return found


def penalty(quick: bool) -> list[dict]:
    """Records of the penalty stiffness, with and without the contact offset."""
    grid = (2, 0.02) if quick else GRID
    exact = ours(
        chosen(1.0), PROTOCOL, grid, plate=partial(contact, penalty=1e3 * PENALTY, softness=SOFTNESS)
    ).force.max()

    def judge(found: Pressed) -> dict:
        return {"error": abs(found.force.max() / exact - 1)}

    found = []
    for method, share in (("ngbrain:penalty alone", 0.0), ("ngbrain:penalty and offset", SHARE)):
        for times in (0.1, 1.0) if quick else (0.01, 0.1, 1.0, 10.0, 100.0):
            stiff = times * PENALTY
            run = partial(
                ours, chosen(1.0), PROTOCOL, grid, plate=partial(contact, penalty=stiff, share=share, softness=SOFTNESS)
            )
            found.append(record("penalty", method, grid, run, judge, PROTOCOL, dt=1.0, penalty=stiff))
    return found


def measure(quick: bool) -> list[dict]:
    """All records; `quick` takes less than a minute."""
    return steps(quick) + space(quick) + penalty(quick)


LOOKS = {
    BY_ERROR: ("#0072B2", "o-"),
    "ngbrain:chosen beforehand": ("#56B4E9", "o-"),
    EVEN: ("#009E73", "o-"),
    "plain NGSolve, backward Euler": ("#D55E00", "s-"),
    "plain NGSolve, Crank-Nicolson": ("#8c5a9b", "s-"),
    "plain NGSolve, backward Euler, our steps": ("#D55E00", "s:"),
    "plain NGSolve, Crank-Nicolson, our steps": ("#8c5a9b", "s:"),
    "ngbrain:exponential": ("#0072B2", "-"),
    "ngbrain:exponential, factor renewed": ("#56B4E9", "-"),
    "ngbrain:penalty alone": ("#E69F00", "o-"),
    "ngbrain:penalty and offset": ("#0072B2", "o-"),
}
MARKS = {1: "v", 2: "o", 3: "D"}
ORDERS = {2: "P2/P1", 3: "P3/P2"}


def chart(records: list[dict], path: str) -> None:
    """Error against CPU time and steps, of orders and meshes, of the contact; what failed is a cross on top."""
    plt, figure, ((first, second), (third, fourth)) = _front.figure(10.5, 8.4, 2, 2)
    held, meshes, plates = ([r for r in records if r["study"] == study] for study in ("steps", "space", "penalty"))
    for axes, x in ((first, "cpu_s"), (second, "n_steps")):
        for method in methods(held):
            drawn(axes, [r for r in held if r["method"] == method], x, *LOOKS[method], label=method)
        axes.set(ylabel="relative error of peak or dose")
    first.set(xlabel="CPU time, one thread (s)", title="Steps alone, half an hour")
    first.legend(fontsize=7)
    second.set(xlabel="steps", title="The same by number of steps")
    found = [f"{r['n_steps']} by error: {r['fewer']:.0f} times fewer than even" for r in held if r.get("fewer")]
    second.text(0.97, 0.04, "\n".join(found), ha="right", fontsize=8, transform=second.transAxes)
    for method in methods(meshes):
        colour, style = LOOKS[method]
        for order, mark in MARKS.items():
            rows = [r for r in meshes if r["method"] == method and r["order"] == order]
            drawn(third, rows, "cpu_s", colour, mark + style[-1])
            if method == "ngbrain:exponential":
                told(third, rows, "cpu_s", lambda r: f"{1e3 * r['maxh']:g}", above=order == 2)
    lines = require("matplotlib.lines", "report")
    keys = [lines.Line2D([], [], color=LOOKS[method][0], label=method) for method in methods(meshes)]
    keys += [lines.Line2D([], [], color="grey", ls="", marker=MARKS[k], label=name) for k, name in ORDERS.items()]
    third.legend(handles=keys, fontsize=7, loc="lower left")
    third.set(
        xlabel="CPU time, one thread (s)", ylabel="relative error of the dose", title="Orders and meshes (mm), 40 s"
    )
    for method in methods(plates):
        rows = [r for r in plates if r["method"] == method]
        drawn(fourth, rows, "penalty", *LOOKS[method], label=method)
        told(fourth, rows, "penalty", lambda r: f"{r['cpu_s']:.2f} s")
    fourth.legend(fontsize=7)
    fourth.set(xlabel="penalty (Pa/m), and CPU time at the marks", ylabel="relative error of the peak force")
    fourth.set_title("Contact, 40 s")
    for axes, rows in ((first, held), (second, held), (third, meshes), (fourth, plates)):
        errors = [r["error"] for r in rows if held_up(r)]
        axes.set_ylim(min(errors) / 2, (2 if len(errors) == len(rows) else 8) * max(errors))
        axes.grid(alpha=0.3)
    third.set_ylim(bottom=third.get_ylim()[0] / 6)  # room for what is what
    figure.savefig(path, dpi=150)
    plt.close(figure)


def methods(records: list[dict]) -> list[str]:
    """Records in the order of `LOOKS`."""
    return [method for method in LOOKS if any(r["method"] == method for r in records)]


def held_up(r: dict) -> bool:
    """Whether there is a result with an error below 100 %."""
    return r["converged"] and r["error"] < 1


def drawn(axes: Any, rows: list[dict], x: str, colour: str, style: str, label: str | None = None) -> None:
    """Of one method; what failed is a cross on top, with what came out."""
    good = [r for r in rows if held_up(r)]
    axes.loglog([r[x] for r in good], [r["error"] for r in good], style, color=colour, ms=5, label=label)
    for r in rows:
        if not held_up(r):
            at, top = r[x] or r["cpu_s"], axes.get_xaxis_transform()
            axes.plot(at, 0.96, "x", color=colour, ms=8, mew=2, transform=top)
            text = f"P{r['order']}\n× {1 + r['error']:.2g}" if r["converged"] else f"P{r['order']}\nfails"
            axes.text(at, 0.93, text, ha="center", va="top", fontsize=7, color=colour, transform=top)


def told(axes: Any, rows: list[dict], x: str, text: Callable[[dict], str], above: bool = True) -> None:
    """A few words at each mark."""
    for r in filter(held_up, rows):
        at = (5, 4) if above else (-3, -11)
        axes.annotate(text(r), (r[x], r["error"]), at, textcoords="offset points", fontsize=7)


def line(r: dict) -> str:
    """One record as text."""
    error = f"{r['error']:.1e}" if r["converged"] else "failed"
    more = " ".join(
        f"{name} {r[name]:g}" for name in ("dt", "tolerance", "penalty", "fewer") if r.get(name) is not None
    )
    where = f"{r['study']:<7} {r['method']:<42} P{r['order']} {1e3 * r['maxh']:3.0f} mm"
    return f"{where}  {r['n_steps']} steps {error:>8}  {r['cpu_s']:6.1f} s  {more}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
