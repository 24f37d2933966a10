"""A scene's tasks: what is computed beside the protocols has names that no protocol can have."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.scene import Protocol, Scene
from ngbrain.surgery import retraction
from ngbrain.surgery.model import Model
from ngbrain.surgery.protocols import Protocol as Program
from ngbrain.surgery.runs import ProtocolRun, due, table
from ngbrain.threads import set_threads


def test_protocols_named_like_checks_keep_their_results():
    names = ["half steps", "one order more"]
    scene = Scene.shipped("idealised_fast")
    kinds = ({"kind": "continuous"}, {"kind": "staged", "stages": 2, "rest": 20.0})
    protocols = tuple(Protocol(name=name, **kind) for name, kind in zip(names, kinds, strict=True))
    scene = replace(scene, protocols=protocols)
    tasks = [name for name, _, _ in retraction._tasks(Model(scene, None, None, None, None), None, False, Path())]
    assert len(set(tasks)) == len(tasks) == len(names) + retraction.CHECKS and set(names) < set(tasks)
    for task in set(tasks) - set(names):
        with pytest.raises(InputError, match=r"protocol\.name"):
            Protocol(kind="continuous", name=task)


def test_protocols_that_begin_alike_share_the_beginning():
    tasks = retraction._tasks(Model(Scene.shipped("idealised_fast"), None, None, None, None), None, False, Path("x"))
    (lead, follow), (staged,) = (
        [task for task in tasks if task[0] in names] for names in (("continuous", "intermittent"), ("staged",))
    )
    assert lead[0] == "intermittent" and follow[0] == "continuous" and tasks.index(lead) < tasks.index(follow)
    assert lead[2][-1] == follow[2][-1] is not None and staged[2][-1] is None


def test_frames_are_due_after_some_time_or_some_way():
    protocol = Program("p", (0.0, 8.0, 96.0), (0.0, 4e-3, 4e-3))
    assert not due(protocol, 0.0, 1.9) and due(protocol, 0.0, 2.1)  # 1 mm in 2 s
    assert not due(protocol, 10.0, 17.9) and due(protocol, 10.0, 18.1)  # a twelfth of 96 s


def test_forces_share_no_beginning_with_ways():
    scene = Scene.shipped("idealised_fast")
    continuous, way = scene.protocols[0], scene.retraction
    same = {"times": (0.0, way.ramp, way.elapsed), "force_gf": (0.0, 30.0, 30.0)}
    protocols = (continuous, Protocol(kind="force", force_gf=30.0), Protocol(kind="force", name="same", **same))
    tasks = retraction._tasks(
        Model(replace(scene, protocols=protocols), None, None, None, None), None, False, Path("x")
    )
    begun = {name: args[-1] for name, _, args in tasks if name in ("continuous", "force", "same")}
    assert begun["continuous"] is None and begun["force"] == begun["same"] is not None


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
    begun = tmp_path / "begun.pickle"
    first, second = (model.program(scene, asked) for asked in scene.protocols)
    quiet = {"tell": lambda *_: None}
    together = {
        second.name: retraction._lead(model, second, tmp_path, False, begun, **quiet),
        first.name: retraction._follow(model, first, tmp_path, False, begun, **quiet),
    }
    for program in (first, second):
        alone = ProtocolRun(model, program, None).go()
        rows = table(alone.rows)
        assert len(rows["t"]) > 10 and alone.peak == together[program.name].peak
        assert all(np.array_equal(rows[name], together[program.name].rows[name]) for name in rows)
