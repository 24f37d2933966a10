"""The command line: bad input ends with status 2 and one line; a coarse run gives its files; a stopped run goes on."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import warnings

import ngsolve as ngs
import nibabel
import numpy as np
import pytest
from phantoms import nested

from ngbrain.cli import main
from ngbrain.errors import ImplausibleWarning, InputError
from ngbrain.io import load
from ngbrain.mesh.routes.registry import min_jacobian
from ngbrain.scene import Scene


def run(capsys, *arguments):
    status = main([str(a) for a in arguments])
    return status, capsys.readouterr().err.strip().splitlines()


@pytest.fixture
def no_run(monkeypatch):
    def run(*_, **__):
        raise AssertionError("hours of work were begun")

    monkeypatch.setattr("ngbrain.parallel.run", run)


@pytest.mark.parametrize(
    ("find", "replace", "words"),
    [
        ("width_mm = 10.0", "widht_mm = 10.0", ["widht_mm", "width_mm"]),
        ("target_mm = [17.0, 5.9, 26.2]", "target_mm = [0.0, 0.0, 99.0]", ["cleft.target_mm", "inside the brain"]),
        ("mu_Pa = [50.0]", "mu_Pa = [-50.0]", ["mu_Pa", "-50"]),
        (
            'material = "griffiths2024:cortex"',
            "mu_Pa = 0.936",
            ["initial shear modulus of cortex", "0.936 Pa", "not kPa"],
        ),
        ("ramp_s = 10.0", "ramp_s = -10.0", ["ramp_s", "-10"]),
        ("width_mm = 10.0", "width_mm = 13.0", ["tool#1.width_mm", "cleft"]),
        ('boundary = "skull"', 'boundary = "skul"', ["skul", "skull"]),
        (
            'boundary = "skull"',
            'boundary = "skull|wall.*"',
            ["displacement_bc#1.boundary", "skull|wall.*", "wall_plus"],
        ),
        ('region = "white"', 'region = "whit"', ["whit", "white"]),
        (
            'region = "white"',
            'region = ".*e.*"',
            ["tissue#2.region", ".*e.*", "without cortex, which tissue#1 ('cortex') has"],
        ),
        ('region = "white"', 'region = "[[:white:]]"', ["tissue region", "[[:white:]]", "'white'"]),
    ],
)
def test_bad_scenes(tmp_path, capsys, no_run, find, replace, words):
    text = Scene.shipped("idealised_fast").to_toml()
    assert find in text
    scene = tmp_path / "case.toml"
    scene.write_text(text.replace(find, replace, 1))
    status, lines = run(capsys, "simulate", scene, "-o", tmp_path / "out", "-q", "--threads", 1)
    assert status == 2 and len(lines) == 1
    assert all(word in lines[0] for word in [f"{scene}: ", *words, "wanted"]), lines[0]
    assert not (tmp_path / "out" / "result.json").exists()


def test_a_template_is_printed_and_is_the_demo(tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["simulate", "--template"])
    scene = tmp_path / "scene.toml"
    scene.write_text(capsys.readouterr().out)
    assert stopped.value.code == 0 and Scene.from_toml(scene) == Scene.shipped("demo")


def test_unreadable_and_truncated_files(tmp_path, capsys):
    for name, content in (
        ("binary.toml", b"\x89HDF\r\n\x00\xff"),
        ("cut.toml", b"[cleft]\ntarget_mm = [17.0, 5."),
        ("empty.toml", b""),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        status, lines = run(capsys, "simulate", path, "-q")
        assert status == 2 and len(lines) == 1 and name in lines[0]
    status, lines = run(capsys, "simulate", tmp_path / "absent.toml", "-q")
    assert status == 2 and len(lines) == 1 and "absent.toml" in lines[0]


def test_a_mesh_that_is_too_coarse(tmp_path, capsys, monkeypatch, no_run):
    monkeypatch.setattr("ngbrain.mesh.geometry.primitives.MOST_LOST", 1e-6)
    scene = tmp_path / "case.toml"
    scene.write_text(SMALL)
    status, lines = run(capsys, "simulate", scene, "-o", tmp_path / "out", "-q", "--threads", 1)
    assert status == 2 and len(lines) == 1
    assert lines[0].startswith(f"ngbrain: {scene}: mesh.max_size_mm is 36, ") and "mesh.craniotomy_size_mm" in lines[0]


@pytest.mark.parametrize(("field", "named"), [("tissue", True), ("--resume", False), ("checkpoint", False)])
def test_errors_name_the_scene_where_it_is_at_fault(tmp_path, capsys, monkeypatch, field, named):
    def refuse(*_, **__):
        raise InputError(field, "bad", "good")

    monkeypatch.setattr("ngbrain.cli.simulate.simulate", refuse)
    scene = tmp_path / "case.toml"
    scene.write_text(SMALL)
    status, lines = run(capsys, "simulate", scene, "-o", tmp_path / "out", "-q")
    where = f"{scene}: " if named else ""
    assert status == 2 and lines == [f"ngbrain: {where}{field} is bad; wanted: good"]


def test_warnings_are_a_line_each_and_quiet_silences_none(tmp_path, capsys, monkeypatch):
    def warn(*_, **__):
        warnings.warn("initial shear moduli outside", ImplausibleWarning, stacklevel=1)
        raise InputError("the rest", "bad", "good")

    monkeypatch.setattr("ngbrain.cli.simulate.simulate", warn)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(warnings, "filters", [])
        status, lines = run(capsys, "demo", "--fast", "--head", "idealised", "-o", tmp_path / "out", "-q")
    assert status == 2 and lines[0] == "ngbrain: warning: initial shear moduli outside" and len(lines) == 2


@pytest.fixture
def staged(tmp_path, monkeypatch):
    """The command with a solver and a report that only record their calls."""
    seen = []

    class Reported:
        def __init__(self, folder):
            self.path = folder / "report.html"

        def write(self):
            result = json.loads((self.path.parent / "result.json").read_text())
            seen.append((result["verb"], list(result["check_status"].values())))
            return self.path

    def solve(scene, folder, *, as_described, threads, resume, checks, quick, callback, checkpoint, executor):
        folder.mkdir(exist_ok=True)
        answer = dict.fromkeys(
            (
                "peak_pressure_mmHg",
                "peak_tip_pressure_mmHg",
                "peak_force_N",
                "s_above_20_mmHg",
                "dose_mmHg_min",
                "mps_p95",
            ),
            1.0,
        )
        result = {"verb": "simulate", "answers": {"continuous": answer}, "error_budget": {}}
        result["protocol_status"] = {"continuous": "computed"}
        if quick:
            name = {"protocol": "continuous", "name": "peak pressure", "unit": "mmHg", "value": 1.2}
            answers = [name | {"interval": [0.9, 1.6], "refined": None, "inside": None}]
            first = {"model": "large elements", "basis": "", "time_s": 60.0, "refined": False, "answers": answers}
            waiting = {"half steps": "under way" if checks else "not computed"}
            checkpoint(result | {"first_answers": first, "check_status": waiting})
            result["first_answers"] = first | {"refined": True}
        for status in (["under way"] * 2, ["computed", "failed"]) if checks else (["not computed"] * 2,):
            result["check_status"] = dict(zip(("half steps", "other elements"), status, strict=True))
            checkpoint(result)
        return result

    monkeypatch.setattr("ngbrain.report.pages.retraction.Report", Reported)
    monkeypatch.setattr("ngbrain.cli.simulate.simulate", solve)
    return seen


def test_the_report_is_announced_before_the_checks(tmp_path, capsys, staged):
    out = tmp_path / "out"
    assert main(["demo", "--fast", "--head", "idealised", "-o", str(out)]) == 0
    said, complained = capsys.readouterr()
    assert staged == [("demo", ["under way"] * 2), ("demo", ["computed", "failed"])]
    first, *_ = (line for line in said.splitlines() if line.startswith("report"))
    assert first == f"report: {out}/report.html (checks under way)"
    assert said.splitlines()[-1] == f"report, with the checks: {out}/report.html" and said.count("continuous") == 1
    assert complained == "ngbrain: warning: checks that failed, so that error estimates are missing: other elements\n"


def test_without_checks_it_is_said_that_estimates_are_not_computed(tmp_path, capsys, staged):
    out = tmp_path / "out"
    assert main(["demo", "--fast", "--head", "idealised", "-o", str(out), "--no-checks"]) == 0
    said, complained = capsys.readouterr()
    assert staged == [("demo", ["not computed"] * 2)] and not complained
    ending = [f"report: {out}/report.html", "error estimates not computed: half steps, other elements"]
    assert said.splitlines()[-2:] == ending


def test_first_answers_are_said_before_the_run_as_described(tmp_path, capsys, staged):
    out = tmp_path / "out"
    assert main(["demo", "--fast", "--head", "idealised", "-o", str(out), "--quick", "--no-checks"]) == 0
    said = capsys.readouterr().out
    assert staged == [("demo", ["not computed"]), ("demo", ["not computed"] * 2)]
    lines = said.splitlines()
    assert lines[1].split() == ["continuous:", "peak", "pressure", "1.20", "mmHg", "0.900", "to", "1.60", "mmHg"]
    assert lines[2] == f"report: {out}/report.html (refinement under way)"
    assert lines[3].startswith("protocol") and lines[-2] == f"report: {out}/report.html"


def test_output_must_be_a_folder(tmp_path, capsys):
    taken = tmp_path / "taken"
    taken.write_text("")
    status, lines = run(capsys, "demo", "--fast", "-o", taken, "-q")
    assert status == 2 and len(lines) == 1 and "taken" in lines[0]


SMALL = """
title = "A short push"
[geometry]
kind = "idealised"
[mesh]
wall_size_mm = 4.0
craniotomy_size_mm = 14.0
max_size_mm = 36.0
[[tissue]]
region = "cortex|white"
mu_Pa = 1000.0
[[tissue]]
region = "ventricle.*"
mu_Pa = 50.0
bulk_to_shear_ratio = 10.0
[cleft]
target_mm = [17.0, 5.9, 26.2]
[[tool]]
travel_mm = 1.0
edge_radius_mm = 2.0
[time]
ramp_s = 2.0
end_s = 12.0
max_step_contact_s = 1.0
[[protocol]]
kind = "continuous"
[[protocol]]
kind = "intermittent"
hold_s = 0.5
rest_s = 7.0
"""


REAL = SMALL
for idealised, real in (
    ('"idealised"', '"mni152"'),
    ("craniotomy_size_mm = 14.0\nmax_size_mm = 36.0", "craniotomy_size_mm = 10.0\nmax_size_mm = 22.0"),
    ("cortex|white", "grey|white"),
    ("[17.0, 5.9, 26.2]", "[24.0, -8.0, 40.0]"),
):
    assert idealised in REAL
    REAL = REAL.replace(idealised, real)


def command(scene, out, *options):
    return [sys.executable, "-m", "ngbrain", "simulate", str(scene), "-o", str(out), "-q", *options]


def simulate(*arguments):
    subprocess.run(command(*arguments), check=True, timeout=1800)


def numbers(out):
    """The result of a run without its computing times."""
    result = json.loads((out / "result.json").read_text())
    named = ("answers", "checks", "comparison", "material_uncertainty", "geometry", "model", "error_budget")
    return {name: result[name] for name in named}


def alike(one, other):
    """Assert equal results on one thread and on two, up to round-off of another order of summation."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(alike(one[name], other[name]) for name in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(alike, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return other == pytest.approx(one, rel=1e-6, abs=1e-9)
    return one == other


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    scene = folder / "small.toml"
    scene.write_text(SMALL)
    simulate(scene, folder / "out", "--threads", "1")
    return scene, folder / "out"


