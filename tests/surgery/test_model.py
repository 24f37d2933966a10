"""A head with a cleft: what must be true of forces on it, whatever the numbers."""

from dataclasses import replace
from types import SimpleNamespace as Namespace

import pytest

from ngbrain.forward.steps import ErrorControl
from ngbrain.scene import Scene, Steps
from ngbrain.surgery.model import Model
from ngbrain.surgery.protocols import Protocol
from ngbrain.surgery.runs import ProtocolRun, table
from ngbrain.threads import set_threads

PUSH = Protocol("push and let go", (0.0, 2.0, 6.0, 8.0), (0.0, 1e-3, 1e-3, -1e-3))


@pytest.mark.slow
def test_doubling_every_modulus_doubles_every_force():
    set_threads(1)
    scene = Scene.shipped("idealised_fast")
    twice = replace(scene, tissues=tuple(tissue.scaled(2.0) for tissue in scene.tissues))
    model = Model.of(scene)
    soft, stiff = (table(ProtocolRun(replace(model, scene=s), PUSH, None).go().rows) for s in (scene, twice))
    assert soft["force"].max() > 0.1
    assert stiff["force"] == pytest.approx(2 * soft["force"], rel=1e-6, abs=1e-6 * soft["force"].max())


def test_the_scene_chooses_the_steps():
    scene = Scene.shipped("idealised_fast")
    scene = replace(scene, steps=Steps(contact=2.0, longest=0.1, tolerance=1e-3))
    assert Model.control(Namespace(scene=scene)) == ErrorControl(
        1e-3, touch=0.1, longest=0.1, shortest=1e-3, pushing=2.0
    )
    scene = replace(scene, steps=Steps(contact=2.0, longest=100.0))
    assert Model.control(Namespace(scene=scene)) == ErrorControl(
        0.01, touch=0.2, longest=100.0, shortest=2e-3, pushing=2.0
    )
