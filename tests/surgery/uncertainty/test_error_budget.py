"""Error budget: numerical errors by name, and the range of published materials."""

from dataclasses import replace
from types import SimpleNamespace as Namespace

import numpy as np
import pytest

from ngbrain.errors import InputError, SolverError
from ngbrain.scene import Patient, Protocol, Scene
from ngbrain.surgery import retraction
from ngbrain.surgery.answers import scale_moduli
from ngbrain.surgery.uncertainty import verification_runs
from ngbrain.surgery.uncertainty.error_budget import _recovered, errors, hold_answer
from ngbrain.surgery.uncertainty.verification_runs import HALF, MESH, MILLER, ORDER

T = [0.0, 10.0, 100.0, 190.0]


def held(peak, strain=0.2, left=0.5, volume=1.5):
    """An answer of a hold with the pressure `left` (mmHg) at its end."""
    pressure = [0.0, peak, left * peak, left * peak]
    found = {
        "peak_force_N": peak / 30,
        "mps_p95": strain,
        "strain_peak_at_s": 10.0,
        "volume_mps_above": {"0.18": volume},
        "region_ml": {"grey": 400.0},
        "events_s": [0.0, 10.0, 190.0],
        "series": {"t_s": T, "pressure_mmHg": pressure},
    }
    return scale_moduli(found, 1.0, Patient())


def checked(**changed):
    usual = {
        ORDER: (held(50.0, 0.21, volume=1.0), held(51.0, 0.205, volume=1.25)),
        MESH: (None, held(42.0, 0.19)),
        HALF: (held(45.0), held(44.5)),
        MILLER: held(10.0, 0.22),
    }
    return usual | changed


def test_every_number_has_its_errors_and_its_range():
    found = errors(held(40.0), checked(), [0.5, 2.0], Patient())
    peak, strain = found["peak_pressure_mmHg"], found["mps_p95"]
    assert (peak["mesh"], peak["step"]) == pytest.approx((2.0, 0.5))
    assert peak["order"] == pytest.approx(40 * (51 / 50 - 1))  # its share, of a peak of another law and mesh
    assert peak["numerics"] == pytest.approx(3.3) and peak["material"] == pytest.approx([10.0, 80.0])
    assert (strain["value"], strain["order"]) == pytest.approx((0.2, 0.005))
    assert strain["material"] == pytest.approx([0.2, 0.22])  # stiffness alone changes no strain
    assert found["volume_mps_above/0.18"]["order"] == pytest.approx(0.25)
    assert found["dose_mmHg_min"]["order"] == pytest.approx(0.02 * found["dose_mmHg_min"]["value"])
    assert found["s_above_20_mmHg"]["material"][0] == 0 < found["s_above_20_mmHg"]["value"]
    assert not {"strain_peak_at_s", "region_ml/grey"} & set(found)


def test_a_scene_that_measures_its_own_errors_is_compared_with_itself():
    """Half steps on the scene's own mesh; other elements against a hold that is not one of the protocols."""
    found = errors(held(40.0), checked() | {HALF: (None, held(39.0)), MESH: (held(40.0), held(43.0))}, [], Patient())
    assert (found["peak_pressure_mmHg"]["step"], found["peak_pressure_mmHg"]["mesh"]) == pytest.approx((1.0, 3.0))


def test_what_failed_is_not_known_and_the_rest_stands():
    found = errors(held(40.0), checked() | {MESH: None, ORDER: None, MILLER: None}, [], Patient())["peak_pressure_mmHg"]
    assert found["mesh"] is found["order"] is None and found["numerics"] == pytest.approx(0.5)
    assert found["material"] == pytest.approx([40.0, 40.0])
    nothing = errors(held(40.0), dict.fromkeys((MESH, ORDER, HALF, MILLER)), [], Patient())["peak_pressure_mmHg"]
    assert nothing["numerics"] is None
    assert errors(None, checked(), [1.0], Patient()) == {}


def test_the_hold_is_a_protocol_or_the_one_that_was_made_for_the_check():
    scene = Scene.shipped("idealised_fast")
    named = replace(scene, protocols=(Protocol(kind="continuous", name="mine"),))
    assert hold_answer(named, {"mine": held(40.0)}, checked())["peak_force_N"] == held(40.0)["peak_force_N"]
    other = replace(scene, protocols=scene.protocols[1:])
    mine = held(41.0)
    assert hold_answer(other, {}, checked() | {MESH: (mine, held(43.0))}) is mine
    assert hold_answer(other, {}, checked() | {MESH: None}) is None


@pytest.mark.parametrize("wall", [4e-3, 3e-3])
@pytest.mark.parametrize("protocols", [0, 1])
def test_other_elements_are_so_everywhere_and_a_hold_is_run_only_where_no_protocol_is_one(monkeypatch, protocols, wall):
    scene = Scene.shipped("idealised_fast")
    mesh = replace(scene.mesh, wall=wall)
    scene = replace(scene, mesh=mesh, protocols=scene.protocols[protocols:])
    ran = []
    monkeypatch.setattr(
        verification_runs, "_run_hold", lambda model, name, *_: ran.append((name, model.scene.mesh)) or held(40.0)
    )
    monkeypatch.setattr(verification_runs.RetractionModel, "from_scene", lambda scene, head: Namespace(scene=scene))
    own, _ = verification_runs.other_elements(Namespace(scene=scene, head=None), None, False, lambda *_: None)
    name, other = ran[-1]
    assert name == MESH and [name for name, _ in ran[:-1]] == ["hold"] * protocols and (own is None) == (not protocols)
    for size in ("wall", "craniotomy", "largest"):
        assert getattr(other, size) / getattr(mesh, size) == pytest.approx(2**0.5 if wall < 4e-3 else 2**-0.5)


def test_a_check_that_has_no_mesh_is_missing_and_the_result_stands(monkeypatch):
    def none(scene, head):
        raise InputError("body.far_mm", 85, "less")

    monkeypatch.setattr(verification_runs.RetractionModel, "from_scene", none)
    model = Namespace(scene=Scene.shipped("idealised_fast"), head=None)
    with pytest.raises(SolverError, match=r"no mesh for a check.*far_mm"):
        verification_runs.other_elements(model, None, False, lambda *_: None)
    assert retraction._run_check(model, MESH, None, False, lambda *_: None) is None


def test_what_came_back_is_from_where_the_blade_let_go_though_it_goes_further_later():
    columns = {"advance": [0.0, 2.0, 0.5, 0.6, 3.0], "opening": [0.0, 1.9, 0.5, 0.4, 2.9]}
    went = Namespace(column=lambda name: np.array(columns[name]))
    assert _recovered(went, np.array([False, False, True, False, False])) == pytest.approx(1.4)
