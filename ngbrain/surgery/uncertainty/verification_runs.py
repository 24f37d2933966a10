"""The runs that tell what the numbers of a retraction are worth: another time step, order, mesh, and exponent of the law.

All of them open once and hold to the end (`Model.hold`), so that every number of an `answer` has its like.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError, SolverError
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import Control, StepControl, StepperProgress
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.io import write_json
from ngbrain.io.state import load_state, save_state
from ngbrain.mesh.tet_mesh import centres
from ngbrain.parallel import Callback
from ngbrain.reading import read_json
from ngbrain.scene import MeshSize
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import NewtonRecord
from ngbrain.surgery.answers import Answer, answer
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.protocol_run import ProtocolRun

Point = tuple[float, np.ndarray]
"""Time (s) and all unknowns."""
Pair = tuple[Answer | None, Answer]
"""What a change starts from, None where that is the scene's own hold; and what it gives."""
ORDER, HALF, MESH, MILLER = "one order more", "half steps", "other elements", "Miller's exponent"
"""The checks' names,"""
WHOLE, OWN = "whole steps", "hold"
"""and those of what half steps and other elements are compared with."""
MILLER_ALPHA = -4.7
"""Ogden exponent of Miller & Chinzei 2002, 10.1016/S0021-9290(01)00201-X, fitted over a wider range of strain."""
COARSE = {"wall": 4e-3, "craniotomy": 10e-3, "largest": 26e-3}
"""Element sizes (m) of the mesh on which half steps and one order more are affordable."""
OTHER = math.sqrt(2)
"""How many times as large other elements are, everywhere; as small where a mesh is as coarse as `COARSE` at the site.

With 4, 2.8, 2 mm at the site the peak of a hold is 11.7, 4.0 and 1.1 % from that with 1.4 mm on MNI152, and this says 7.3, 6.8,
2.8 %; on the idealised head 4.8, 0.0, 1.8 %, and 4.8, 5.0, 1.8 % (`benchmarks/retraction_mesh.py`). Larger elements, 5.7 mm,
would say 2.5 % of the first.
"""
REACH = 25e-3
"""How far (m) from the cleft one order more is used: 15, 20, 25, 40 mm give 163, 160, 154, 154 mmHg on the fast idealised head."""
HALVINGS = 3
"""How often an increment of the richer solution may be cut."""


def half_steps(model: RetractionModel, folder: Path | None, resume: bool, callback: Callback) -> Pair:
    """On a coarse mesh, at the scene's time step and at half of it; the first is None if the model's mesh is no finer."""
    coarse, control = _coarse(model), model.control()
    whole = None if coarse is model else _held(coarse, WHOLE, folder, resume, _muted(callback, HALF), control)
    return whole, _held(coarse, HALF, folder, resume, callback, control.halve())


def other_elements(model: RetractionModel, folder: Path | None, resume: bool, callback: Callback) -> Pair:
    """On the scene's mesh, unless one of its protocols is that hold, and on one of other elements, see `OTHER`."""
    mesh = model.scene.mesh
    factor = OTHER if mesh.wall < COARSE["wall"] else 1 / OTHER
    other = replace(mesh, **{name: factor * getattr(mesh, name) for name in COARSE})
    holds = any(asked.kind == "continuous" for asked in model.scene.protocols)
    own = None if holds else _held(model, OWN, folder, resume, _muted(callback, MESH))
    return own, _held(_meshed(model, other), MESH, folder, resume, callback)


def miller_exponent(model: RetractionModel, folder: Path | None, resume: bool, callback: Callback) -> Answer:
    """With Ogden's law of exponent -4.7 in all tissue that stiffens, and the same moduli and times."""
    tissues = tuple(tissue.with_alpha(MILLER_ALPHA) for tissue in model.scene.tissues)
    return _held(replace(model, scene=replace(model.scene, tissues=tissues)), MILLER, folder, resume, callback)


def _coarse(model: RetractionModel) -> RetractionModel:
    """The same scene on a mesh that errors are affordable on."""
    scene = model.scene
    mesh = replace(scene.mesh, **{k: max(v, getattr(scene.mesh, k)) for k, v in COARSE.items()})
    return model if mesh == scene.mesh else _meshed(model, mesh)


def _meshed(model: RetractionModel, mesh: MeshSize) -> RetractionModel:
    """The same scene on another mesh. Where there is none a check is missing, not the whole result: raises `SolverError`."""
    try:
        return RetractionModel.from_scene(replace(model.scene, mesh=mesh), model.head)
    except InputError as error:
        raise SolverError(f"no mesh for a check: {error}") from error