@pytest.mark.slow
def test_a_run_leaves_its_files_and_its_truths(finished):
    _, out = finished
    assert (out / "report.html").stat().st_size > 10_000
    result = numbers(out)
    checks = result["checks"]
    assert checks["reaction_balance"] < 1e-4 and checks["volume_balance"] < 1e-4 and checks["energy_balance"] < 0.05
    assert checks["force_while_off_N"] == 0 and checks["gap_while_off_mm"] > 0
    assert checks["first_peaks_differ"] < 1e-6 and checks["min_net_reaction_N"] > -1e-5
    assert checks["dt_halving"] < 0.03 and checks["order_plus_one"] < 0.1
    peak = result["error_budget"]["peak_pressure_mmHg"]
    assert peak["value"] == result["answers"]["continuous"]["peak_pressure_mmHg"]
    assert 0 < peak["mesh"] < 0.3 * peak["value"] and 0 < peak["order"] < 0.1 * peak["value"] and peak["step"] > 0
    assert peak["material"][0] < peak["value"] < peak["material"][1]
    assert all(of["numerics"] is not None for of in result["error_budget"].values())
    for answer in result["answers"].values():
        for threshold, ml in answer["volume_mps_above"].items():
            assert sum(v[threshold] for v in answer["volume_mps_above_by_region_ml"].values()) == pytest.approx(ml)
        assert sum(answer["region_ml"].values()) == pytest.approx(result["model"]["brain_ml"], rel=1e-6)
        assert 0 < answer["von_mises_p95_kPa"] < answer["von_mises_p99_kPa"] and answer["strain_rate_p95_per_s"] > 0
        assert answer["peak_centre_pressure_mmHg"] < answer["peak_pressure_mmHg"] < answer["peak_tip_pressure_mmHg"]
        assert answer["von_mises_p99_kPa"] < answer["von_mises_max_over_0_5_ml_kPa"]
        series = answer["series"]
        assert len({len(values) for values in series.values()}) == 1 and set(answer["events_s"]) <= set(series["t_s"])
        assert answer["peak_force_N"] > 0 and answer["s_above_20_mmHg"] == 0


