"""A scene's tasks: what is computed beside the protocols has names that no protocol can have."""

from dataclasses import replace

import pytest

from ngbrain.errors import InputError
from ngbrain.scene import Protocol, Scene
from ngbrain.surgery import retraction
from ngbrain.surgery.model import Model


def test_protocols_named_like_checks_keep_their_results():
    names = ["half steps", "one order more"]
    scene = Scene.shipped("demo_fast")
    scene = replace(scene, protocols=tuple(Protocol(kind="continuous", name=name) for name in names))
    tasks = [name for name, _, _ in retraction._tasks(Model(scene, None, None, None), None, False)]
    assert len(set(tasks)) == len(tasks) == len(names) + retraction.CHECKS and set(names) < set(tasks)
    for task in set(tasks) - set(names):
        with pytest.raises(InputError, match=r"protocol\.name"):
            Protocol(kind="continuous", name=task)
