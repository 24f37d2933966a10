"""Simulate an operation as described: all protocols of a scene, then the verification runs, to `result.json`."""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from ngsolve import ngsglobals

from ngbrain import parallel
from ngbrain.atomic import atomic_write
from ngbrain.errors import SolverError
from ngbrain.io import versions, write_json
from ngbrain.parallel import Callback, ProcessExecutor, Task, predicted_memory, share_threads
from ngbrain.progress import RunProgress, log_progress, reporting
from ngbrain.reading import read_json
from ngbrain.result import Status
from ngbrain.scene import Scene
from ngbrain.scene.result import SceneResult
from ngbrain.surgery import answers, relative_stiffness
from ngbrain.surgery.answers import Answer, Runs
from ngbrain.surgery.corridor import check_corridor
from ngbrain.surgery.measures import dose_response
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.plausibility import check_moduli
from ngbrain.surgery.protocol_run import ProtocolResult, ProtocolRun, Snapshot
from ngbrain.surgery.protocols import ForceProtocol, ToolMotion
from ngbrain.surgery.uncertainty import error_budget, material_uncertainty
from ngbrain.surgery.uncertainty.error_budget import COMPUTED, FAILED, NOT_COMPUTED, UNDER_WAY
from ngbrain.surgery.uncertainty.verification_runs import (
    HALF,
    MESH,
    MILLER,
    ORDER,
    half_steps,
    miller_exponent,
    one_order_more,
    other_elements,
)

_CHECKS: dict[str, Callable[[RetractionModel, Path | None, bool, Callback], Any]] = {
    ORDER: one_order_more,
    MESH: other_elements,
    HALF: half_steps,
    MILLER: miller_exponent,
}
CHECKS = len(_CHECKS)
"""Number of verification runs, for a progress bar."""
PICTURES = "head.npz"
"""The scan and its labels, for the report."""
_CHECK = "check: "
"""Prefix of a verification run's name among the tasks; names of protocols have no colon."""
_BEGINNING = "beginning: "
"""Prefix of the name of a beginning that several protocols share."""


