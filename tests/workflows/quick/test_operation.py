"""First answers of an operation: what is written when, with a solver that only says what is asked of it."""

import json
import logging
from dataclasses import replace

import pytest

from ngbrain.scene import Protocol, Scene
from ngbrain.surgery.uncertainty.coarse_answers import MAIN, CoarseRecord
from ngbrain.workflows.quick import operation as quick_operation
from ngbrain.workflows.simulate import simulate

VALUES = {"coarser": 110.0, "coarse": 100.0, "described": 95.0}
CHECKS = ("one order more", "half steps")


class Solver:
    """In place of `retraction.solve`; stops where it is told to."""

    def __init__(self, stop=""):
        self.stop, self.seen = stop, []

    def __call__(
        self, scene, folder, threads=1, resume=False, callback=None, checks=True, checkpoint=None, executor=None, **more
    ):
        kind = (
            "described" if folder is None else {"coarse": "coarse", "coarser": "coarser"}.get(folder.name, "described")
        )
        protocols = [asked.name for asked in scene.protocols]
        self.seen.append((kind, protocols, checks, resume))
        result, done = {"scene": scene.to_dict(), "answers": {}, "verb": "simulate"}, []
        stages = [(name, False) for name in protocols] + [(name, True) for name in CHECKS if checks]
        for name, is_check in stages:
            if self.stop == f"{kind} {name}":
                raise KeyboardInterrupt
            done.append(name)
            if not is_check:
                result["answers"][name] = dict.fromkeys(MAIN, VALUES[kind])
            result["protocol_status"] = {each: "computed" if each in done else "under way" for each in protocols}
            missing = "under way" if checks else "not computed"
            result["check_status"] = {each: "computed" if each in done else missing for each in CHECKS}
            if more.get("store"):
                more["store"](dict(result))
        return quick_operation.SceneResult(result)


@pytest.fixture
def record(monkeypatch):
    """Intervals as wide, in logarithms, as the difference between the two coarse meshes."""
    monkeypatch.setattr(CoarseRecord, "half_width", lambda record, quantity, difference: difference)
    monkeypatch.setattr(quick_operation, "shipped_record", lambda: CoarseRecord(1, "2026-01-01", {}))


@pytest.fixture
def solver(monkeypatch, record):
    def put(stop=""):
        made = Solver(stop)
        monkeypatch.setattr(quick_operation.retraction, "solve", made)
        return made

    return put


SCENE = Scene.shipped("demo")


def kept(folder):
    return json.loads((folder / "result.json").read_text())


def test_first_answers_come_first_and_are_kept_with_what_became_of_them(solver, tmp_path):
    made, stages = solver(), []
    result = simulate(
        SCENE, tmp_path, quick=True, checks=False, checkpoint=lambda found: stages.append(json.loads(json.dumps(found)))
    )
    assert made.seen == [
        ("coarser", ["continuous"], False, False),
        ("coarse", ["continuous", "intermittent", "staged"], False, False),
        ("described", ["continuous", "intermittent", "staged"], False, False),
    ]
    shown = [found["answers"]["continuous"]["peak_pressure_mmHg"] for found in stages]
    assert shown == [100.0] * 5 + [95.0]  # three coarse protocols, two refined ones beside them, then all
    assert [found["first_answers"]["refined"] for found in stages] == [False] * 5 + [True]
    assert [found.get("runs_in") for found in stages] == ["coarse"] * 5 + [None]
    first = stages[0]["first_answers"]["answers"]
    assert [each["quantity"] for each in first] == list(MAIN) and first[0]["refined"] is None
    assert first[0]["interval"] == pytest.approx([100 / 1.1, 110.0])
    assert [each["inside"] for each in stages[3]["first_answers"]["answers"]][:5] == [True] * 4 + [None]
    assert all(each["inside"] and each["refined"] == 95.0 for each in result["first_answers"]["answers"])
    assert result == kept(tmp_path) == stages[-1] and result["scene"] == SCENE.to_dict()


def test_a_refined_answer_outside_is_said_to_be(solver, tmp_path, monkeypatch):
    solver()
    monkeypatch.setitem(VALUES, "described", 111.0)
    result = simulate(SCENE, tmp_path, quick=True, checks=False)
    assert not any(each["inside"] for each in result["first_answers"]["answers"])


def test_checks_are_last_and_said_to_be_under_way_before(solver, tmp_path):
    solver()
    stages = []
    simulate(SCENE, tmp_path, quick=True, checkpoint=lambda found: stages.append(set(found["check_status"].values())))
    assert stages[:6] == [{"under way"}] * 6 and stages[-1] == {"computed"} and len(stages) == 8


@pytest.mark.parametrize(
    "stop", ["coarse intermittent", "described continuous", "described staged", "described half steps"]
)
def test_what_is_stopped_has_left_a_result_and_goes_on(solver, tmp_path, stop):
    solver(stop)
    with pytest.raises(KeyboardInterrupt):
        simulate(SCENE, tmp_path, quick=True)
    left, kind = kept(tmp_path), stop.split()[0]
    first = left["first_answers"]["answers"]
    assert first[0]["value"] == 100.0
    assert (first[0]["refined"] == 95.0) is (stop not in ("coarse intermittent", "described continuous"))
    made = solver()
    result = simulate(SCENE, tmp_path, resume=True)  # without being told that it was quick
    again = [seen for seen, *_ in made.seen]
    assert again == (["coarser", "coarse", "described"] if kind == "coarse" else ["described"])
    assert result["first_answers"]["refined"] and all(each["inside"] for each in result["first_answers"]["answers"])
    assert result["first_answers"]["time_s"] == left["first_answers"]["time_s"]


def test_protocols_by_travel_and_by_force_have_a_coarser_run_each(solver, tmp_path):
    made = solver()
    by_force = Protocol(kind="force", force_gf=30.0)
    simulate(replace(SCENE, protocols=(*SCENE.protocols, by_force)), tmp_path, quick=True, checks=False)
    assert made.seen[0][1] == ["continuous", "force"]


def test_a_scene_that_is_coarse_itself_has_no_first_answers(solver, tmp_path, caplog):
    made = solver()
    coarse = replace(SCENE, mesh=replace(SCENE.mesh, wall=5e-3, largest=36e-3))
    with caplog.at_level(logging.WARNING, "ngbrain"):
        result = simulate(coarse, tmp_path, quick=True, checks=False)
    assert "first_answers" not in result and [seen for seen, *_ in made.seen] == ["described"]
    assert "no first answers" in caplog.text
