"""What the gradient of a run of relaxing tissue costs, over the run itself and in memory.

A block of 2 cm that a plate presses by 2 mm in 1 s and holds for a minute. *cost*: the gradient of a sum of forces and
displacements by all parameters (fields of first order and numbers); `ratio` is its CPU time over that of a run from rest that is as
tightly converged; laws: one Neo-Hooke branch, two of Ogden's law, a Maxwell branch of it; the first with friction under
the plate, and with mass. `error`: the gradient along a random
direction against a central difference. Histories are kept at every √N-th step and states at all; at every step; or both at every
√N-th, with the steps between solved again. A product with second derivatives, along that direction, against a central difference
of gradients. *memory*: the same over the number of steps. Peer: one-sided differences, a
run for each unknown (their number times the run's time, not run). What is recovered with it: `inversion_relaxing.py`.

    python benchmarks/gradient_through_time.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/gradient_through_time.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import ngsolve as ngs
import numpy as np
from _command import main
from _front import figure

from ngbrain.forward import (
    Displacements,
    Force,
    Friction,
    Inertia,
    Material,
    Problem,
    RigidContact,
    RunLinearisation,
    RunModel,
    sensitivity,
)
from ngbrain.materials import Law, Maxwell, NeoHooke, Ogden, Prony, Viscous
from ngbrain.mesh import block
from ngbrain.surgery import Drive, ToolMotion

Record = dict
Parameter = sensitivity.transient.step.Parameter
Laws = Callable[[ngs.Mesh], tuple[Law | Viscous, dict[str, Parameter]]]
SIDE, STEP = 0.02, 1e-3
PRESS = ToolMotion("press", (0.0, 1.0, 61.0), (0.0, 2e-3, 2e-3))
POINTS = SIDE * np.random.default_rng(3).uniform(0.15, 0.85, (8, 3))
OURS = {
    "ngbrain:adjoint": {},
    "ngbrain:adjoint, all histories": {"every": 1},
    "ngbrain:adjoint, few states": {"states": False},
}
SECOND, DIFFERENCES = "ngbrain:second derivatives", "differences"
COLOURS = dict(zip((*OURS, SECOND), ("#0072B2", "#D55E00", "#009E73", "#999999"), strict=True))


def field(mesh: ngs.Mesh, value: float) -> ngs.GridFunction:
    """One that varies by a fifth."""
    made = ngs.GridFunction(ngs.H1(mesh, order=1))
    made.Set(value * (1 + 0.2 * ngs.sin(90 * ngs.x) * ngs.cos(70 * ngs.z)))
    return made


def one_branch(mesh: ngs.Mesh) -> tuple[Viscous, dict[str, Parameter]]:
    """Neo-Hooke's law."""
    p = {"mu": field(mesh, 1000.0), "g": ngs.Parameter(0.5), "tau": ngs.Parameter(3.0)}
    return Prony(NeoHooke(p["mu"]), [p["g"]], [p["tau"]]), p


def two_branches(mesh: ngs.Mesh) -> tuple[Viscous, dict[str, Parameter]]:
    """Ogden's law."""
    p = {"mu": field(mesh, 1000.0), "alpha": field(mesh, -12.0), "g": ngs.Parameter(0.4), "tau": ngs.Parameter(3.0)}
    return Prony(Ogden(p["mu"], p["alpha"]), [p["g"], 0.2], [p["tau"], 50.0]), p


def maxwell(mesh: ngs.Mesh) -> tuple[Viscous, dict[str, Parameter]]:
    """Ogden's law, in a Maxwell branch too."""
    p = {"spring": field(mesh, 700.0), "alpha": ngs.Parameter(-15.0), "eta": ngs.Parameter(2100.0)}
    return Viscous(Ogden(300.0, -12.0), (Maxwell(Ogden(p["spring"], p["alpha"]), p["eta"]),)), p


RUBS, HEAVY = "1 branch, friction", "1 branch, mass"
LAWS: dict[str, Laws] = {
    "1 branch": one_branch,
    "2 branches, Ogden": two_branches,
    "Maxwell, Ogden": maxwell,
    RUBS: one_branch,
    HEAVY: one_branch,
}


