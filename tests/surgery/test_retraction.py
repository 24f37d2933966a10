"""A scene's tasks: what is computed beside the protocols has names that no protocol can have."""

from dataclasses import replace

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.scene import Protocol, Scene
from ngbrain.surgery import retraction
from ngbrain.surgery.model import Model
from ngbrain.surgery.runs import ProtocolRun, table
from ngbrain.threads import set_threads


def test_protocols_named_like_checks_keep_their_results():
    names = ["half steps", "one order more"]
    scene = Scene.shipped("idealised_fast")
    kinds = ({"kind": "continuous"}, {"kind": "staged", "stages": 2, "rest": 20.0})
    protocols = tuple(Protocol(name=name, **kind) for name, kind in zip(names, kinds, strict=True))
    scene = replace(scene, protocols=protocols)
    tasks = [name for name, _, _ in retraction._tasks(Model(scene, None, None, None, None), None, False)]
    assert len(set(tasks)) == len(tasks) == len(names) + retraction.CHECKS and set(names) < set(tasks)
    for task in set(tasks) - set(names):
        with pytest.raises(InputError, match=r"protocol\.name"):
            Protocol(kind="continuous", name=task)


def test_protocols_that_begin_alike_are_computed_together():
    tasks = retraction._tasks(Model(Scene.shipped("idealised_fast"), None, None, None, None), None, False)
    names = [name for name, _, _ in tasks]
    assert "continuous, intermittent" in names and "staged" in names


@pytest.mark.slow
def test_a_shared_beginning_changes_no_bit(tmp_path):
    set_threads(1)
    scene = Scene.shipped("idealised_fast")
    continuous, intermittent, _ = scene.protocols
    scene = replace(
        scene,
        retraction=replace(scene.retraction, opening=1e-3, ramp=2.0, elapsed=30.0),
        protocols=(continuous, replace(intermittent, hold=6.0, rest=14.0)),
    )
    model = Model.of(scene)
    programs = [model.program(scene, asked) for asked in scene.protocols]
    together = retraction._protocols(model, programs, tmp_path, False, lambda *_: None)
    for program in programs:
        alone = ProtocolRun(model, program, None).go()
        rows = table(alone.rows)
        assert len(rows["t"]) > 10 and alone.peak == together[program.name].peak
        assert all(np.array_equal(rows[name], together[program.name].rows[name]) for name in rows)
