"""First answers of `simulate --quick`: how fast they are there, and whether the refined ones lie in their intervals.

`record`: operations on the idealised head, drawn by seeds (target, tool, travel, tissue, protocol, elements), computed on the two
coarse meshes and as described; from them the package's record of intervals is made (`--out`). `test`: operations of other
seeds; `inside` says of each main answer whether that of the scene as described lies in the interval of the coarse one.
`error`: of the coarse peak pressure, relative to that of the scene as described.

    python benchmarks/quick_answers.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/quick_answers.py --out ngbrain/surgery/uncertainty/coarse_answers.json
    python benchmarks/quick_answers.py --chart FILE.png < records.json
"""

from __future__ import annotations

import json
import time
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill
from typing import Any

import numpy as np
from _command import main

from ngbrain import simulate
from ngbrain.errors import InputError, require
from ngbrain.look import STYLE
from ngbrain.mesh import Cleft, Sizes, idealised_head
from ngbrain.report import pages
from ngbrain.scene import CleftSpec, Geometry, MeshSize, Protocol, Scene, Time, Tissue, Tool
from ngbrain.surgery import IdealisedHead, ProtocolRun, RetractionModel, answer, quantities, uncertainty

coarse_answers = uncertainty.coarse_answers
MAIN = coarse_answers.MAIN

TRIES = 50
"""Draws until a scene is valid: a tool that fits into the cleft."""
RECORD, TEST = range(9), range(300, 310)
"""Seeds of the record, and of the scenes that it is tested on."""
HEADS = ("idealised_fast", "demo_fast", "demo")
"""Shipped scenes whose first report is timed."""
ALIKE = 3
"""Drawn scenes that share a cleft, so that it is meshed once."""
TARGET = np.array([17.0, 5.9, 26.2]) * 1e-3
"""Of the shipped scenes (m); drawn ones lie about it."""


