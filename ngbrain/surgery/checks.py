"""What the numbers of a retraction are worth: time step, polynomial order, and the material's own uncertainty."""

from __future__ import annotations

from dataclasses import replace

import ngsolve as ngs
import numpy as np

from ngbrain.errors import SolverError
from ngbrain.forward.body import Body
from ngbrain.forward.transient import Progress, StepControl, Transient
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import NewtonRecord
from ngbrain.surgery.model import WALL, Model
from ngbrain.surgery.observe import Observer

MILLER_ALPHA = -4.7
"""Ogden exponent of Miller & Chinzei 2002, 10.1016/S0021-9290(01)00201-X, fitted over a wider range of strain."""
COARSE = {"site": 4e-3, "near": 14e-3, "far": 36e-3}
"""Element sizes (m) of the mesh on which one order more is affordable,"""
REACH = 15e-3
"""and how far (m) from the cleft it is used."""


def ramp_peak(model: Model, control: StepControl | None = None) -> float:
    """Peak patch pressure (Pa) of the first opening."""
    protocol = model.ramp("ramp")
    transient = model.run(protocol, control)
    observe = Observer(transient.body, model.blade, WALL, model.scene.support.fixed)
    peak = 0.0

    def watch(body: Body, at: Progress, record: NewtonRecord) -> None:
        nonlocal peak
        peak = max(peak, observe(at.t, protocol.at(at.t), record.min_det_F).pressure)

    transient.run(watch)
    return peak


def halved_steps_peak(model: Model) -> float:
    """Peak pressure (Pa) of the first opening at half the time step."""
    steps = model.scene.steps
    return ramp_peak(model, StepControl(steps.contact, dt_max=steps.longest).halved())


def miller_peak(model: Model) -> float:
    """Peak pressure (Pa) of the first opening with every exponent at -4.7 and the same moduli and times."""
    tissues = tuple(tissue.with_alpha(MILLER_ALPHA) for tissue in model.scene.tissues)
    return ramp_peak(replace(model, scene=replace(model.scene, tissues=tissues)))


def order_peaks(model: Model) -> tuple[float, float]:
    """Patch pressure (Pa) at full opening on a coarse mesh, at the scene's order and one more.

    Elastic: the law that one step of the ramp's length from rest amounts to, so that the way there does not matter. One
    order more is used within `REACH` of the cleft; further out the tissue goes where the poorer solution has it.
    """
    scene = model.scene
    body = replace(scene.body, **{k: max(v, getattr(scene.body, k)) for k, v in COARSE.items()})
    coarse = model if body == scene.body else Model.of(replace(scene, body=body))
    ramp, order = scene.retraction.ramp, scene.body.order
    protocol, materials = coarse.ramp("elastic"), coarse.elastic(ramp)
    control = StepControl(ramp / 10, first=0.05)
    low, high = (coarse.run(protocol, control, materials, k) for k in (order, order + 1))
    for run in (low, high):
        run.newton = Newton(rtol=1e-4, xtol=1e-5, max_factorisations=20)  # digits enough for a comparison in percent
    high.body.hold(coarse.cleft.distance_to_walls(_centres(coarse.mesh)) > REACH)
    high.body.history.begin(ramp)
    embedded, before = ngs.GridFunction(high.body.fes), np.zeros(high.body.fes.ndof)

    def follow(body: Body, at: Progress, record: NewtonRecord) -> None:
        nonlocal before
        for target, source in zip(embedded.components, body.gfu.components, strict=True):
            target.Interpolate(source)
        now = embedded.vec.FV().NumPy().copy()
        high.motion.set(at.t)
        x, record = high.solve(high.body.state + now - before)
        if not record.converged:
            raise SolverError(f"order {order + 1} at {1e3 * protocol.at(at.t):.2f} mm: {record.reason}")
        high.body.state[:], before = x, now

    low.run(follow)
    return _pressure(coarse, low), _pressure(coarse, high)


def _centres(mesh: ngs.Mesh) -> np.ndarray:
    return np.array([np.mean([mesh[v].point for v in element.vertices], axis=0) for element in mesh.Elements()])


def _pressure(model: Model, transient: Transient) -> float:
    observe = Observer(transient.body, model.blade, WALL, model.scene.support.fixed)
    return observe(0.0, 0.0, 1.0).pressure
