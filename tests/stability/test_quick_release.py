"""A blade that opens and lets go faster than the longest step of a scene. Naive: steps by their error alone, of which one covers
half of the way back, and the work is wrong by what is lost as the blade leaves. Ours: no step goes further than a quarter of
the opening, or an eighth back."""

from dataclasses import replace

import numpy as np
import pytest

from ngbrain.scene import Protocol, Scene
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.protocol_run import ProtocolRun
from ngbrain.threads import set_threads


def lost(model, control):
    """Share of the work that is not in balance when the blade has left."""
    run = ProtocolRun(model, model.program(model.scene, model.scene.protocols[0]), None, control=control).run(
        until=10.0
    )
    last = run.rows[-1]
    assert last.force == 0 < last.gap
    return abs(last.blade_work - last.contact_energy - last.tissue_work) / last.tissue_work_size


@pytest.mark.slow
def test_the_work_of_a_quick_release_is_in_balance():
    set_threads(1)
    scene = Scene.shipped("idealised_fast")
    scene = replace(
        scene,
        protocols=(Protocol(kind="intermittent", hold=5.0, rest=10.0),),
        mesh=replace(scene.mesh, wall=0.008, craniotomy=0.02, largest=0.05),
        tools=(replace(scene.tool, travel=2e-3),),
        time=replace(scene.time, ramp=2.0, end=24.0),
    )
    model = RetractionModel.from_scene(scene)
    naive = lost(model, replace(model.control(), max_travel=np.inf))
    ours = lost(model, model.control())
    print(naive, ours)
    assert naive > 0.01 and ours < 0.005
