"""An hour under the blade on the real head: one hold of an hour, and six of about eight minutes with five releases between.

The demo's scene (5 mm in 10 s, Griffiths' constants) with elements of 9.5 mm far away (2 and 6 mm near), steps by their error at
a tolerance of .01, at most 2.5 s while the blade pushes and 600 s while it rests. Two studies:

run     each protocol on two threads, with the file that a restart goes on from: time on the clock and of the processors, steps,
        factorisations, peak and dose, how far tissue is inside the blade (of the opening), balance of work
steps   both on the fast demo's mesh, one thread, with these steps and with shorter ones; error: of the peak or of the
        dose, the larger; of one hold from steps with a 64th of the tolerance and a quarter of the length, of six from half of it

    python benchmarks/retraction_hour.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/retraction_hour.py --chart FILE.png < records.json

`--quick` is the study of steps of one hold alone, without the finest.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from _command import main

from ngbrain.errors import require
from ngbrain.forward import Control
from ngbrain.look import STYLE
from ngbrain.scene import Scene
from ngbrain.surgery import (
    ProtocolRun,
    RetractionModel,
    ToolMotion,
    answer,
    continuous_retraction,
    intermittent_retraction,
)
from ngbrain.threads import threads
from ngbrain.units import to_mmHg

HOUR, RAMP, HOLD, REST = 3600.0, 10.0, 490.0, 120.0
FAR, LONGEST = 9.5e-3, 600.0
ASKED_MIN = {"continuous": 10.0, "intermittent": 20.0}
"""Limit of the wall time (minutes) of each run."""
COLOURS = {"continuous": "#0072B2", "intermittent": "#D55E00"}


def model(name: str, **sizes: float) -> RetractionModel:
    """A shipped scene's head, with steps for an hour."""
    scene = Scene.shipped(name)
    time, mesh = replace(scene.time, max_step_hold=LONGEST), replace(scene.mesh, **sizes)
    return RetractionModel.from_scene(replace(scene, time=time, mesh=mesh))


def protocols(opening: float) -> tuple[ToolMotion, ToolMotion]:
    """The intermittent one is the same as the continuous one up to its first release."""
    return continuous_retraction(opening, RAMP, HOUR), intermittent_retraction(opening, RAMP, HOUR, HOLD, REST)


def went(on: RetractionModel, protocol: ToolMotion, control: Control | None, folder: Path | None) -> dict:
    """Record of a complete run, with the wall time (minutes) at the end of each step."""
    clock, processors, minutes = time.perf_counter(), time.process_time(), [0.0]
    run = ProtocolRun(on, protocol, folder, control=control)
    run.run(lambda *_: minutes.append((time.perf_counter() - clock) / 60))
    found, at, opening = answer(run.result(), on.scene.patient), run.transient.progress, on.scene.tool.travel
    last = run.rows[-1]
    return {
        "method": "ngbrain:transient",
        "protocol": protocol.name,
        "order": on.scene.mesh.order,
        "ndof": run.transient.problem.fes.ndof,
        "converged": True,
        "wall_s": time.perf_counter() - clock,
        "cpu_s": time.process_time() - processors,
        "n_steps": at.steps,
        "rejected": at.rejected,
        "newton": at.newton,
        "factorisations": at.work.factorisations,
        "peak_mmHg": found["peak_pressure_mmHg"],
        "dose_mmHg_min": found["dose_mmHg_min"],
        "inside": max(row.depth for row in run.rows) / opening,
        "deepest": max(-row.gap for row in run.rows) / opening,
        "work_balance": abs(last.blade_work - last.contact_energy - last.tissue_work) / last.tissue_work_size,
        "series": {
            "t_s": [row.t for row in run.rows],
            "mmHg": [float(to_mmHg(row.pressure)) for row in run.rows],
            "wall_min": minutes,
        },
    }


def measure(quick: bool) -> list[dict]:
    """All records."""
    return studied(quick) if quick else studied(quick) + hours()