@pytest.mark.slow
def test_a_real_head_gives_the_same_on_two_threads_and_segments_once(tmp_path, monkeypatch):
    monkeypatch.setenv("NGBRAIN_CACHE", str(tmp_path / "cache"))
    scene = tmp_path / "real.toml"
    scene.write_text(REAL)
    simulate(scene, tmp_path / "one", "--threads", "1")
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.npz")}
    scene.write_text(REAL.replace("hold_s = 0.5", "hold_s = 0.6"))
    assert kept and "hold_s = 0.6" in scene.read_text()
    simulate(scene, tmp_path / "other", "--threads", "2")
    assert kept == {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.npz")}
    scene.write_text(REAL)
    monkeypatch.setenv("NGBRAIN_CACHE", str(tmp_path / "another"))
    simulate(scene, tmp_path / "two", "--threads", "2")
    assert alike(numbers(tmp_path / "one"), numbers(tmp_path / "two"))
    result = json.loads((tmp_path / "one" / "result.json").read_text())
    assert result["checks"]["reaction_balance"] < 1e-4 and result["head"]["label_volumes_ml"]["ventricle"] > 10


@pytest.mark.slow
def test_without_checks_estimates_are_said_to_be_missing_and_a_resumed_run_adds_them(finished, tmp_path):
    scene, out = finished
    simulate(scene, tmp_path, "--threads", "1", "--no-checks")
    result, found = (json.loads((folder / "result.json").read_text()) for folder in (tmp_path, out))
    assert set(result["check_status"].values()) == {"not computed"} and set(found["check_status"].values()) == {
        "computed"
    }
    assert result["answers"] == found["answers"] and not (tmp_path / "checks").exists()
    assert result["checks"] == found["checks"] | dict.fromkeys(("dt_halving", "order_plus_one", "other_elements"))
    peak = result["error_budget"]["peak_pressure_mmHg"]
    assert peak["mesh"] is peak["order"] is peak["step"] is peak["numerics"] is None
    assert "Error estimates not computed: one order more" in (tmp_path / "report.html").read_text()
    written = (tmp_path / "continuous.vtkhdf").stat().st_mtime_ns
    simulate(scene, tmp_path, "--threads", "1", "--resume")
    assert numbers(tmp_path) == numbers(out) and (tmp_path / "continuous.vtkhdf").stat().st_mtime_ns == written
    assert "ot computed" not in (tmp_path / "report.html").read_text()


def page_of(folder):
    """The page there, or what one says of protocols under way."""
    path = folder / "report.html"
    return path.read_text() if path.exists() else "Protocols under way"


@pytest.mark.slow
def test_a_run_killed_among_its_checks_has_left_a_report_and_goes_on(finished, tmp_path):
    scene, out = finished
    with subprocess.Popen(command(scene, tmp_path, "--threads", "1"), start_new_session=True) as run:
        while "Protocols under way" in page_of(tmp_path):
            assert run.poll() is None
            time.sleep(0.01)
        os.killpg(run.pid, signal.SIGKILL)
    result = json.loads((tmp_path / "result.json").read_text())
    assert set(result["check_status"].values()) == {"under way"} and result["answers"] == numbers(out)["answers"]
    page = (tmp_path / "report.html").read_text()
    assert page.endswith("</html>") and "Checks under way when this page was written" in page
    simulate(scene, tmp_path, "--resume", "--threads", "1")
    assert numbers(tmp_path) == numbers(out)


@pytest.mark.slow
def test_resume_after_the_end_computes_nothing_and_says_the_same(finished):
    scene, out = finished
    before, files = numbers(out), [*out.glob("*.vtkhdf"), *(out / "checks").iterdir()]
    written = {path: path.stat().st_mtime_ns for path in files}
    assert len(written) == 6
    simulate(scene, out, "--resume", "--threads", "2")
    assert numbers(out) == before
    assert written == {path: path.stat().st_mtime_ns for path in files}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stop", "after_s"),
    [(signal.SIGINT, 0.0), (signal.SIGINT, 3.0), (signal.SIGKILL, 3.0)],
    ids=["Ctrl-C while processes start", "Ctrl-C", "kill"],
)
def test_a_stopped_run_goes_on_to_the_same_on_two_threads(finished, tmp_path, stop, after_s):
    scene, out = finished
    started = command(scene, tmp_path, "--threads", "2")
    with subprocess.Popen(started, stderr=subprocess.PIPE, text=True, start_new_session=True) as run:
        while not (tmp_path / "intermittent.vtkhdf").exists():
            assert run.poll() is None
            time.sleep(0.01)
        time.sleep(after_s)
        os.killpg(run.pid, stop)
        said = run.communicate(timeout=30)[1]
    assert not (tmp_path / "result.json").exists()
    if stop == signal.SIGINT:
        assert run.returncode == 130 and said == f"ngbrain: stopped; continue with --resume -o {tmp_path}\n"
    simulate(scene, tmp_path, "--resume", "--threads", "2")
    assert alike(numbers(tmp_path), numbers(out))


