"""Tasks of a scene: names of verification runs cannot be names of protocols."""

import json
from dataclasses import replace
from types import SimpleNamespace as Namespace

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.result import Status
from ngbrain.scene import Protocol, Scene
from ngbrain.surgery import retraction
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.protocol_run import ProtocolRun, is_frame_due, to_columns
from ngbrain.surgery.protocols import ToolMotion as Program
from ngbrain.threads import set_threads


def test_protocols_named_like_checks_keep_their_results():
    names = ["half steps", "one order more"]
    scene = Scene.shipped("idealised_fast")
    kinds = ({"kind": "continuous"}, {"kind": "staged", "stages": 2, "rest": 20.0})
    protocols = tuple(Protocol(name=name, **kind) for name, kind in zip(names, kinds, strict=True))
    scene = replace(scene, protocols=protocols)
    tasks = [task.name for task in retraction._tasks(RetractionModel(scene, None, None, None, None), None, False)]
    assert len(set(tasks)) == len(tasks) == len(names) + retraction.CHECKS and set(names) < set(tasks)
    for task in set(tasks) - set(names):
        with pytest.raises(InputError, match=r"protocol\.name"):
            Protocol(kind="continuous", name=task)


def test_protocols_that_begin_alike_share_the_beginning():
    tasks = retraction._tasks(RetractionModel(Scene.shipped("idealised_fast"), None, None, None, None), None, False)
    beginning = tasks[0].name
    (lead, follow), (staged,) = (
        [task for task in tasks if task.name in names] for names in (("continuous", "intermittent"), ("staged",))
    )
    assert lead.name == "intermittent" and follow.name == "continuous" and tasks.index(lead) < tasks.index(follow)
    assert lead.needs == follow.needs == [beginning] and not tasks[0].needs and not staged.needs


@pytest.fixture
def staged_run(monkeypatch):
    """`solve` without computation: a run ends when its name is passed to the returned function."""
    scene = Scene.shipped("idealised_fast")
    model = Namespace(
        scene=scene, head=Namespace(pictures=dict), program=lambda *_: None, run=lambda _: None, stiffness_map=dict
    )
    monkeypatch.setattr(retraction.RetractionModel, "from_scene", lambda scene: model)
    monkeypatch.setattr(retraction, "check_moduli", lambda model: ["stiff"])
    monkeypatch.setattr(retraction, "check_corridor", lambda model: [])
    monkeypatch.setattr(retraction, "_tasks", lambda *args: args[-1])
    monkeypatch.setattr(retraction, "_with_protocols", lambda model, names: model)
    monkeypatch.setattr(retraction, "_of_protocols", lambda model, runs, threads: {"answers": dict(runs)})
    monkeypatch.setattr(
        retraction,
        "_of_checks",
        lambda model, runs, found, checked, status: {"checked": checked, "check_status": status},
    )

    def solve(folder, names, **options):
        def run(checks, executor, *, callback, finished):
            assert checks == options.get("checks", True)
            for name in names:
                finished(name, None if name == "check: half steps" else name.upper())
            if "stopped" in names:
                raise KeyboardInterrupt

        monkeypatch.setattr(retraction.parallel, "run", run)
        return retraction.solve(scene, folder, **options)

    return solve


def kept(folder):
    return json.loads((folder / "result.json").read_text())


def test_a_result_is_there_when_the_protocols_are_done_and_grows_with_the_checks(staged_run, tmp_path):
    heard = []
    names = [
        "continuous",
        "check: one order more",
        "staged",
        "intermittent",
        "check: half steps",
        "check: Miller's exponent",
    ]

    def note(result):
        assert kept(tmp_path) == result  # the file is first
        heard.append(dict(result["check_status"]))

    result = staged_run(tmp_path, names, checkpoint=note)
    assert result == kept(tmp_path) and result["warnings"] == ["stiff"]
    assert result["answers"] == {name: name.upper() for name in ("continuous", "intermittent", "staged")}
    assert [list(status.values()) for status in heard] == [
        ["under way", "under way", "under way", "under way"],
        ["computed", "under way", "under way", "under way"],
        ["computed", "under way", "under way", "under way"],
        ["computed", "under way", "under way", "under way"],
        ["computed", "under way", "failed", "under way"],
        ["computed", "under way", "failed", "computed"],
    ]
    assert list(heard[0]) == ["one order more", "other elements", "half steps", "Miller's exponent"]
    assert result["checked"]["other elements"] is None and set(result["protocol_status"].values()) == {"computed"}


