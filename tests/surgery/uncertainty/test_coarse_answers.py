"""Intervals of coarse answers: how wide they are, how many they hold, and of which scenes."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from ngbrain.scene import Scene
from ngbrain.surgery.uncertainty.coarse_answers import (
    COARSE,
    MAIN,
    CoarseRecord,
    coarse_scene,
    has_coarse,
    shipped_record,
)


def drawn(rng, n):
    """A scene's values on the coarser mesh, on the coarse one, and as described: differences of two sizes, errors in proportion."""
    between = rng.choice([0.02, 0.06], n)
    return np.exp(np.column_stack([between * rng.choice([-1, 1], n), np.zeros(n), 0.8 * between * rng.normal(size=n)]))


def test_intervals_hold_the_answers_of_other_scenes_as_often_as_they_say(rng):
    inside = []
    for _ in range(300):
        rows = [tuple(row) for row in drawn(rng, 8)]
        record = CoarseRecord(8, "", dict.fromkeys(MAIN, rows))
        for coarser, coarse, refined in drawn(rng, 10):
            low, high = record.interval("mps_p95", coarse, coarse, coarser)
            inside.append(low <= refined <= high)
    wanted = 1 - 0.1 / len(MAIN)
    assert wanted - 0.015 < np.mean(inside) < 0.999


def test_a_width_is_the_difference_times_what_the_record_says():
    off = [0.01, -0.03, 0.02]
    rows = [(math.exp(0.1), 1.0, math.exp(each)) for each in off]
    record = CoarseRecord(3, "", {"mps_p95": rows})
    factor = stats.t.ppf(1 - 0.1 / 8, 3) * math.sqrt(np.mean(np.square(off))) / 0.1
    assert record.half_width("mps_p95", -0.3) == pytest.approx(0.3 * factor)
    assert record.half_width("mps_p95", 0.001) == pytest.approx(math.sqrt(np.mean(np.square(off))) * factor)
    low, high = record.interval("mps_p95", 7.0, 2.0, 2.0 * math.exp(0.3))
    assert math.log(7.0 / low) == pytest.approx(math.log(high / 7.0)) == pytest.approx(0.3 * factor)
    assert record.interval("mps_p95", 0.0, 1.0, 1.0) is None


def test_a_coarse_scene_is_the_scene_but_for_elements_and_steps():
    scene = Scene.shipped("demo")
    coarse, coarser = coarse_scene(scene), coarse_scene(scene, coarser=True)
    assert coarser.mesh.wall == pytest.approx(math.sqrt(2) * coarse.mesh.wall) and coarse.mesh.order == 2
    assert replace(coarse, mesh=scene.mesh, time=scene.time) == scene
    larger = replace(scene, mesh=replace(scene.mesh, craniotomy=20e-3, largest=40e-3))
    assert coarse_scene(larger).mesh.largest == 40e-3 and coarse_scene(larger).mesh.wall == COARSE["wall"]
    assert has_coarse(scene) and not has_coarse(coarse)


def test_the_shipped_record_has_all_answers_of_some_scenes():
    record = shipped_record()
    assert record.scenes >= 3 and set(record.answers) == set(MAIN)
    assert all(len(rows) == record.scenes and np.all(np.array(rows) > 0) for rows in record.answers.values())


def test_a_record_is_read(tmp_path):
    scenes = [{"answers": {name: [1.0, 2.0, 3.0] for name in MAIN}}]
    record = CoarseRecord.from_text(json.dumps({"made": "2026-01-01", "scenes": scenes}))
    assert record.scenes == 1 and record.answers["mps_p95"] == [(1.0, 2.0, 3.0)] and record.made == "2026-01-01"