def _held(
    model: RetractionModel,
    name: str,
    folder: Path | None,
    resume: bool,
    callback: Callback,
    control: Control | None = None,
) -> Answer:
    run = ProtocolRun(model, model.hold(name), folder, resume, control=control).go(callback)
    return answer(run.result(), model.scene.patient)


def _muted(callback: Callback, name: str) -> Callback:
    """Tells time but no share done, for what precedes a check."""
    return lambda _, t, __: callback(name, t, 0.0)


def one_order_more(model: RetractionModel, folder: Path | None, resume: bool, callback: Callback) -> Pair:
    """`orders`, kept in a file and taken from there on resume."""
    path, scene = None if folder is None else folder / f"{ORDER}.json", model.scene.to_dict()
    if resume and path is not None and path.exists():
        kept = read_json(path, "check")
        if isinstance(kept, dict) and kept.get("scene") == scene and len(kept.get("answers", ())) == 2:
            low, high = kept["answers"]
            return low, high
    callback(ORDER, 0.0, 0.0)
    found = compare_orders(model, path and path.with_suffix(".npz"), resume)
    if path is not None:
        write_json(path, {"scene": scene, "answers": found})
        path.with_suffix(".npz").unlink(missing_ok=True)
    return found


def compare_orders(model: RetractionModel, path: Path | None = None, resume: bool = False) -> tuple[Answer, Answer]:
    """At full opening, and nothing after it, on a coarse mesh: at the scene's order and one more.

    Elastic: the law that one step of the ramp's length from rest amounts to, so that the way there does not matter. One
    order more is used within `REACH` of the cleft; further out the tissue goes where the poorer solution has it. Where both
    stand is kept in `path` (.npz) after each step, and taken from there on resume.
    """
    coarse = _coarse(model)
    ramp, order = model.scene.time.ramp, model.scene.mesh.order
    protocol, control = coarse.ramp("elastic"), StepControl(ramp / 10, first=0.05)
    runs = [
        ProtocolRun(coarse, protocol, None, False, None, control, coarse.elastic_materials(ramp, k), k)
        for k in (order, order + 1)
    ]
    low, high = (run.transient for run in runs)
    for transient in (low, high):  # digits enough for a comparison in percent
        transient.newton = Newton(rtol=1e-4, xtol=1e-5, max_factorisations=20)
    high.problem.hold(coarse.cleft.distance_to_walls(centres(coarse.mesh)) > REACH)
    high.problem.begin(ramp)
    embedded, walls = ngs.GridFunction(high.problem.fes), coarse.mesh.Boundaries("|".join(coarse.blades))
    reached = (0.0, high.problem.x)
    scene = model.scene.to_dict()
    kept = load_state(path) if resume and path is not None and path.exists() else {}
    if kept.get("scene") == scene:
        low.restore(kept["low"])
        high.restore(kept["high"])
        high.problem.begin(ramp)
        reached = kept["reached"]

    def follow(body: Problem, at: StepperProgress, record: NewtonRecord) -> None:
        nonlocal reached
        for target, source in zip(embedded.components, body.gfu.components, strict=True):
            target.Interpolate(source)
        embedded.components[2].Interpolate(body.offset, definedon=walls)  # elsewhere there is none
        wanted = (at.t, np.array(embedded.vec.FV().NumPy()))
        _go(high, reached, wanted, HALVINGS)
        reached = wanted
        if at.t == protocol.times[-1]:
            for run in runs:
                run.look(run.transient.problem, at, record)
        elif path is not None:
            state = {"scene": scene, "low": low.checkpoint(), "high": high.checkpoint(), "reached": reached}
            save_state(path, state)

    low.run(follow)
    first, second = (answer(run.result(), model.scene.patient) for run in runs)
    return first, second


def _go(run: TimeStepper, start: Point, end: Point, halvings: int) -> None:
    """Take the solution along as another, of the same motion, goes from one point (t, all unknowns) to the next."""
    state = run.problem.x
    assert run.motion is not None  # a blade moves
    run.motion.set(end[0])
    run.problem.x, record = run.newton.solve(run, state + end[1] - start[1])
    if record.converged:
        return
    if not halvings:
        raise SolverError(f"{run.problem.element} at t = {end[0]:.2f} s: {record.reason}")
    run.problem.x = state
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    _go(run, start, middle, halvings - 1)
    _go(run, middle, end, halvings - 1)