def test_a_run_that_is_stopped_among_its_checks_leaves_its_protocols(staged_run, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        staged_run(tmp_path, ["continuous", "intermittent", "staged", "stopped"])
    assert set(kept(tmp_path)["check_status"].values()) == {"under way"}


def test_every_protocol_that_is_done_is_in_the_result(staged_run, tmp_path):
    result = staged_run(tmp_path, ["beginning: intermittent", "continuous", "intermittent", "check: other elements"])
    assert result == kept(tmp_path) and result["answers"] == {
        "continuous": "CONTINUOUS",
        "intermittent": "INTERMITTENT",
    }
    assert result["protocol_status"] == {
        "continuous": "computed",
        "intermittent": "computed",
        "staged": "under way",
    }
    assert result.status is Status.STOPPED


def test_before_the_first_protocol_there_is_no_result(staged_run, tmp_path):
    assert staged_run(tmp_path, ["beginning: intermittent", "check: other elements"]) == {}
    assert not (tmp_path / "result.json").exists()


def test_a_resumed_run_replaces_no_result_by_one_of_fewer_protocols(staged_run, tmp_path):
    staged_run(tmp_path, ["continuous", "staged"])
    before, heard = kept(tmp_path), []
    staged_run(tmp_path, ["continuous"], resume=True)
    assert kept(tmp_path) == before
    result = staged_run(
        tmp_path,
        ["continuous", "staged", "intermittent"],
        resume=True,
        checkpoint=lambda each: heard.append(len(each["answers"])),
    )
    assert heard == [2, 3] and kept(tmp_path) == result


def test_a_model_of_some_protocols_says_nothing_of_the_others():
    model = RetractionModel(Scene.shipped("idealised_fast"), None, None, None, None)
    part = retraction._with_protocols(model, {"staged": None})
    assert [asked.name for asked in part.scene.protocols] == ["staged"]
    assert retraction._with_protocols(model, {asked.name for asked in model.scene.protocols}) is model


def test_left_out_checks_are_said_to_be_not_computed(staged_run, tmp_path):
    result = staged_run(tmp_path, ["continuous", "intermittent", "staged"], checks=False)
    assert set(result["check_status"].values()) == {"not computed"} and set(result["checked"].values()) == {None}


def test_checks_come_after_the_protocols_or_not_at_all():
    model = RetractionModel(Scene.shipped("idealised_fast"), None, None, None, None)
    names = [task.name for task in retraction._tasks(model, None, False)][1:]
    assert names[:3] == ["intermittent", "staged", "continuous"] and len(names) == 3 + retraction.CHECKS
    assert [task.name for task in retraction._tasks(model, None, False, checks=False)][1:] == names[:3]
    one_by_one = [task.name for task in retraction._tasks(model, None, False, early=True, checks=False)]
    assert one_by_one[1:] == ["continuous", "staged", "intermittent"]  # an answer early


def test_frames_are_due_after_some_time_or_some_way():
    protocol = Program("p", (0.0, 8.0, 96.0), (0.0, 4e-3, 4e-3))
    assert not is_frame_due(protocol, 0.0, 1.9) and is_frame_due(protocol, 0.0, 2.1)  # 1 mm in 2 s
    assert not is_frame_due(protocol, 10.0, 17.9) and is_frame_due(protocol, 10.0, 18.1)  # a twelfth of 96 s


def test_forces_share_no_beginning_with_ways():
    scene = Scene.shipped("idealised_fast")
    continuous, time = scene.protocols[0], scene.time
    same = {"times": (0.0, time.ramp, time.end), "force_gf": (0.0, 30.0, 30.0)}
    protocols = (continuous, Protocol(kind="force", force_gf=30.0), Protocol(kind="force", name="same", **same))
    tasks = retraction._tasks(RetractionModel(replace(scene, protocols=protocols), None, None, None, None), None, False)
    begun = {task.name: task.needs for task in tasks if task.name in ("continuous", "force", "same")}
    assert not begun["continuous"] and begun["force"] == begun["same"] != []


@pytest.mark.slow
def test_a_shared_beginning_changes_no_bit(tmp_path):
    set_threads(1)
    scene = Scene.shipped("idealised_fast")
    continuous, intermittent, _ = scene.protocols
    scene = replace(
        scene,
        protocols=(continuous, replace(intermittent, hold=6.0, rest=14.0)),
        tools=(replace(scene.tool, travel=1e-3),),
        time=replace(scene.time, ramp=2.0, end=30.0),
    )
    model = RetractionModel.from_scene(scene)
    first, second = (model.program(scene, asked) for asked in scene.protocols)
    quiet = {"callback": lambda *_: None}
    begun = retraction._run_first_piece(model, second, tmp_path, False, **quiet)
    together = {
        program.name: retraction._run_protocol(model, program, tmp_path, False, begun, **quiet)
        for program in (second, first)
    }
    for program in (first, second):
        alone = ProtocolRun(model, program, None).run()
        rows = to_columns(alone.rows)
        assert len(rows["t"]) > 10 and alone.peak == together[program.name].peak
        assert all(np.array_equal(rows[name], together[program.name].rows[name]) for name in rows)