def test_a_retraction_says_what_it_leaves_unanswered_and_how_sure_it_is(tmp_path, capsys, monkeypatch):
    peaks = dict.fromkeys(("peak_pressure_mmHg", "peak_tip_pressure_mmHg", "peak_force_N", "s_above_20_mmHg"), 1.0)
    peak = {"value": 1.0, "mesh": 0.2, "order": 0.1, "step": None, "material": (0.5, 2.0)}
    result = {
        "answers": {"continuous": {**peaks, "dose_mmHg_min": 3.0, "mps_p95": 0.1}},
        "error_budget": {"peak_pressure_mmHg": peak},
        "check_status": {"half steps": "computed"},
    }

    def solve(*_, checkpoint, **__):
        checkpoint(result)
        return result

    monkeypatch.setattr("ngbrain.cli.simulate.simulate", solve)
    monkeypatch.setattr("ngbrain.report.pages.retraction.Report.write", lambda self: self.folder / "report.html")
    scene = tmp_path / "case.toml"
    scene.write_text(SMALL + '[[quantity]]\nname = "peak_force_N"\ntolerance = 0.2\n')
    status, lines = run(capsys, "simulate", scene, "-o", tmp_path / "out", "-q", "--resume")
    assert status == 2 and "--resume is given" in lines[0] and "cannot be resumed" in lines[0]
    scene.write_text(SMALL)
    (tmp_path / "out").mkdir()
    sure = (
        "opening held to the end: peak 1 mmHg, errors: mesh 0.2, order 0.1 mmHg; other published tissue: 0.5 to 2 mmHg"
    )
    assumed = [f"ngbrain: warning: {text}" for text in Scene.from_toml(scene).warnings]
    status, lines = run(capsys, "simulate", scene, "-o", tmp_path / "out", "-q")
    assert status == 0 and lines == [*assumed, f"ngbrain: {sure}"]
    status = main(["simulate", str(scene), "-o", str(tmp_path / "out"), "--overwrite"])
    out, err = capsys.readouterr()
    assert status == 0 and err.splitlines() == assumed and out.splitlines()[-1] == sure


