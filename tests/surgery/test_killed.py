"""A viscoelastic run killed at random times, twenty times, resumes each time to the same bits."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from ngbrain.io import load

SCENE = """
[geometry]
kind = "idealised"
[mesh]
wall_size_mm = 6.0
craniotomy_size_mm = 14.0
max_size_mm = 36.0
[[tissue]]
region = "cortex|white"
material = "griffiths2024:white_matter"
[[tissue]]
region = "ventricle.*"
mu_Pa = 50.0
bulk_to_shear_ratio = 10.0
[cleft]
target_mm = [17.0, 5.9, 26.2]
[[tool]]
travel_mm = 1.5
[time]
ramp_s = 2.0
end_s = 300.0
max_step_contact_s = 0.5
max_step_hold_s = 30.0
[[protocol]]
kind = "intermittent"
hold_s = 100.0
rest_s = 96.0
"""
RUN = """
import sys
from pathlib import Path
from ngbrain import Scene, set_threads
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.protocol_run import ProtocolRun
set_threads(1)
model = RetractionModel.from_scene(Scene.from_toml(sys.argv[1]))
ProtocolRun(model, model.program(model.scene, model.scene.protocols[0]), Path(sys.argv[2]), resume=True).run()
"""
KILLS = 20


def started(scene, folder):
    folder.mkdir(exist_ok=True)
    return subprocess.Popen([sys.executable, "-c", RUN, scene, folder], start_new_session=True)


def stamp(path: Path):
    return path.stat().st_mtime_ns if path.exists() else 0


@pytest.mark.slow
def test_a_run_killed_twenty_times_ends_with_the_same_bits(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    begun = time.monotonic()
    assert started(scene, tmp_path / "whole").wait(timeout=600) == 0
    whole = load(tmp_path / "whole" / "intermittent.vtkhdf").state
    steps = whole["transient"]["progress"]["steps"]
    rng, path, kills = np.random.default_rng(0), tmp_path / "killed" / "intermittent.vtkhdf", 0
    a_step = (time.monotonic() - begun) / steps
    while kills < KILLS:
        before = stamp(path)
        run = started(scene, path.parent)
        while stamp(path) == before and run.poll() is None:
            time.sleep(0.002)
        time.sleep(rng.uniform(0, a_step))
        assert run.poll() is None, f"it ended after {kills} kills"
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        kills += 1
    assert started(scene, path.parent).wait(timeout=600) == 0
    same(load(path).state, whole)


def same(one, other, where=""):
    """All arrays and numbers of two states, to the last bit."""
    if isinstance(other, dict):
        assert one.keys() == other.keys(), where
        for name in other:
            same(one[name], other[name], f"{where}/{name}")
    elif isinstance(other, (list, tuple)):
        assert len(one) == len(other), where
        for i, (a, b) in enumerate(zip(one, other, strict=True)):
            same(a, b, f"{where}/{i}")
    else:
        assert np.array_equal(one, other, equal_nan=isinstance(other, np.ndarray) and other.dtype.kind == "f"), where
