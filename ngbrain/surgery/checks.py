"""What the numbers of a retraction are worth: time step, polynomial order, and the material's own uncertainty."""

from __future__ import annotations

from dataclasses import replace

from ngbrain.errors import SolverError
from ngbrain.forward.body import Body
from ngbrain.forward.transient import Progress, StepControl, Transient
from ngbrain.scene import Scene
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import NewtonRecord
from ngbrain.surgery.model import WALL, Model
from ngbrain.surgery.observe import Observer

MILLER_ALPHA = -4.7
"""Ogden exponent of Miller & Chinzei 2002, 10.1016/S0021-9290(01)00201-X, fitted over a wider range of strain."""
COARSE = {"site": 4e-3, "near": 10e-3, "far": 24e-3}
"""Element sizes (m) of the mesh on which one order more is affordable."""


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


def halved_steps_peak(scene: Scene) -> float:
    """Peak pressure (Pa) of the first opening at half the time step."""
    return ramp_peak(Model.of(scene), StepControl(scene.steps.contact, dt_max=scene.steps.longest).halved())


def miller_peak(scene: Scene) -> float:
    """Peak pressure (Pa) of the first opening with every exponent at -4.7 and the same moduli and times."""
    tissues = tuple(tissue.with_alpha(MILLER_ALPHA) for tissue in scene.tissues)
    return ramp_peak(Model.of(replace(scene, tissues=tissues)))


def order_peaks(scene: Scene) -> tuple[float, float]:
    """Patch pressure (Pa) at full opening on a coarse mesh, at the scene's order and one more.

    Elastic: the law that one step of the ramp's length from rest amounts to. The richer problem starts from the
    poorer one's solution, which it contains.
    """
    coarse = Model.of(
        replace(scene, body=replace(scene.body, **{k: max(v, getattr(scene.body, k)) for k, v in COARSE.items()}))
    )
    ramp = scene.retraction.ramp
    protocol, materials = coarse.ramp("elastic"), coarse.elastic(ramp)
    order = scene.body.order
    control = StepControl(ramp / 5)
    low = coarse.run(protocol, control, materials, order)
    low.run(lambda *_: None)
    high = coarse.run(protocol, control, materials, order + 1)
    for target, source in zip(high.body.gfu.components, low.body.gfu.components, strict=True):
        target.Interpolate(source)
    high.motion.set(ramp)
    high.body.history.begin(ramp)
    # Far from the solution in the corners, and worth many factorisations: there is no step to cut.
    high.newton = Newton(max_factorisations=40, min_damping=1e-3, max_iter=100)
    high.body.offsets = low.body.offsets
    x, record = high.solve(high.body.state.copy())
    if not record.converged:
        raise SolverError(f"the elastic step at order {order + 1} did not converge: {record.reason}")
    high.body.state[:] = x
    return _pressure(coarse, low), _pressure(coarse, high)


def _pressure(model: Model, transient: Transient) -> float:
    observe = Observer(transient.body, model.blade, WALL, model.scene.support.fixed)
    return observe(0.0, 0.0, 1.0).pressure
