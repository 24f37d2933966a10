"""The verification run of one order more resumes after an interruption."""

from dataclasses import replace

import pytest

from ngbrain.scene import Scene
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.uncertainty import verification_runs

pytest.importorskip("nibabel")


class Stopped(Exception):  # noqa: N818
    """An exception in place of a kill."""


@pytest.mark.slow
def test_stopped_after_three_steps_it_goes_on_there(tmp_path, monkeypatch):
    scene = Scene.shipped("idealised_fast")
    coarse = replace(scene.mesh, wall=5e-3, craniotomy=12e-3, largest=30e-3)
    model = RetractionModel.from_scene(replace(scene, mesh=coarse, tools=(replace(scene.tool, travel=1e-3),)))
    path, save, saved = tmp_path / "state.npz", verification_runs.save_state, []

    def once(where, state):
        save(where, state)
        saved.append(state["reached"][0])
        if len(saved) == 3:
            raise Stopped

    whole = verification_runs.compare_orders(model)
    monkeypatch.setattr(verification_runs, "save_state", once)
    with pytest.raises(Stopped):
        verification_runs.compare_orders(model, path)
    rest = verification_runs.compare_orders(model, path, resume=True)
    assert rest[0] == whole[0]
    for name in ("peak_pressure_mmHg", "peak_force_N"):  # its factor is made anew: the same to Newton's tolerance
        assert rest[1][name] == pytest.approx(whole[1][name], rel=1e-4)
    assert len(saved) >= 5 and saved == sorted(set(saved))  # no step was taken twice