def studied(quick: bool) -> list[dict]:
    """Effect of the step length on an hour: one hold with two kinds of shorter steps, six holds with half as long ones."""
    head = model("demo_fast")
    one, six = protocols(head.scene.tool.travel)
    asked, halved = head.control(), head.control().halve()
    two = {"asked": asked, "halved": halved}
    if quick:
        return compared(head, one, two)
    return compared(head, one, two | {"finest": halved.halve()}) + compared(head, six, two)


def compared(on: RetractionModel, protocol: ToolMotion, controls: dict[str, Control]) -> list[dict]:
    """Errors relative to the last record's peak and dose."""
    found = {name: went(on, protocol, control, None) for name, control in controls.items()}
    *_, finest = found.values()
    records = []
    for name, of in found.items():
        errors = {f"error_{key}": abs(of[key] / finest[key] - 1) for key in ("peak_mmHg", "dose_mmHg_min")}
        known = {"error": None} if of is finest else {"error": max(errors.values())} | errors
        records.append({"study": "steps", "steps": name, "threads": 1} | known | of)
    return records


def hours() -> list[dict]:
    """Both protocols."""
    records = []
    with threads(2):
        head = model("demo", largest=FAR)
        for protocol in protocols(head.scene.tool.travel):
            with tempfile.TemporaryDirectory() as folder:
                found = went(head, protocol, None, Path(folder))
            records.append({"study": "run", "threads": 2, "error": None} | found)
    return records


def chart(records: list[dict], path: str) -> None:
    """Pressure over the hour; wall time over the hour; error against computing time."""
    plt: Any = require("matplotlib.pyplot", "demo")
    plt.rcParams.update(STYLE)
    figure, (pressure, clock, steps) = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
    for r in (r for r in records if r["study"] == "run"):
        name, series = r["protocol"], r["series"]
        minutes = [t / 60 for t in series["t_s"]]
        look = {"color": COLOURS[name], "label": name}
        pressure.plot(minutes, series["mmHg"], lw=1.4, **look)
        clock.plot(minutes, series["wall_min"], lw=1.8, **look)
        clock.axhline(ASKED_MIN[name], color=COLOURS[name], lw=1, ls=":")
    of = [r for r in records if r["study"] == "steps" and r["error"] is not None]
    for name, colour in COLOURS.items():
        mine = [r for r in of if r["protocol"] == name]
        for key, marker, label in (("error_peak_mmHg", "o", "peak"), ("error_dose_mmHg_min", "s", "dose")):
            seconds, errors = [r["cpu_s"] for r in mine], [r[key] for r in mine]
            steps.plot(seconds, errors, marker=marker, color=colour, ms=5, label=f"{label}, {name}")
    steps.axhline(0.02, color="#666666", lw=1, ls=":")
    pressure.set(xlabel="minute of the protocol", ylabel="pressure on the patch (mmHg)", title="What the tissue bears")
    clock.set(
        xlabel="minute of the protocol",
        ylabel="minute on the clock, two threads",
        title="What it takes (dotted: asked)",
    )
    steps.set(yscale="log", xlabel="CPU time, fast mesh (s)", ylabel="relative error of the steps")
    steps.set_title("Steps (dotted: 2 %)")
    for axes in (pressure, clock, steps):
        axes.legend(fontsize=8, frameon=False)
        axes.grid(alpha=0.25, lw=0.6)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def line(r: dict) -> str:
    """One record as text."""
    text = f"{r['study']:<5} {r['protocol']:<12} {r.get('steps', ''):<7} {r['ndof']:6d} unknowns  {r['wall_s']:6.0f} s"
    text += f" ({r['cpu_s']:.0f} s of processors), {r['n_steps']} steps, {r['rejected']} again, {r['newton']} Newton"
    text += f", {r['factorisations']} factors  {r['peak_mmHg']:.1f} mmHg, {r['dose_mmHg_min']:.0f} mmHg min"
    text += f", inside {r['inside']:.2%}, deepest {r['deepest']:.2%}, work {r['work_balance']:.1e}"
    return text if r["error"] is None else f"{text}, error {r['error']:.2%}"


if __name__ == "__main__":
    main(__doc__ or "", measure, chart, line)