def labels_file(path):
    labels = nested((20.0, 15.0, 8.0))
    image = nibabel.Nifti1Image(labels.volume.data.astype("uint8"), np.diag([1e3, 1e3, 1e3, 1]) @ labels.volume.affine)
    nibabel.save(image, path)
    return labels


def test_mesh_of_labels(tmp_path, capsys):
    labels = labels_file(tmp_path / "labels.nii.gz")
    names = "1=grey,2=white,3=ventricles"
    status, lines = run(
        capsys, "mesh", tmp_path / "labels.nii.gz", "--labels", "--names", names, "--size", "7", "--site", "10,0,0",
        "-o", tmp_path / "out" / "head.vtkhdf", "-q",
    )  # fmt: skip
    assert status == 0 and not lines
    found = {path.name for path in (tmp_path / "out").iterdir()}
    assert found == {"head.vtkhdf", "head_labels.nii.gz", "head_landmarks.mrk.json", "result.json", "report.html"}
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    wanted = labels.volumes_ml()
    assert result["verb"] == "mesh" and set(result["regions"]) == {"brain", "ventricles"}
    assert result["regions"]["ventricles"]["label_volume_ml"] == pytest.approx(wanted["ventricles"])
    for region in result["regions"].values():
        assert region["volume_ml"] == pytest.approx(region["label_volume_ml"], rel=1e-2)
    assert set(result["quality"]) >= {"n_tets", "min_dihedral_deg", "fraction_radius_ratio_below_0_1", "min_jacobian"}
    assert {"versions", "seed", "threads", "time_s", "checks"} <= set(result)
    mesh = load(tmp_path / "out" / "head.vtkhdf").mesh
    assert mesh.ne == result["quality"]["n_tets"] and set(mesh.GetBoundaries()) == {"skull", "ventricle_wall"}
    back = nibabel.load(tmp_path / "out" / "head_labels.nii.gz")
    assert np.array_equal(np.asarray(back.dataobj), labels.volume.data)
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("data:image/png;base64") == 3 and "ventricles" in page
    assert "http" not in re.sub(r"base64,[^\"]+", "", page)
    assert len(result["needs"]) == 3 and all(need.replace("&", "&amp;") in page for need in result["needs"])