@reporting(lambda given: RunProgress(len(given["scene"].protocols) + CHECKS * given["checks"]))
def solve(
    scene: Scene,
    folder: str | Path | None = None,
    threads: int = 1,
    resume: bool = False,
    callback: Callback = log_progress,
    checks: bool = True,
    checkpoint: Callable[[dict[str, Any]], None] | None = None,
    executor: parallel.AnyExecutor = None,
    store: Callable[[dict[str, Any]], None] | None = None,
    early: bool | None = None,
) -> SceneResult:
    """Run every protocol of a scene, then the verification runs.

    Parameters
    ----------
    scene : Scene
        The operation.
    folder : str or Path, optional
        Where run files (`NAME.vtkhdf`, restartable), those of the checks (`checks/`) and `result.json` go. `result.json` is
        written after the first protocol, and again after each other one and each check. None writes nothing.
    threads : int
        Number of processes. The last ones use the threads of finished ones; their results then differ by round-off.
    resume : bool
        Continue from the run files in `folder`.
    callback : callable, optional
        Called after every step with the name of the run, its time (s) and the fraction done.
    checks : bool
        Whether to compute the verification runs: error estimates of mesh, order and time step, and another exponent of the law.
    checkpoint : callable, optional
        Called with the present result after each protocol and after each check.
    executor : int or concurrent.futures.Executor, optional
        Computes protocols and checks (`ngbrain.parallel.run`), each on one thread and with the same bits for every executor; by
        default `threads` processes of this machine. Workers write the run files, and need access to `folder`.
    store : callable, optional
        Called with the result so far in place of writing `result.json`.
    early : bool, optional
        Whether the shortest protocol is first, so that there is an answer early, or the longest one, so that all are done early
        side by side. By default the shortest is first where they are computed one after the other.

    Returns
    -------
    SceneResult
        Reads as `result.json` does. `protocol_status` maps each protocol to "computed" or "under way", `check_status` each check to
        "computed", "failed", "under way" or "not computed"; an error estimate whose check is not computed is None.

    Raises
    ------
    InputError
        The scene cannot be built, or a shear modulus is implausible for brain.
    SolverError
        A protocol's run gives up.

    Examples
    --------
    With a coarse mesh (about two minutes)::

        import ngbrain
        result = ngbrain.simulate(ngbrain.Scene.shipped("idealised_fast"), threads=2)
        result["answers"]["continuous"]["peak_pressure_mmHg"]
    """
    started = time.perf_counter()
    ngsglobals.msg_level = 0
    where = None if folder is None else Path(folder).absolute()  # workers may have another working folder
    if where is not None:
        where.mkdir(parents=True, exist_ok=True)
    model = RetractionModel.from_scene(scene)
    warned = check_moduli(model) + check_corridor(model) + relative_stiffness.summary_lines(model.stiffness_map())
    model.run(model.program(scene, scene.protocols[0]))  # reports unknown regions and boundaries before the computation
    if where is not None:
        _write_pictures(where / PICTURES, model.head.pictures())
    protocols = [protocol.name for protocol in scene.protocols]
    ended, known, result = dict[str, Any](), dict[str, Any](), dict[str, Any]()
    kept = set(protocols) & _protocols_of(where / "result.json") if resume and where and store is None else set()

    def finished(name: str, outcome: Any) -> None:
        ended[name] = outcome
        runs = {protocol: ended[protocol] for protocol in protocols if protocol in ended}
        if name.startswith(_BEGINNING) or not runs or not kept <= runs.keys():
            return
        done = _with_protocols(model, runs)
        if name in runs:
            known.update({"warnings": [*warned, *scene.warnings]} | _of_protocols(done, runs, threads))
        checked = {check: ended.get(_CHECK + check) for check in _CHECKS}
        status = {check: _status(_CHECK + check, ended, checks) for check in _CHECKS}
        result.update(known | _of_checks(done, runs, known["answers"], checked, status))
        result["scene"] = scene.to_dict()
        result["protocol_status"] = {each: COMPUTED if each in runs else UNDER_WAY for each in protocols}
        result["time_s"] = time.perf_counter() - started
        if store is not None:
            store(result)
        elif where is not None:
            write_json(where / "result.json", result)
        if checkpoint:
            checkpoint(result)

    if early is None:
        early = threads == 1 if executor is None else executor == 1
    tasks = _tasks(model, where, resume, early, checks)
    if executor is None and threads > 1:
        with ProcessExecutor(threads, threads=threads) as processes:
            parallel.run(tasks, processes, callback=callback, finished=finished)
    else:
        parallel.run(tasks, executor, callback=callback, finished=finished)
    whole = all(protocol in ended for protocol in protocols)
    return SceneResult(result, status=Status.CONVERGED if whole else Status.STOPPED, warnings=known.get("warnings", []))


def _protocols_of(path: Path) -> set[str]:
    """The protocols whose answers a result has: a resumed run does not replace it by one of fewer."""
    found = read_json(path, "result") if path.exists() else {}
    answers = found.get("answers") if isinstance(found, dict) else None
    return set(answers) if isinstance(answers, dict) else set()


def _with_protocols(model: RetractionModel, names: Container[str]) -> RetractionModel:
    """The model with some of the scene's protocols only."""
    kept = tuple(asked for asked in model.scene.protocols if asked.name in names)
    return model if kept == model.scene.protocols else replace(model, scene=replace(model.scene, protocols=kept))


def _of_protocols(model: RetractionModel, runs: Runs, threads: int) -> dict[str, Any]:
    """The part of a result that does not depend on the verification runs."""
    scene, mapped = model.scene, model.stiffness_map()
    found = {name: answers.answer(run, scene.patient) for name, run in runs.items()}
    return {
        "verb": "simulate",
        "title": scene.title,
        "versions": versions(),
        "seed": 0,
        "threads": threads,
        "head": model.head.describe(model.mesh) | ({"shear_modulus_map": mapped} if mapped else {}),
        "geometry": geometry(model),
        "model": answers.model_summary(model, runs),
        "answers": found,
        "comparison": answers.comparison(runs, found),
        "dose_response": dose_response.dose_response_points(),
        "left_out": answers.model_limitations(model, runs),
    }


def _of_checks(
    model: RetractionModel,
    runs: Runs,
    found: Mapping[str, Answer],
    checked: Mapping[str, Any],
    status: Mapping[str, str],
) -> dict[str, Any]:
    """The part of a result that depends on the verification runs."""
    scene = model.scene
    factors = material_uncertainty.moduli_near_site(model, runs).factors.values()
    errors = error_budget.errors(error_budget.hold_answer(scene, found, checked), checked, factors, scene.patient)
    prescribed = {
        p.name: runs[p.name] for p in scene.protocols if p.kind != "force"
    }  # prescribed motion, independent of the moduli
    return {
        "check_status": status,
        "checks": error_budget.checks(scene, runs, errors),
        "error_budget": errors,
        "material_uncertainty": material_uncertainty.compute_material_uncertainty(
            model, prescribed, checked[MILLER], errors
        )
        if prescribed
        else {},
    }


