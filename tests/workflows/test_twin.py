"""A case from its files to result.json and the page; the mechanics are replaced by a formula, the head and the data are real."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("nibabel")
pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")

import ngbrain as nb
from ngbrain.cli import main
from ngbrain.errors import InputError, SolverError
from ngbrain.image.read.nifti import write_nifti
from ngbrain.image.read.property_maps import read_map
from ngbrain.image.read.volume import Volume
from ngbrain.scene import Scene
from ngbrain.surgery.quantities import QUANTITIES
from ngbrain.surgery.twin import compute
from ngbrain.surgery.twin.case import Case
from ngbrain.surgery.twin.response import MEASURES, Response
from ngbrain.surgery.twin.tasks import make_plan

BASE = {"gentle": 20.0, "wide": 30.0}
"""Pressure of each plan with the median patient: it goes with the factor of the tissue at the site."""
CALLS = []
FAR = np.array([[1, 0, 0, 0.4], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def gradient(plan):
    """Of ln of a measure: half with white matter, half with the field at the target."""
    near = np.linalg.norm(plan.nodes - plan.model.cleft.target, axis=1).argmin()
    found = np.zeros(len(plan.theta(plan.patient.centre)))
    found[list(plan.tissues).index("white")] = found[len(plan.tissues) + 2 + near] = 0.5
    return found


def answer(name, value):
    return dict.fromkeys(MEASURES, value) | {"series": {"t_s": [0.0, 1.0]}, "events_s": [0.0, 1.0], "name": name}


def linearise_plan(name, toml, stiffness, patient, quick, *, callback):
    CALLS.append(name)
    plan = make_plan(name, toml, stiffness, patient)
    callback(f"linearised: {name}", 0.0, 1.0)
    slope, centre = gradient(plan), plan.theta(patient.centre)
    response = Response(dict.fromkeys(MEASURES, BASE[name]), centre, dict.fromkeys(MEASURES, slope), plan.nodes)
    return {"answer": answer(name, BASE[name]), **vars(response)}


def whole_runs(name, toml, stiffness, patient, draws, task, *, callback):
    plan = make_plan(name, toml, stiffness, patient)
    centre, slope = plan.theta(patient.centre), gradient(plan)
    # ten percent more than the linearisation says, whatever the draw
    values = [1.1 * BASE[name] * np.exp(slope @ (plan.theta(draw) - centre)) for draw in draws]
    return [dict.fromkeys(MEASURES, float(value)) for value in values]


def other_elements(name, toml, stiffness, patient, *, callback):
    return dict.fromkeys(MEASURES, BASE[name] * (1.05 if name == "wide" else 1.02))


@pytest.fixture
def case(tmp_path, monkeypatch):
    """The sample case on a coarse head, in a folder of its own."""
    for each in (linearise_plan, whole_runs, other_elements):
        monkeypatch.setattr(compute, each.__name__, each)
    nb.datasets.write("twin", tmp_path)
    scene = Scene.from_toml(tmp_path / "retraction.toml")
    coarse = replace(scene, mesh=replace(scene.mesh, wall=8e-3, craniotomy=20e-3, largest=50e-3))
    (tmp_path / "retraction.toml").write_text(coarse.to_toml())
    return tmp_path / "twin.toml"


def test_a_case_becomes_answers_differences_and_a_page(case, capsys):
    out = case.parent / "out"
    assert main(["twin", str(case), "-o", str(out), "--threads", "1", "--draws", "4"]) == 0
    result = json.loads((out / "result.json").read_text())
    pressure = {name: of["peak_pressure_mmHg"] for name, of in result["answers"].items()}
    for name, of in pressure.items():
        assert of["median"] == pytest.approx(1.1 * BASE[name], rel=0.05)
        assert of["interval_95"][0] < of["median"] < of["interval_95"][1] and len(of["runs"]) == 4
    # whole runs say 1.1 times as much of both: the ratio stays 2/3, and only the sites' own parts make it uncertain
    (pair,) = (each for each in result["differences"] if each["measure"] == "peak_pressure_mmHg")
    assert pair["ratio_median"] == pytest.approx(2 / 3, rel=0.01) and pair["decision"] == "gentle"
    assert pair["numerical_factor"] == pytest.approx(1.05 / 1.02) and pair["runs_first_lower"] == 4
    assert result["residuals"]["wide"]["dose_mmHg_min"] == pytest.approx({"mean": np.log(1.1), "sd": 0.0}, abs=1e-9)
    assert result["stiffness"]["measured"] > 0.7 and 0.7 < result["stiffness"]["ratio_median"] < 1.3
    shares = result["variance_shares"]["answers"]["wide"]["peak_pressure_mmHg"]
    assert next(iter(shares)) == "level of the whole patient" and sum(shares.values()) == pytest.approx(1)
    assert set(result["corridors"]["wide"]) >= {"depth_mm", "fluid_mm", "findings"}
    page = (out / "report.html").read_text()
    assert "gentle is lower in peak pressure" in page and "https://" not in page.split("</style>")[1].split("<h2")[0]
    said = capsys.readouterr().out
    assert "gentle is lower" in said and all(
        f"{QUANTITIES[name].label}  " in said for name in result["answers"]["wide"]
    )


def test_finished_work_is_not_computed_again_and_a_quick_answer_has_no_whole_runs(case):
    out = case.parent / "out"
    CALLS.clear()
    first = nb.twin(case, out, quick=True)
    assert first["draws"]["whole_runs"] == 0 and first["differences"][0]["numerical_factor"] is None
    again = nb.twin(case, out, quick=True, resume=True)
    assert CALLS == ["gentle", "wide"] and again["answers"] == first["answers"]
    nb.twin(case, out, quick=True)
    assert CALLS == ["gentle", "wide"] * 2


def test_waves_or_a_map_narrow_an_interval_and_a_lost_run_is_left_out_for_all_plans(case, monkeypatch):
    given = Case.from_toml(case)
    with_map = nb.twin(given, draws=0)
    alone = nb.twin(replace(given, stiffness=None), draws=0)

    def width(result):
        low, high = result["answers"]["gentle"]["peak_pressure_mmHg"]["linearised_interval_95"]
        return np.log(high / low)

    assert width(with_map) < 0.75 * width(alone)
    assert alone["stiffness"]["source"] == "the catalogue alone" and alone["sections"][0]["ratio"] is None

    def failing(name, toml, stiffness, patient, draws, task, *, callback):
        found = whole_runs(name, toml, stiffness, patient, draws, task, callback=callback)
        return [None, *found[1:]] if name == "wide" else found

    monkeypatch.setattr(compute, "whole_runs", failing)
    lost = nb.twin(given, draws=3)
    assert lost["draws"] == {"linearised": 1024, "whole_runs": 2, "lost": 1} and "gave up" in lost.warnings[-1]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda volume: Volume(volume.data, FAR @ volume.affine), "away"),
        (lambda volume: Volume(volume.data / 1000, volume.affine), r"\|G\*\| in Pa"),
    ],
)
def test_a_map_of_another_place_or_unit_is_one_line(case, change, line, capsys):
    for name in ("twin_stiffness", "twin_stiffness_sd"):
        path = case.parent / f"{name}.nii.gz"
        volume = change(read_map(path, "moduli"))
        write_nifti(path, Volume(np.nan_to_num(volume.data).astype(np.float32), volume.affine))
    with pytest.raises(InputError, match=line):
        nb.twin(case)
    assert main(["twin", str(case), "-o", str(case.parent / "out")]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith(f"ngbrain: {case}: stiffness.map is")


def test_a_plan_beside_the_opening_is_refused(case):
    text = case.read_text() + "\n[craniotomy]\ncentre_mm = [-40.0, 0.0, 40.0]\ndiameter_mm = 40.0\n"
    case.write_text(text)
    with pytest.raises(InputError, match=r"plan 'gentle': cleft is .* mm from the centre of the craniotomy"):
        nb.twin(case)


def test_draws_are_none_or_two_at_least(case):
    with pytest.raises(InputError, match="draws is 1; wanted: 0, or 2 or more"):
        nb.twin(case, draws=1)


def test_a_plan_that_gives_up_is_a_solver_error(case, monkeypatch):
    def failing(name, toml, stiffness, patient, quick, *, callback):
        raise SolverError("no")

    monkeypatch.setattr(compute, "linearise_plan", failing)
    with pytest.raises(SolverError):
        nb.twin(case)
