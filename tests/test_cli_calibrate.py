"""The verb `calibrate`: tables of a retraction to factors of tissues, a scene with them, and a page."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")

from ngbrain.cli import calibrate as verb
from ngbrain.cli import main
from ngbrain.inverse.optimise.regularisation_weight import MisfitLevel
from ngbrain.inverse.optimise.result import Iteration
from ngbrain.inverse.uncertainty.interval import CredibleInterval
from ngbrain.result import Status
from ngbrain.scene import Protocol, Scene
from ngbrain.surgery.calibrate import Calibration, CalibrationModel
from ngbrain.surgery.model import RetractionModel

TRUTH = {"cortex": 1.5, "white": 0.7}
TIMES = (2.0, 6.0)


def operation():
    scene = Scene.shipped("idealised_fast")
    return replace(
        scene,
        protocols=(Protocol(kind="continuous"),),
        mesh=replace(scene.mesh, wall=0.008, craniotomy=0.02, largest=0.05),
        tools=(replace(scene.tool, travel=2e-3),),
        time=replace(scene.time, ramp=2.0, end=6.0, step_tolerance=0.1),
    )


@pytest.fixture
def files(tmp_path):
    """A scene and its tables, with recognisable numbers."""
    (tmp_path / "scene.toml").write_text(operation().to_toml())
    (tmp_path / "l.csv").write_text("t_s,x_mm,y_mm,z_mm,ux_mm,uy_mm,uz_mm\n2,17,6,30,0.4,0,\n")
    (tmp_path / "f.csv").write_text("t_s,force_N\n2,0.3\n6,0.2\n")
    return tmp_path


@pytest.fixture
def searched(monkeypatch):
    """Arguments of the calibration, which is not run."""
    given = {}

    def calibrate(scene, seen, tissues, protocol, spread, start, callback, finer):
        given.update(seen=seen, tissues=tissues, protocol=protocol, spread=spread, start=start, finer=finer)
        callback(Iteration("", 9.0, 3.0, {}, 1.0, 1.0, 0.1), {"white": 0.8})
        stiff = tuple(t.with_scale(0.7) if t.region == "white" else t for t in scene.tissues)
        bands, stiffer = {"white": CredibleInterval(0.7, 0.05, 0.6, 0.8)}, replace(scene, tissues=stiff)
        moved = {"white": 0.95} if finer else None
        return Calibration(bands, stiffer, 0.9 * seen.data, MisfitLevel(9.0, 3.0), moved, status=Status.CONVERGED)

    monkeypatch.setattr(verb, "calibrate", calibrate)
    return given


def called(files, *more, sd=(0.2, 0.01)):
    tables = ["--landmarks", files / "l.csv", "--landmark-sd", sd[0], "--force", files / "f.csv", "--force-sd", sd[1]]
    return main(["calibrate", *map(str, (files / "scene.toml", *tables, *more, "-o", files / "out"))])


def test_choices_reach_the_search_and_its_findings_the_files(files, searched, capsys):
    assert called(files, "--tissues", "white", "--protocol", "continuous", "--spread", 2) == 0
    assert searched["tissues"] == ["white"] and searched["protocol"] == 0 and searched["spread"] == 2
    assert searched["finer"] and searched["start"] is None and searched["seen"].sigma == pytest.approx((2e-4, 0.01))
    result = json.loads((files / "out" / "result.json").read_text())
    white = result["tissues"]["white"]
    assert white["low"] == 0.6 and white["modulus_Pa"] == pytest.approx(0.7 * white["modulus_before_Pa"])
    assert result["seen"]["displacements_mm"] == [[[pytest.approx(0.4), 0, None]], [[None] * 3]]
    assert result["fitted"]["force_N"] == pytest.approx([0.27, 0.18]) and "3 times" in result["warnings"][0]
    again = Scene.from_toml(files / "out" / "scene.toml")
    assert again.tissues[1].initial_modulus == pytest.approx(white["modulus_Pa"])
    page = (files / "out" / "report.html").read_text()
    assert white["moved_by_finer_elements"] == 0.95 and "white by -5.0 %." in page
    assert "0.6 to 0.8" in page and "3 times its expected value" in page
    assert "http" not in re.sub(r"base64,[^\"]+|http-equiv", "", page)
    said = capsys.readouterr().out
    assert "0.6 to 0.8" in said and "note: the misfit" in said and "scene.toml" in said


def test_a_stopped_search_goes_on_from_its_last_round(files, searched, capsys):
    assert called(files, "-q") == 0 and searched["start"] is None
    out, err = capsys.readouterr()
    assert not out and err.startswith("ngbrain: note: the misfit is 3 times")  # never silenced
    assert called(files, "-q", "--resume") == 0 and searched["start"] == {"white": 0.8}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "--landmarks is missing"),
        (["--force", "f.csv"], "--force-sd is None"),
        (["--landmarks", "l.csv", "--landmark-sd", "0"], "--landmark-sd is 0"),
        (["--force", "f.csv", "--force-sd", "1", "--protocol", "contin"], "did you mean 'continuous'"),
        (["--force", "none.csv", "--force-sd", "1"], "none.csv"),
        (["--landmarks", "f.csv", "--landmark-sd", "1"], "x_mm is missing"),
    ],
)
def test_bad_input_is_one_line_and_early(files, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(files)
    monkeypatch.setattr(verb, "calibrate", None)
    assert main(["calibrate", "scene.toml", *arguments, "-o", "out"]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1 and not (files / "out").exists()


@pytest.mark.slow
def test_a_known_truth_comes_back_from_tables(tmp_path):
    """Without noise on the same elements, to 2 %; landmarks at one time, forces at two."""
    scene = operation()
    model = RetractionModel.from_scene(scene)
    points = model.cleft.target + np.array([[x, y, z] for x in (-12, 14) for y in (-8, 9) for z in (-6, 7)]) / 1000
    data = (
        CalibrationModel(model, points, np.array(TIMES), list(TRUTH)).run.evaluate(np.array(list(TRUTH.values()))).data
    )
    lines = ["t_s,x_mm,y_mm,z_mm,ux_mm,uy_mm,uz_mm"]
    for point, moved in zip(points, data[0, :-1].reshape(-1, 3), strict=True):
        lines.append(",".join(f"{value!r}" for value in (TIMES[0], *map(float, 1e3 * point), *map(float, 1e3 * moved))))
    (tmp_path / "l.csv").write_text("\n".join(lines))
    forces = [f"{t},{float(force)!r}" for t, force in zip(TIMES, data[:, -1], strict=True)]
    (tmp_path / "f.csv").write_text("\n".join(["t_s,force_N", *forces]))
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    assert called(tmp_path, "--tissues", "cortex,white", "--no-finer", "-q", sd=(0.005, 0.0005)) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    for name, factor in TRUTH.items():
        assert result["tissues"][name]["value"] == pytest.approx(factor, rel=0.02)
        assert result["tissues"][name]["low"] < factor < result["tissues"][name]["high"]
    assert json.loads((tmp_path / "out" / "factors.json").read_text())["white"] == pytest.approx(0.7, rel=0.02)
