"""What the numbers of a retraction are worth: time step, polynomial order, and the material's own uncertainty."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import ngsolve as ngs
import numpy as np

from ngbrain.errors import SolverError
from ngbrain.forward.body import Body
from ngbrain.forward.steps import Control, Progress, StepControl
from ngbrain.forward.transient import Transient
from ngbrain.io import write_json
from ngbrain.mesh.elements import centres
from ngbrain.pool import Tell
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import NewtonRecord
from ngbrain.surgery.model import Model
from ngbrain.surgery.observe import Observer
from ngbrain.surgery.runs import ProtocolRun

Point = tuple[float, np.ndarray]
"""Time (s) and all unknowns."""
ORDER, HALF, MILLER = "one order more", "half steps", "Miller's exponent"
"""The checks' names,"""
WHOLE = "whole steps"
"""and what half steps are compared with."""
MILLER_ALPHA = -4.7
"""Ogden exponent of Miller & Chinzei 2002, 10.1016/S0021-9290(01)00201-X, fitted over a wider range of strain."""
COARSE = {"site": 4e-3, "near": 10e-3, "far": 26e-3}
"""Element sizes (m) of the mesh on which half steps and one order more are affordable."""
REACH = 25e-3
"""How far (m) from the cleft one order more is used: 15, 20, 25, 40 mm give 163, 160, 154, 154 mmHg on the fast idealised head."""
HALVINGS = 3
"""How often an increment of the richer solution may be cut."""


def half_steps(model: Model, folder: Path | None, resume: bool, tell: Tell) -> tuple[float | None, float]:
    """Peak pressure (Pa) of the first opening on a coarse mesh, at the scene's time step and at half of it.

    The first is None if the model's mesh is no finer: then it is the protocols' own.
    """
    coarse, control = _coarse(model), model.control()
    whole = None if coarse is model else _first_peak(coarse, WHOLE, folder, resume, _muted(tell, HALF), control)
    return whole, _first_peak(coarse, HALF, folder, resume, tell, control.halved())


def miller(model: Model, folder: Path | None, resume: bool, tell: Tell) -> float:
    """Peak pressure (Pa) of the first opening with every exponent at -4.7 and the same moduli and times."""
    tissues = tuple(tissue.with_alpha(MILLER_ALPHA) for tissue in model.scene.tissues)
    return _first_peak(replace(model, scene=replace(model.scene, tissues=tissues)), MILLER, folder, resume, tell)


def _coarse(model: Model) -> Model:
    """The same scene on a mesh that errors are affordable on."""
    scene = model.scene
    body = replace(scene.body, **{k: max(v, getattr(scene.body, k)) for k, v in COARSE.items()})
    return model if body == scene.body else Model.of(replace(scene, body=body), model.head)


def _first_peak(
    model: Model, name: str, folder: Path | None, resume: bool, tell: Tell, control: Control | None = None
) -> float:
    run = ProtocolRun(model, model.ramp(name), folder, resume, control=control).go(tell)
    return max(row.pressure for row in run.rows)


def _muted(tell: Tell, name: str) -> Tell:
    """Tells time but no share done, for what precedes a check."""
    return lambda _, t, __: tell(name, t, 0.0)


def one_order_more(model: Model, folder: Path | None, resume: bool, tell: Tell) -> tuple[float, float]:
    """`order_peaks`, kept in a file and taken from there on resume."""
    path, scene = None if folder is None else folder / f"{ORDER}.json", model.scene.to_dict()
    if resume and path is not None and path.exists():
        kept = json.loads(path.read_text())
        if kept["scene"] == scene:
            low, high = kept["pressure_Pa"]
            return low, high
    tell(ORDER, 0.0, 0.0)
    peaks = order_peaks(model)
    if path is not None:
        write_json(path, {"scene": scene, "pressure_Pa": peaks})
    return peaks


def order_peaks(model: Model) -> tuple[float, float]:
    """Patch pressure (Pa) at full opening on a coarse mesh, at the scene's order and one more.

    Elastic: the law that one step of the ramp's length from rest amounts to, so that the way there does not matter. One
    order more is used within `REACH` of the cleft; further out the tissue goes where the poorer solution has it.
    """
    coarse = _coarse(model)
    ramp, order = model.scene.retraction.ramp, model.scene.body.order
    protocol, control = coarse.ramp("elastic"), StepControl(ramp / 10, first=0.05)
    low, high = (coarse.run(protocol, control, coarse.elastic(ramp, k), k) for k in (order, order + 1))
    for run in (low, high):
        run.newton = Newton(rtol=1e-4, xtol=1e-5, max_factorisations=20)  # digits enough for a comparison in percent
    high.body.hold(coarse.cleft.distance_to_walls(centres(coarse.mesh)) > REACH)
    high.body.begin(ramp)
    embedded, walls = ngs.GridFunction(high.body.fes), coarse.mesh.Boundaries("|".join(coarse.blades))
    reached = (0.0, high.body.state)

    def follow(body: Body, at: Progress, record: NewtonRecord) -> None:
        nonlocal reached
        for target, source in zip(embedded.components, body.gfu.components, strict=True):
            target.Interpolate(source)
        embedded.components[2].Interpolate(body.offset, definedon=walls)  # elsewhere there is none
        wanted = (at.t, np.array(embedded.vec.FV().NumPy()))
        _go(high, reached, wanted, HALVINGS)
        reached = wanted

    low.run(follow)
    return _pressure(coarse, low), _pressure(coarse, high)


def _go(run: Transient, start: Point, end: Point, halvings: int) -> None:
    """Take the solution along as another, of the same motion, goes from one point (t, all unknowns) to the next."""
    state = run.body.state
    run.motion.set(end[0])
    run.body.state, record = run.newton.solve(run, state + end[1] - start[1])
    if record.converged:
        return
    if not halvings:
        raise SolverError(f"order {run.body.order} at t = {end[0]:.2f} s: {record.reason}")
    run.body.state = state
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    _go(run, start, middle, halvings - 1)
    _go(run, middle, end, halvings - 1)


def _pressure(model: Model, transient: Transient) -> float:
    observe = Observer(transient.body, model.blades, model.held)
    return observe(0.0, 0.0, 1.0).pressure
