"""First answers of bodies: those of the first model, with the ladder's bound for an interval."""

import json

import pytest

from ngbrain.errors import InputError
from ngbrain.scene import DisplacementBC, Geometry, Quantity, Scene, Tissue
from ngbrain.workflows.quick.search import SearchAnswers, full_model, lower_order_model
from ngbrain.workflows.simulate import simulate

SCENE = Scene(
    geometry=Geometry(kind="block", size=(0.02, 0.02, 0.02)),
    tissues=[Tissue(mu=1000.0, poissons_ratio=0.3)],
    displacement_bcs=[DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -1e-3))],
    quantities=[Quantity(name="force", boundary="top", tolerance=0.03)],
)


def test_a_search_keeps_its_first_answer_and_says_whether_the_last_lies_inside(tmp_path):
    heard = []
    result = simulate(SCENE, tmp_path, quick=True, checkpoint=heard.append, richest={"mesh": "0", "order": "2"})
    (first,), (last,) = result["first_answers"]["answers"], result["answers"]
    assert first["value"] == result["models"][0]["answers"][0] != last["value"] == first["refined"]
    assert first["inside"] is True and min(first["interval"]) < first["value"] < max(first["interval"])
    assert [found["first_answers"]["refined"] for found in heard] == [False] * (len(heard) - 1) + [True]
    assert json.loads((tmp_path / "result.json").read_text()) == result


def test_a_body_as_described_is_computed_with_a_lower_order_before(tmp_path):
    heard = []
    result = simulate(SCENE, tmp_path, as_described=True, quick=True, checkpoint=heard.append)
    assert [found["model"] for found in heard] == [lower_order_model(SCENE), full_model(SCENE)]
    (first,) = heard[0]["first_answers"]["answers"]
    assert first["refined"] is None and first["value"] == heard[0]["answers"][0]["value"]
    (first,) = result["first_answers"]["answers"]
    assert first["refined"] == result["answers"][0]["value"] != first["value"] and first["inside"] is True


def test_one_model_alone_refines_nothing():
    growing = SearchAnswers(None, None)
    asked = {"quantity": "force", "unit": "N", "value": 2.0}
    growing.add({"answers": [asked], "models": [{"answers": [2.0], "error_bound": [None], "ndof": 9}], "cautions": []})
    first = growing.data["first_answers"]
    assert first["refined"] and first["answers"][0] == {
        "protocol": "",
        "quantity": "force",
        "name": "force",
        "unit": "N",
        "value": 2.0,
        "interval": None,
        "refined": None,
        "inside": None,
    }


def test_a_prescribed_model_is_not_quick():
    with pytest.raises(InputError, match=r"quick is True; wanted: False with a prescribed model"):
        simulate(SCENE, quick=True, model={"mesh": "0"})