def test_a_report_of_labels_with_large_numbers_on_a_turned_grid(tmp_path, capsys):
    labels = nested((20.0, 15.0, 8.0))
    numbers = np.array([0, 1035, 41, 4], np.int16)[labels.volume.data]
    numbers[: len(numbers) // 2][numbers[: len(numbers) // 2] == 41] = 2
    turn = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]]) @ labels.volume.affine
    nibabel.save(nibabel.Nifti1Image(numbers, np.diag([1e3, 1e3, 1e3, 1]) @ turn), tmp_path / "aseg.nii.gz")
    status, lines = run(
        capsys, "mesh", tmp_path / "aseg.nii.gz", "--labels", "--size", "7", "-o", tmp_path / "a.msh", "-q"
    )
    assert status == 0 and not lines
    result = json.loads((tmp_path / "result.json").read_text())
    assert (
        result["labels"] == "1 white, 2 ventricles, 3 grey" and "ventricles" in (tmp_path / "report.html").read_text()
    )


@pytest.mark.slow
def test_a_curved_lattice_of_labels(tmp_path, capsys):
    labels_file(tmp_path / "labels.nii.gz")
    out = tmp_path / "head.vtkhdf"
    what = [str(tmp_path / "labels.nii.gz"), "--labels", "--names", "1=csf,2=brain,3=ventricles", "-o", str(out)]
    status = main(["mesh", *what, "--route", "lattice", "--size", "5", "--curve"])
    lines = capsys.readouterr().out.splitlines()
    result = json.loads((tmp_path / "result.json").read_text())
    snaps, curved, page = result["snaps"], result["curved"], (tmp_path / "report.html").read_text()
    assert status == 0 and snaps["snapped"] > 10 * snaps["rejected"] > 0
    assert f"{snaps['snapped']} points snapped onto interfaces, {snaps['rejected']} snaps rejected" in lines
    assert f"{snaps['snapped']}, {snaps['rejected']} snaps rejected" in page and "held back" in page
    assert curved["mean_mm_after"] < 0.8 * curved["mean_mm_before"] and lines[-1].startswith("interfaces off by")
    mesh = load(out).mesh
    assert 0 < min_jacobian(mesh) < 0.9
    volume = ngs.Integrate(ngs.CF(1), mesh, definedon=mesh.Materials("brain"))
    assert result["regions"]["brain"]["volume_ml"] == pytest.approx(1e6 * volume, rel=1e-9)
    assert result["quality"]["min_jacobian"] == pytest.approx(min_jacobian(mesh))


