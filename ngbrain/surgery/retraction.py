"""The main job: a scene's protocols and the checks of their worth, to the answers a team asks for."""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from ngsolve import ngsglobals

from ngbrain import pool
from ngbrain.errors import SolverError
from ngbrain.io import versions, write_json
from ngbrain.pool import Tell
from ngbrain.progress import Runs, logged, reporting
from ngbrain.scene import Scene
from ngbrain.surgery import answers, band, checks, response, worth
from ngbrain.surgery.model import Model
from ngbrain.surgery.protocols import Force, Protocol
from ngbrain.surgery.runs import Outcome, ProtocolRun

_CHECKS: dict[str, Callable[[Model, Path | None, bool, Tell], Any]] = {
    checks.ORDER: checks.one_order_more,
    checks.MESH: checks.other_elements,
    checks.HALF: checks.half_steps,
    checks.MILLER: checks.miller,
}
CHECKS = len(_CHECKS)
"""Runs beside the protocols', for a progress bar."""
PICTURES = "head.npz"
"""The scan and its labels, for the report."""
POLL = 0.2
"""Seconds between looks for a beginning that another process computes."""
_CHECK = "check: "
"""Before a check's name where it stands among protocols, whose names have no colon."""


@reporting(lambda given: Runs(len(given["scene"].protocols) + CHECKS))
def solve(
    scene: Scene, folder: str | Path | None = None, threads: int = 1, resume: bool = False, tell: Tell = logged
) -> dict[str, Any]:
    """Run every protocol of a scene and the checks; returns what `result.json` holds.

    scene      what to do (`Scene.from_toml`, `Scene.shipped`)
    folder     where run files (`NAME.vtkhdf`, restartable), those of the checks (`checks/`) and `result.json` go; None
               writes nothing
    threads    processes side by side; the last ones use the threads that are left over, and differ by round-off from one's results
    resume     go on from the run files in `folder`
    tell       called with (run, its time in s, share done) after every step

    Raises `InputError` for a scene that cannot be built and `SolverError` when a run gives up.

    Example, with a coarse mesh (about two minutes)::

        import ngbrain
        result = ngbrain.solve(ngbrain.Scene.shipped("idealised_fast"), threads=2)
        result["answers"]["continuous"]["peak_pressure_mmHg"]
    """
    started = time.perf_counter()
    ngsglobals.msg_level = 0
    where = None if folder is None else Path(folder)
    if where is not None:
        where.mkdir(parents=True, exist_ok=True)
    model = Model.of(scene)
    model.run(model.program(scene, scene.protocols[0]))  # refuses unknown regions and boundaries before hours are spent
    if where is not None:
        _write_pictures(where / PICTURES, model.head.pictures())
    with TemporaryDirectory() as shared:
        results = pool.run(_tasks(model, where, resume, Path(shared)), threads, tell)
    runs = {p.name: results[p.name] for p in scene.protocols}
    checked = {name: results[_CHECK + name] for name in _CHECKS}
    found = {name: answers.answer(run, scene.patient) for name, run in runs.items()}
    factors = [modulus / band.modulus_near_site(model, runs) for modulus in band.published_moduli().values()]
    errors = worth.errors(worth.hold(scene, found, checked), checked, factors, scene.patient)
    driven = {p.name: runs[p.name] for p in scene.protocols if p.kind != "force"}  # whose way the moduli do not change
    result = {
        "verb": "retract",
        "title": scene.title,
        "versions": versions(),
        "seed": 0,
        "threads": threads,
        "scene": scene.to_dict(),
        "head": model.head.describe(model.mesh),
        "geometry": _geometry(model),
        "model": answers.model(model, runs),
        "checks": worth.checks(scene, runs, errors),
        "answers": found,
        "worth": errors,
        "comparison": answers.comparison(runs, found),
        "dose_response": response.points(),
        "material_band": band.material_band(model, driven, checked[checks.MILLER], errors) if driven else {},
        "left_out": answers.left_out(model, runs),
        "time_s": time.perf_counter() - started,
    }
    if where is not None:
        write_json(where / "result.json", result)
    return result


def _tasks(model: Model, folder: Path | None, resume: bool, shared: Path) -> list[pool.Task]:
    """The longest first, so that the processes end together; last those that begin like another and go on from there."""
    scene = model.scene
    groups: dict[Any, list[Protocol | Force]] = {}
    for program in (model.program(scene, asked) for asked in scene.protocols):
        groups.setdefault(program.beginning, []).append(program)
    leading: list[pool.Task] = []
    following: list[pool.Task] = []
    for number, programs in enumerate(groups.values()):
        first, *others = sorted(programs, key=lambda p: -len(p.times))
        begun = shared / f"{number}.pickle"
        leading.append((first.name, _lead, (model, first, folder, resume, begun if others else None)))
        following += [(other.name, _follow, (model, other, folder, resume, begun)) for other in others]
    leading.sort(key=lambda task: -len(task[2][1].times))
    extra: list[pool.Task] = [(_CHECK + name, _check, (model, name, folder, resume)) for name in _CHECKS]
    return [*leading, *extra, *following]


def _lead(
    model: Model, program: Protocol | Force, folder: Path | None, resume: bool, begun: Path | None, tell: Tell
) -> Outcome:
    """A run; it leaves in a file how it stands after its first piece (None if it is past that), for those that follow."""
    run = ProtocolRun(model, program, folder, resume)
    with pool.helped(tell) as told:
        if begun is not None:
            within = run.transient.progress.t <= program.times[1]
            snapshot = run.go(told, program.times[1]).snapshot() if within else None
            part = begun.with_suffix(".part")
            part.write_bytes(pickle.dumps(snapshot))
            os.replace(part, begun)
        return run.go(told).outcome()


def _follow(
    model: Model, program: Protocol | Force, folder: Path | None, resume: bool, begun: Path, tell: Tell
) -> Outcome:
    """A run that goes on from where another, which was started before, stood after the piece that they share."""
    while not begun.exists():
        time.sleep(POLL)
    with pool.helped(tell) as told:
        return ProtocolRun(model, program, folder, resume, pickle.loads(begun.read_bytes())).go(told).outcome()


def _check(model: Model, name: str, folder: Path | None, resume: bool, tell: Tell) -> Any:
    if folder is not None:
        folder = folder / "checks"
        folder.mkdir(exist_ok=True)
    try:
        with pool.helped(tell) as told:
            value = _CHECKS[name](model, folder, resume, lambda _, t, share: told(_CHECK + name, t, share))
    except SolverError:  # what a check could not compute is reported as missing; the protocols' answers stand
        value = None
    tell(_CHECK + name, 0.0, 1.0)
    return value


def _write_pictures(path: Path, arrays: dict[str, np.ndarray]) -> None:
    if not arrays:
        path.unlink(missing_ok=True)
        return
    part = path.with_name(f".{path.stem}.{os.getpid()}.tmp.npz")
    try:
        np.savez_compressed(part, **arrays)  # type: ignore[arg-type]
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def _geometry(model: Model) -> dict[str, Any]:
    cleft, blade = model.cleft, model.scene.blade
    return {
        "target_m": cleft.target.tolist(),
        "out": cleft.out.tolist(),
        "across": cleft.across.tolist(),
        "along": cleft.along.tolist(),
        "depth_m": cleft.depth,
        "opening_m": cleft.opening,
        "width_m": cleft.width,
        "craniotomy_m": model.scene.cleft.craniotomy,
        "blade": {"kind": blade.kind}
        | {f"{f.name}_m": getattr(blade, f.name) for f in fields(blade) if f.name not in ("kind", "friction")},
    }