def drawn(seed: int) -> Scene:
    """An operation on the idealised head, drawn by a seed; `ALIKE` of them share a cleft and its elements."""
    for attempt in range(TRIES):
        try:
            return _drawn(np.random.default_rng([seed // ALIKE, attempt]), np.random.default_rng([seed, attempt, 1]))
        except InputError:
            continue
    raise RuntimeError(f"no valid scene of seed {seed}")


def _drawn(of_cleft: np.random.Generator, rng: np.random.Generator) -> Scene:
    ramp = float(rng.choice([5.0, 10.0, 20.0]))
    end = ramp * float(rng.uniform(1.1, 2.0))
    mu, travel = float(np.exp(rng.uniform(np.log(300.0), np.log(2000.0)))), float(rng.uniform(1e-3, 5e-3))
    kind = str(rng.choice(["spatula", "spatula", "spatula", "two spatulas", "tube"]))
    staged = {"kind": "staged", "stages": 2, "rest": 0.5 * (end - ramp)}
    protocol = staged if rng.random() < 0.25 else {"kind": "continuous"}
    target = TARGET * of_cleft.uniform(0.85, 1.1) + of_cleft.uniform(-4e-3, 4e-3, 3)
    return Scene(
        title=f"drawn: {kind}",
        geometry=Geometry(kind="idealised"),
        mesh=MeshSize(wall=float(of_cleft.uniform(2.8e-3, 4e-3)), craniotomy=14e-3, largest=36e-3),
        tissues=(_tissue(rng, mu), Tissue(region="ventricle.*", mu=(50.0,), bulk_to_shear_ratio=10.0)),
        cleft=CleftSpec(target=tuple(target.tolist())),
        tools=(Tool(kind=kind, travel=travel, width=float(rng.uniform(8e-3, 11e-3))),),
        protocols=(Protocol(**protocol),),
        time=Time(ramp=ramp, end=end, max_step_contact=ramp / 4),
    )


def _tissue(rng: np.random.Generator, mu: float) -> Tissue:
    stiffens = rng.random() < 0.5
    alpha = float(rng.uniform(-19.0, -2.0))
    if rng.random() < 0.5:
        return Tissue(region="cortex|white", mu=(mu,), alpha=(alpha,) if stiffens else None, bulk_to_shear_ratio=1000.0)
    share, tau = float(rng.uniform(0.3, 0.7)), float(rng.uniform(2.0, 30.0))
    return Tissue(
        region="cortex|white",
        mu=((1 - share) * mu, share * mu),
        tau=(tau,),
        alpha=(alpha, alpha) if stiffens else None,
        bulk_to_shear_ratio=1000.0,
    )


class Head(IdealisedHead):
    """The idealised head, with the meshes that were made."""

    def __init__(self) -> None:
        super().__init__()
        self._made: dict[str, Any] = {}

    def open_cleft(self, cleft: Cleft, craniotomy: float, sizes: Sizes) -> Any:
        """Made once for equal arguments."""
        key = repr((vars(cleft), craniotomy, sizes))
        if key not in self._made:
            self._made[key] = idealised_head(cleft, craniotomy, sizes)
        return self._made[key]


HEAD = Head()


def computed(scene: Scene) -> tuple[dict[str, float], dict[str, float]]:
    """Main answers of a scene's protocol, and what they took."""
    begun, wall = time.process_time(), time.perf_counter()
    model = RetractionModel.from_scene(scene, HEAD)
    run = ProtocolRun(model, model.program(scene, scene.protocols[0]), None).run()
    found = answer(run.result(), scene.patient)
    work = {"ndof": run.transient.problem.fes.ndof, "cpu_s": time.process_time() - begun}
    return {name: found[name] for name in MAIN}, work | {"wall_s": time.perf_counter() - wall}


def three(seed: int) -> dict[str, Any]:
    """A drawn scene on the coarser mesh, on the coarse one and as described."""
    scene = drawn(seed)
    found = [
        computed(each)
        for each in (coarse_answers.coarse_scene(scene, coarser=True), coarse_answers.coarse_scene(scene), scene)
    ]
    answers = {name: [values[name] for values, _ in found] for name in MAIN}
    _, coarse, refined = answers["peak_pressure_mmHg"]
    return {
        "method": "ngbrain:quick",
        "seed": seed,
        "protocol": scene.protocols[0].kind,
        "tool": scene.tool.kind,
        "order": scene.mesh.order,
        "wall_mm": 1e3 * scene.mesh.wall,
        "ndof": found[1][1]["ndof"],
        "ndof_refined": found[2][1]["ndof"],
        "cpu_s": sum(work["cpu_s"] for _, work in found[:2]),
        "cpu_s_refined": found[2][1]["cpu_s"],
        "error": abs(coarse / refined - 1),
        "converged": True,
        "answers": answers,
    }


def judged(found: dict[str, Any], record: coarse_answers.CoarseRecord) -> dict[str, Any]:
    """A tested scene with its intervals, and whether each refined answer lies inside."""
    intervals = {name: record.interval(name, coarse, coarse, coarser) for name, (coarser, coarse, _) in of(found)}
    inside = {name: low <= refined <= high for name, (_, _, refined) in of(found) for low, high in [intervals[name]]}
    return found | {"study": "test", "intervals": intervals, "inside": inside, "all_inside": all(inside.values())}


def of(found: dict[str, Any]) -> list[tuple[str, list[float]]]:
    """Main answers with their three values."""
    return list(found["answers"].items())


class Stopped(Exception):  # noqa: N818  (it is no error)
    """The first report is there."""


def first_report(name: str) -> dict[str, Any]:
    """Time to the first report of a shipped scene, on one thread, with and without what is cached of its head."""
    scene, made = Scene.shipped(name), dict[str, Any]()
    for cache in ("without", "with"):
        begun, wall = time.process_time(), time.perf_counter()
        with TemporaryDirectory() as folder, suppress(Stopped):
            report = pages.retraction.Report(folder)

            def stop(found: dict[str, Any], report: Any = report) -> None:
                report.write()
                made["answers"] = found["first_answers"]["answers"]
                made["ndof"] = found["model"]["n_unknowns"]
                raise Stopped

            simulate(scene, folder, quick=True, checks=False, checkpoint=stop, callback=lambda *_: None)
        made[f"cpu_s_{cache}_cache"], made["wall_s"] = time.process_time() - begun, time.perf_counter() - wall
        if scene.geometry.kind == "idealised":  # nothing of it is cached
            break
    taken = made.get("cpu_s_with_cache", made["cpu_s_without_cache"])
    about = {"method": "ngbrain:quick", "study": "first report", "scene": name, "order": 2, "error": None}
    return about | {"converged": True, "cpu_s": taken, "threads": 1} | made


def measure(quick: bool, out: str | None) -> list[dict[str, Any]]:
    """All records; the package's record of intervals is written to `out`."""
    if quick:
        return [judged(three(TEST[0]), coarse_answers.shipped_record())]
    learnt = [three(seed) | {"study": "record"} for seed in RECORD]
    kept = [{name: each[name] for name in ("seed", "protocol", "tool", "wall_mm", "answers")} for each in learnt]
    text = json.dumps(
        {"made": datetime.now(UTC).date().isoformat(), "by": __file__.rpartition("/")[2], "scenes": kept}, indent=1
    )
    if out:
        Path(out).write_text(text + "\n")
    record = coarse_answers.CoarseRecord.from_text(text)
    return learnt + [judged(three(seed), record) for seed in TEST] + [first_report(name) for name in HEADS]


def chart(records: list[dict[str, Any]], path: str) -> None:
    """Refined over coarse answers of the tested scenes in their intervals, a panel for each answer."""
    plt: Any = require("matplotlib.pyplot", "demo")
    plt.rcParams.update(STYLE)
    tested = [r for r in records if r.get("study") == "test"]
    figure, panels = plt.subplots(1, len(MAIN), figsize=(3.0 * len(MAIN), 3.8), layout="constrained", sharey=True)
    for axes, name in zip(panels, MAIN, strict=True):
        for place, r in enumerate(tested):
            (low, high), (_, coarse, refined) = r["intervals"][name], r["answers"][name]
            axes.plot([low / coarse, high / coarse], [place, place], color="#9fb4c7", lw=5, solid_capstyle="butt")
            axes.plot(refined / coarse, place, "o", color="#0072B2" if r["inside"][name] else "#D55E00", ms=5)
        share = sum(r["inside"][name] for r in tested)
        axes.axvline(1.0, color="#4d4d4d", lw=0.8, ls=":")
        axes.set(
            xlabel="relative to the coarse answer",
            title=f"{fill(quantities.QUANTITIES[name].name, 30)}\n{share} of {len(tested)} inside",
        )
        axes.title.set_fontsize(9)
    panels[0].set_yticks(range(len(tested)), [f"{r['seed']}: {r['tool']}, {r['protocol']}" for r in tested], fontsize=8)
    every = sum(r["all_inside"] for r in tested)
    figure.suptitle(
        f"Refined answers (points) and intervals of the coarse ones; all inside in {every} of {len(tested)}",
        fontsize=10,
    )
    figure.savefig(path, dpi=150)
    plt.close(figure)


def line(r: dict[str, Any]) -> str:
    """A record to read."""
    if r["study"] == "first report":
        return f"first report of {r['scene']}: {r['cpu_s']:.0f} CPU s, {r['wall_s']:.0f} s"
    text = f"{r['study']:<7}{r['seed']:4d} {r['tool']:<13}{r['protocol']:<11}{r['wall_mm']:.2f} mm  "
    text += ", ".join(f"{name} " + " ".join(f"{value:.4g}" for value in values) for name, values in of(r))
    return text + (f"  inside: {sum(r['inside'].values())} of {len(MAIN)}" if "inside" in r else "")


if __name__ == "__main__":
    about = {"metavar": "FILE.json", "help": "where the package's record of intervals goes"}
    main(__doc__ or "", measure, chart, line, out=about)