def grid(steps: int) -> np.ndarray:
    """Times (s): a third of the steps while the plate moves, the others ever longer."""
    pressing = max(steps // 3, 4)
    return np.concatenate([np.linspace(0, 1, pressing + 1), 1 + np.geomspace(0.2, 60, steps - pressing)])


def pressed(
    law: str, mesh: ngs.Mesh, materials: dict[str, Material], p: dict[str, Parameter], times: np.ndarray, **how
) -> RunModel:
    """The model: the plate's force and displacements of `POINTS` are seen at the end of every step."""
    drive = Drive(PRESS)
    contacts: list = [RigidContact("top", lambda x: SIDE - drive.parameter - x[2], 1e8, 2e-5)]
    observables = [Force("top", (0, 0, 1)), Displacements(POINTS)]
    if law == RUBS:
        p["friction"] = ngs.Parameter(0.2)
        contacts.append(Friction(contacts[0], p["friction"], 5e-5))
    if law == HEAVY:
        p["rho"] = ngs.Parameter(1e3)
    loads = [Inertia(p["rho"])] if law == HEAVY else []
    body = Problem(mesh, materials, {"bottom": 0}, loads, contacts, element="P2/P1")
    return RunModel(body, drive, times, p, observables, **how)


def cost(
    law: str, maxh: float, steps: int, case: str = "cost", methods: tuple[str, ...] = tuple(OURS)
) -> Iterator[Record]:
    """Run, gradient and memory of one law, mesh and number of steps."""
    mesh, times = block((SIDE,) * 3, maxh), grid(steps)
    for method in methods:
        tissue, p = LAWS[law](mesh)
        of = pressed(law, mesh, {"tissue": Material(tissue, 1e6)}, p, times, **OURS[method])
        theta, begun = of.theta, time.process_time()
        there = of.evaluate(theta)
        run, w = time.process_time() - begun, 1 / np.abs(there.data).max(axis=0)
        w = np.broadcast_to(w, there.data.shape)
        largest = [held_mb(of)]
        backwards = of.replay.backwards

        def watched(of: RunModel = of, backwards=backwards, largest: list[float] = largest):
            for step in backwards():
                largest.append(held_mb(of))
                yield step

        begun = time.process_time()
        slope = there.gradient(w)
        spent = time.process_time() - begun
        of.replay.backwards = watched
        there.gradient(w)
        made: Record = {
            "method": method,
            "case": case,
            "law": law,
            "order": 2,
            "ndof": of.body.fes.ndof,
            "steps": steps,
        }
        made |= {"unknowns": of.size, "run_s": run, "converged": True, "reason": ""}
        yield made | {
            "error": off(of, there, w, slope),
            "cpu_s": spent,
            "ratio": spent / run,
            "memory_mb": max(largest),
        }
        if case == "cost" and method == methods[0]:
            spent, error = twice(of, w)
            yield made | {"method": SECOND, "error": error, "cpu_s": spent, "ratio": spent / run, "memory_mb": None}
    nothing = {"error": None, "memory_mb": None, "converged": False}
    why = {"reason": "not run: its time is that of a run for each unknown"}
    own = {"method": DIFFERENCES, "case": case, "law": law, "order": 2, "ndof": of.body.fes.ndof, "steps": steps}
    yield own | {"unknowns": of.size, "cpu_s": of.size * run, "run_s": run, "ratio": float(of.size)} | nothing | why


def held_mb(of: RunModel) -> float:
    """What a replay holds (MB): histories, and states that are not the same array."""
    replay, arrays = of.replay, {}
    for state in (*(kept.state for kept in replay.checkpoints), *(step.start for step in replay._last)):
        for value in (state.x, *flat(state.internal)):
            arrays[id(value)] = value.nbytes
    for value in (*replay._states, *replay._known_states):
        arrays[id(value)] = value.nbytes
    return sum(arrays.values()) / 1e6


def flat(memory: object) -> Iterator[np.ndarray]:
    """All arrays in nested containers."""
    if isinstance(memory, np.ndarray):
        yield memory
    elif isinstance(memory, (dict, list)):
        for part in memory.values() if isinstance(memory, dict) else memory:
            yield from flat(part)


def along(of: RunModel) -> np.ndarray:
    """All parameters at random."""
    return of.theta * np.random.default_rng(2).normal(size=of.size)


def twice(of: RunModel, w: np.ndarray) -> tuple[float, float]:
    """CPU time (s) of a product with second derivatives, and how far it is from a central difference of gradients."""
    theta, direction = of.theta, along(of)
    there = of.evaluate(theta)
    _ = of.curvature  # made once
    begun = time.process_time()
    found = there.hvp(w, direction)
    spent = time.process_time() - begun
    up, down = (of.evaluate(theta + s * STEP * direction).gradient(w) for s in (1, -1))
    of.evaluate(theta)
    wanted = (up - down) / (2 * STEP)
    return spent, float(np.linalg.norm((found - wanted) * theta) / np.linalg.norm(wanted * theta))


def off(of: RunModel, there: RunLinearisation, w: np.ndarray, slope: np.ndarray) -> float:
    """Of the gradient from a central difference."""
    theta, direction = of.theta, along(of)
    up, down = (float(np.sum(w * of.evaluate(theta + s * STEP * direction).data)) for s in (1, -1))
    return float(abs((up - down) / (2 * STEP) / (slope @ direction) - 1))


def measure(quick: bool) -> list[Record]:
    """All laws on one mesh and one law on others; one law over the number of steps."""
    records = [r for law in LAWS for r in cost(law, 0.01 if quick else 0.005, 12 if quick else 24)]
    for maxh in () if quick else (0.0035, 0.0025):
        records += cost("1 branch", maxh, 24, methods=tuple(OURS)[:1])
    for steps in (9, 25) if quick else (16, 64, 256):
        records += cost("1 branch", 0.02 if quick else 0.01, steps, "memory")
    return records


def chart(records: list[Record], png: str) -> None:
    """Cost by law, memory over steps."""
    plt, made, (first, second) = figure(9.5, 4.4, 2)
    ours = [r for r in records if r["method"] in COLOURS]
    for k, method in enumerate(COLOURS):
        rows = [r for r in ours if r["method"] == method and r["case"] == "cost"]
        least = min(r["ndof"] for r in rows)
        rows = [r for r in rows if r["ndof"] == least]
        rows = [r for r in rows if r["law"] in LAWS]
        where = np.array([list(LAWS).index(r["law"]) for r in rows]) + 0.22 * (k - 1.5)
        first.bar(where, [r["ratio"] for r in rows], 0.2, color=COLOURS[method], label=method.partition(":")[2])
        for x, r in zip(where, rows, strict=True):
            first.text(x, r["ratio"], f"{r['ratio']:.2g}".lstrip("0"), ha="center", va="bottom", fontsize=7)
        rows = [r for r in ours if r["method"] == method and r["case"] == "memory"]
        second.loglog([r["steps"] for r in rows], [r["memory_mb"] for r in rows], "o-", color=COLOURS[method])
    first.set(
        xticks=range(len(LAWS)),
        xlim=(-0.6, len(LAWS) - 0.4),
        xticklabels=[law.replace(", ", "\n") for law in LAWS],
        ylabel="CPU time, gradient over run",
        title="Cost",
    )
    first.legend(fontsize=7)
    steps = sorted({r["steps"] for r in ours if r["case"] == "memory"})
    second.set_xticks(steps, [str(n) for n in steps])
    second.minorticks_off()
    second.set(xlabel="steps", ylabel="held (MB)", title="Memory, 1 branch")
    for axis in (first, second):
        axis.margins(y=0.15)
        axis.grid(axis="y", alpha=0.25)
    made.savefig(png, dpi=150)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    if r["method"] == DIFFERENCES:
        return f"{r['law']:20} {r['method']:30} {r['ndof']:6} unknowns, {r['steps']:4} steps: {r['ratio']:.0f} runs"
    held = "" if r["memory_mb"] is None else f" {r['memory_mb']:.1f} MB,"
    more = f"{r['cpu_s']:.2f} s, {r['ratio']:.2f} runs,{held} off by {r['error']:.1e}"
    return f"{r['law']:20} {r['method']:30} {r['ndof']:6} unknowns, {r['steps']:4} steps: {more}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