@pytest.mark.parametrize("route", ["hull", pytest.param("lattice", marks=pytest.mark.slow)])
def test_a_cut_at_a_landmark(route, tmp_path, capsys):
    labels = labels_file(tmp_path / "labels.nii.gz")
    middle = labels.volume.data.shape[0] // 2
    out, names = tmp_path / "head.vtkhdf", "1=grey,2=white,3=ventricles"
    status, lines = run(
        capsys, "mesh", tmp_path / "labels.nii.gz", "--labels", "--names", names, "--route", route, "--size", "5",
        "--landmark", f"lesion=voxel:{middle},{middle},{middle + 12}", "--cut", "lesion", "--width", "8", "--opening", "5",
        "--craniotomy", "20", "--approach", "0.2,0,1", "-o", out, "-q",
    )  # fmt: skip
    assert status == 0 and not lines
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["landmarks_mm"]["lesion"] == result["cut"]["target_mm"] == pytest.approx([0, 0, 12], abs=0.02)
    markup = json.loads((tmp_path / "head_landmarks.mrk.json").read_text())["markups"][0]
    assert (markup["coordinateSystem"], markup["coordinateUnits"]) == ("RAS", "mm")
    marked = {point["label"]: point["position"] for point in markup["controlPoints"]}
    assert {name: pytest.approx(place, abs=0.01) for name, place in marked.items()} == result["landmarks_mm"]
    assert result["cut"]["width_mm"] == 8 and 6 < result["cut"]["depth_mm"] < 10
    mesh = load(out).mesh
    assert {"wall_plus", "wall_minus", "end_plus", "end_minus", "floor", "craniotomy"} <= set(mesh.GetBoundaries())
    area = ngs.Integrate(ngs.CF(1), mesh, definedon=mesh.Boundaries("floor"))
    assert area == pytest.approx(40e-6, rel=1e-6 if route == "hull" else 0.25)
    lost = sum(labels.volumes_ml().values()) - sum(r["label_volume_ml"] for r in result["regions"].values())
    assert 1e3 * lost == pytest.approx(5 * 8 * result["cut"]["depth_mm"], rel=0.05)
    back = np.asarray(nibabel.load(tmp_path / "head_labels.nii.gz").dataobj)
    assert back[middle, middle, middle + 11] == 2 and not back[middle, middle, middle + 13 : middle + 20].any()
    assert "A cleft" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--site", "nose"], ["--site is 'nose'", "voxel:I,J,K", "centre of brain"]),
        (["--site", "voxel:0,0,400"], ["--site is 'voxel:0,0,400'", "field of view of labels.nii.gz"]),
        (["--site", "1,2"], ["--site is '1,2'", "three numbers"]),
        (["--landmark", "here"], ["--landmark is 'here'", "NAME=voxel:I,J,K"]),
        (["--width", "8"], ["--width", "--cut"]),
        (["--cut", "0,0,12", "--site", "0,0,12"], ["--site is given with --cut"]),
        (["--cut", "0,0,30"], ["--cut is '0,0,30'", "field of view"]),
        (["--cut", "0,0,20.5"], ["--cut is (0.0, 0.0, 20.5) mm", "inside the brain"]),
        (["--cut", "0,0,12", "--near", "3"], ["mesh size is 3 mm near and 5 mm far", "at most 2 mm near"]),
        (["--cut", "0,0,12", "--curve", "--route", "lattice"], ["--curve is given with --cut"]),
        (["--curve", "-o", "head.msh"], ["-o is 'head.msh'", ".vtkhdf"]),
        (["--curve"], ["--curve", "hull", "lattice or conforming"]),
        (["--names", "ngbrain,9=cyst", "--unit", "m"], ["--unit is given with an image"]),
        (["--names", "1=grey"], ["labels is without a name for [2, 3]"]),
        (["--names", "aseg"], ["names is 'aseg'", "freesurfer"]),
        (["-o", "head.stl"], ["-o is 'head.stl'", ".vtkhdf", ".feb"]),
        (["--size", "0"], ["mesh size", "above 0"]),
        (["--structures"], ["--structures is given with --labels", "T1"]),
        (["--size", "inf"], ["mesh size is inf mm near"]),
        (["--site", "0,0,0", "--radius", "-5"], ["radius is -5 mm"]),
        (["--site", "-500,0,0"], ["--site is '-500,0,0'", "field of view"]),
        (["--names", "freesurfer,3=lesion"], ["labels is without a name for [1]"]),
        (["--atlas", "a.nii"], ["--atlas is given without --atlas-t1"]),
        (["--atlas-t1", "a.nii"], ["--atlas-t1 is given without --atlas"]),
        (["--atlas", "a.nii", "--atlas-t1", "b.nii"], ["--atlas is given with --labels"]),
    ],
)
def test_bad_meshes(tmp_path, capsys, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    labels_file("labels.nii.gz")
    names = [] if "--names" in arguments else ["--names", "1=csf,2=brain,3=ventricles"]
    status, lines = run(capsys, "mesh", "labels.nii.gz", "--labels", "-q", *names, *arguments)
    assert status == 2 and len(lines) == 1 and all(word in lines[0] for word in words), lines
    assert [path.name for path in tmp_path.iterdir()] == ["labels.nii.gz"]


def test_an_empty_name_is_refused(capsys):
    with pytest.raises(SystemExit):
        main(["mesh", "labels.nii", "--labels", "--names", "1=grey,2="])
    assert "'1=grey,2=' has an empty name" in capsys.readouterr().err


def test_labels_are_not_taken_for_a_scan(tmp_path, capsys):
    labels = nested((55.0, 40.0, 12.0))
    image = nibabel.Nifti1Image(labels.volume.data.astype("uint8"), np.diag([1e3, 1e3, 1e3, 1]) @ labels.volume.affine)
    nibabel.save(image, tmp_path / "labels.nii.gz")
    status, lines = run(capsys, "mesh", tmp_path / "labels.nii.gz", "-o", tmp_path / "head.vtkhdf", "-q")
    assert status == 2 and len(lines) == 1 and "--labels" in lines[0]
