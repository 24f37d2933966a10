"""Verification runs of a retraction: another time step, element order, mesh, and exponent of the law.

All of them open once and hold to the end (`RetractionModel.hold`), so that every number of an `answer` has a counterpart.
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
"""The answer before a change, None where that is the scene's own hold; and after it."""
ORDER, HALF, MESH, MILLER = "one order more", "half steps", "other elements", "Miller's exponent"
"""Names of the verification runs."""
WHOLE, OWN = "whole steps", "hold"
"""Names of the reference runs for half steps and other elements."""
MILLER_ALPHA = -4.7
"""Ogden exponent of Miller & Chinzei 2002, 10.1016/S0021-9290(01)00201-X, fitted over a wider range of strain."""
COARSE = {"wall": 4e-3, "craniotomy": 10e-3, "largest": 26e-3}
"""Element sizes (m) of the mesh on which half steps and one order more are affordable."""
OTHER = math.sqrt(2)
"""Size ratio of the other elements, everywhere; larger ones, or smaller ones where the mesh is as coarse as `COARSE` at the site.

With 4, 2.8, 2 mm at the site the peak of a hold is 11.7, 4.0 and 1.1 % from that with 1.4 mm on MNI152, and this estimate gives
7.3, 6.8, 2.8 %; on the idealised head the errors are 4.8, 0.0, 1.8 %, the estimates 4.8, 5.0, 1.8 %
(`benchmarks/retraction_mesh.py`). Larger elements, 5.7 mm, would give 2.5 % for the first.
"""
REACH = 25e-3
"""Distance (m) from the cleft within which one order more is used: 15, 20, 25, 40 mm give 163, 160, 154, 154 mmHg on the fast
idealised head.
"""
HALVINGS = 3
"""Maximum number of halvings of an increment of the higher-order solution."""


def half_steps(model: RetractionModel, folder: Path | None, resume: bool, callback: Callback) -> Pair:
    """A hold with the scene's time step and with half of it, on a coarse mesh.

    Parameters
    ----------
    model : RetractionModel
    folder : Path, optional
        Where run files go.
    resume : bool
        Continue from them.
    callback : callable
        Progress: name, time (s), fraction done.

    Returns
    -------
    tuple of dict
        Answers; the first is None if the model's own mesh is used.
    """
    coarse, control = _coarse(model), model.control()
    whole = (
        None
        if coarse is model
        else _run_hold(coarse, WHOLE, folder, resume, _without_fraction(callback, HALF), control)
    )
    return whole, _run_hold(coarse, HALF, folder, resume, callback, control.halve())


def other_elements(model: RetractionModel, folder: Path | None, resume: bool, callback: Callback) -> Pair:
    """A hold on the scene's mesh, unless a protocol is that hold, and on other elements (`OTHER`).

    Parameters
    ----------
    model, folder, resume, callback
        See `half_steps`.

    Returns
    -------
    tuple of dict
        Answers; the first is None if a protocol is that hold.
    """
    mesh = model.scene.mesh
    other = other_mesh(mesh)
    holds = any(asked.kind == "continuous" for asked in model.scene.protocols)
    own = None if holds else _run_hold(model, OWN, folder, resume, _without_fraction(callback, MESH))
    return own, _run_hold(_with_mesh(model, other), MESH, folder, resume, callback)


def miller_exponent(model: RetractionModel, folder: Path | None, resume: bool, callback: Callback) -> Answer:
    """A hold with Ogden's law of exponent -4.7 in all tissue that stiffens, with the same moduli and relaxation times.

    Parameters
    ----------
    model, folder, resume, callback
        See `half_steps`.

    Returns
    -------
    dict
        Its answer.
    """
    tissues = tuple(tissue.with_alpha(MILLER_ALPHA) for tissue in model.scene.tissues)
    return _run_hold(replace(model, scene=replace(model.scene, tissues=tissues)), MILLER, folder, resume, callback)


def other_mesh(mesh: MeshSize) -> MeshSize:
    """The mesh that shows the error of elements: sizes times or over `OTHER`.

    >>> round(1e3 * other_mesh(MeshSize(wall=3e-3)).wall, 2), round(1e3 * other_mesh(MeshSize(wall=4e-3)).wall, 2)
    (4.24, 2.83)
    """
    return mesh.with_scale(OTHER if mesh.wall < COARSE["wall"] else 1 / OTHER)


def _coarse(model: RetractionModel) -> RetractionModel:
    """The same scene on an affordable mesh."""
    scene = model.scene
    mesh = scene.mesh.with_minimum(COARSE)
    return model if mesh == scene.mesh else _with_mesh(model, mesh)


def _with_mesh(model: RetractionModel, mesh: MeshSize) -> RetractionModel:
    """The same scene on another mesh; `SolverError` where there is none, so that only this verification run is missing."""
    try:
        return RetractionModel.from_scene(replace(model.scene, mesh=mesh), model.head)
    except InputError as error:
        raise SolverError(f"no mesh for a check: {error}") from error


def _run_hold(
    model: RetractionModel,
    name: str,
    folder: Path | None,
    resume: bool,
    callback: Callback,
    control: Control | None = None,
) -> Answer:
    run = ProtocolRun(model, model.hold(name), folder, resume, control=control).run(callback)
    return answer(run.result(), model.scene.patient)


def _without_fraction(callback: Callback, name: str) -> Callback:
    """Reports time but no fraction done, for a reference run."""
    return lambda _, t, __: callback(name, t, 0.0)


def one_order_more(model: RetractionModel, folder: Path | None, resume: bool, callback: Callback) -> Pair:
    """`compare_orders`, stored in a file and read from it on resume.

    Parameters
    ----------
    model, folder, resume, callback
        See `half_steps`.

    Returns
    -------
    tuple of dict
        Answers of the scene's order and of one order more.
    """
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
    """Answers at full opening with the scene's element order and with one order more, on a coarse mesh.

    The tissue is elastic, with the law that a single step of the ramp's length from rest gives, so that the loading path does not
    matter. One order more is used within `REACH` of the cleft; farther away the displacement of the lower order is prescribed.

    Parameters
    ----------
    model : RetractionModel
    path : Path, optional
        File (.npz) for the state of both solutions after each step.
    resume : bool
        Continue from it.

    Returns
    -------
    tuple of dict
        Answers of the scene's order and of one order more.
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
        _continue_along(high, reached, wanted, HALVINGS)
        reached = wanted
        if at.t == protocol.times[-1]:
            for run in runs:
                run.record_state(run.transient.problem, at, record)
        elif path is not None:
            state = {"scene": scene, "low": low.checkpoint(), "high": high.checkpoint(), "reached": reached}
            save_state(path, state)

    low.run(follow)
    first, second = (answer(run.result(), model.scene.patient) for run in runs)
    return first, second


def _continue_along(run: TimeStepper, start: Point, end: Point, halvings: int) -> None:
    """Continue a solution along another one of the same motion, from one point (t, all unknowns) to the next."""
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
    _continue_along(run, start, middle, halvings - 1)
    _continue_along(run, middle, end, halvings - 1)
