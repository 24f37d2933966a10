"""Corners of a cleft. Naive: the pressure of a Taylor-Hood pair holds volume only in the mean over an element, so points
in corners collapse and the pressure is too low. Ours: a barrier that only such points feel."""

from dataclasses import replace

import pytest

from ngbrain.forward.transient.step_control import StepControl
from ngbrain.scene import Scene
from ngbrain.surgery.measures.observer import Observer
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.uncertainty.verification_runs import compare_orders
from ngbrain.threads import set_threads
from ngbrain.units import mmHg


def opened(model, share):
    """Pressure (Pa) and the smallest det F at full opening, elastic, with a share of the barrier."""
    ramp = model.scene.time.ramp
    materials = {name: replace(m, pointwise=share * m.pointwise) for name, m in model.elastic_materials(ramp).items()}
    run = model.run(model.ramp("opening"), StepControl(ramp / 10, first=0.05), materials)
    smallest = []
    run.run(lambda body, at, record: smallest.append(record.min_det_F))
    observe = Observer(run.problem, model.blades, model.fixed)
    return observe(0.0, 0.0, 1.0).pressure, min(smallest)


@pytest.mark.slow
def test_corners_keep_their_volume_and_the_pressure_is_that_of_one_order_more():
    set_threads(1)
    model = RetractionModel.from_scene(Scene.shipped("idealised_fast"))
    ours, third_order = (mmHg(found["peak_pressure_mmHg"]) for found in compare_orders(model))
    naive, collapsed = opened(model, 0.0)
    again, smallest = opened(model, 1.0)
    assert again == pytest.approx(ours, rel=0.01)
    assert collapsed < 0.5 and naive < 0.9 * third_order
    assert smallest > 0.7 and abs(ours / third_order - 1) < 0.04