def _status(task: str, ended: Mapping[str, Any], wanted: bool) -> str:
    if task in ended:
        return COMPUTED if ended[task] is not None else FAILED
    return UNDER_WAY if wanted else NOT_COMPUTED


def _tasks(
    model: RetractionModel, folder: Path | None, resume: bool, early: bool = False, checks: bool = True
) -> list[Task]:
    """Shared beginnings first, then protocols, the longest one first or last (`early`), then verification runs."""
    scene = model.scene
    groups: dict[Any, list[ToolMotion | ForceProtocol]] = {}
    for program in (model.program(scene, asked) for asked in scene.protocols):
        groups.setdefault(program.beginning, []).append(program)
    memory = predicted_memory("retraction", model.mesh.ne) if scene.mesh.order == 2 and model.mesh is not None else 0.0
    shared: list[Task] = []
    leading: list[Task] = []
    following: list[Task] = []
    for programs in groups.values():
        first, *others = sorted(programs, key=lambda p: -len(p.times))
        beginning = [_BEGINNING + first.name] if others else []
        shared += [Task(name, _run_first_piece, (model, first, folder, resume), memory=memory) for name in beginning]
        leading.append(Task(first.name, _run_protocol, (model, first, folder, resume), beginning, memory))
        following += [
            Task(other.name, _run_protocol, (model, other, folder, resume), beginning, memory) for other in others
        ]
    protocols = sorted([*leading, *following], key=lambda task: len(task.args[1].times), reverse=not early)
    after = [Task(_CHECK + name, _run_check, (model, name, folder, resume)) for name in _CHECKS if checks]
    return [*shared, *protocols, *after]


def _run_first_piece(
    model: RetractionModel,
    program: ToolMotion | ForceProtocol,
    folder: Path | None,
    resume: bool,
    *,
    callback: Callback,
) -> Snapshot | None:
    """State of a run after its first piece, None if it is past it; several protocols continue from it."""
    run = ProtocolRun(model, program, folder, resume)
    if run.transient.progress.t > program.times[1]:
        return None
    with share_threads(callback) as progress:
        return run.run(progress, program.times[1]).snapshot()


def _run_protocol(
    model: RetractionModel,
    program: ToolMotion | ForceProtocol,
    folder: Path | None,
    resume: bool,
    start: Snapshot | None = None,
    *,
    callback: Callback,
) -> ProtocolResult:
    """A run, from the end of a shared beginning if there is one."""
    with share_threads(callback) as progress:
        return ProtocolRun(model, program, folder, resume, start).run(progress).result()


def _run_check(model: RetractionModel, name: str, folder: Path | None, resume: bool, callback: Callback) -> Any:
    if folder is not None:
        folder = folder / "checks"
        folder.mkdir(exist_ok=True)
    try:
        with share_threads(callback) as progress:
            value = _CHECKS[name](model, folder, resume, lambda _, t, share: progress(_CHECK + name, t, share))
    except SolverError:  # a failed check is reported as missing; the protocols' answers are valid
        value = None
    callback(_CHECK + name, 0.0, 1.0)
    return value


def _write_pictures(path: Path, arrays: dict[str, np.ndarray]) -> None:
    if not arrays:
        path.unlink(missing_ok=True)
        return
    atomic_write(path, lambda part: np.savez_compressed(part, **arrays))  # type: ignore[arg-type]


def geometry(model: RetractionModel) -> dict[str, Any]:
    """Position and size of the cleft and the tool (m), for figures."""
    cleft, blade = model.cleft, model.scene.tool
    return {
        "target_m": cleft.target.tolist(),
        "out": cleft.out.tolist(),
        "across": cleft.across.tolist(),
        "along": cleft.along.tolist(),
        "depth_m": cleft.depth,
        "opening_m": cleft.opening,
        "width_m": cleft.width,
        "craniotomy_m": model.scene.operated.craniotomy_diameter,
        "blade": {"kind": blade.kind, "file": blade.file}
        | {f"{f.name}_m": getattr(blade, f.name) for f in fields(blade) if f.name not in ("kind", "friction", "file")},
    }
