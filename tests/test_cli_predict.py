"""The verb `predict` end to end, by an operator without weights: files, words, and what is said to bad input."""

import json
from dataclasses import replace

import numpy as np
import pytest
from algebraic_operator import algebraic, few, square, uniform

from ngbrain.cli import main
from ngbrain.errors import MissingExtra
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.io.waves import write_waves
from ngbrain.surrogate.data.dataset import SIDES
from ngbrain.surrogate.prediction.pretrained import Operator


@pytest.fixture(autouse=True)
def unweighted(monkeypatch):
    monkeypatch.setattr(Operator, "load_default", staticmethod(algebraic))
    monkeypatch.setattr("ngbrain.cli.predict.runtime_version", lambda: "none")


def run(capsys, *arguments, verb="predict"):
    status = main([verb, *map(str, arguments)])
    out, err = capsys.readouterr()
    return status, out, err.strip().splitlines()


def test_files_numbers_and_words(tmp_path, capsys):
    labels = np.repeat([1, 2], 41 * 41 // 2 + 1)[: 41 * 41]
    write_waves(tmp_path / "waves.npz", uniform(labels=labels).with_noise(0.01, 0))
    status, out, errors = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out")
    assert status == 0 and not errors
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"result.json", "report.html", "maps.npz"}
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["verb"] == "predict" and result["source"] == "waves.npz" and result["threads"] == 1
    assert {"versions", "seed", "time_s", "checks", "trust", "model", "warnings", "files"} <= set(result)
    assert set(result["solves"]) >= {"factorisations", "forward", "adjoint", "incremental"}
    assert not any(result["solves"].values())
    answer = result["answers"]["storage"]
    assert answer["median"] == pytest.approx(6e3, rel=0.1) and answer["relative_l2_error"] < 0.3
    assert set(result["by_label"]["storage"]) == {"1", "2"}
    assert result["usable"] == (result["checks"]["score"] <= result["trust"]["threshold"]) == (result["reasons"] == [])
    with np.load(tmp_path / "out" / "maps.npz") as file:
        arrays = dict(file)
    found = arrays["storage"] + 1j * arrays["loss"]
    np.testing.assert_allclose(arrays["magnitude"], np.abs(found))
    assert (arrays["storage_deviation"] > 0).all() and arrays["measured"].shape == (1, 41 * 41, 2)
    page = (tmp_path / "out" / "report.html").read_text()
    for words in ("Storage modulus", "Residual of the equations of motion"):
        assert words in out and words in page
    assert page.count("data:image/png") == 4


@pytest.mark.parametrize("quiet", [(), ("-q",)])
def test_what_is_not_to_be_used_says_so_and_is_a_failure(tmp_path, capsys, quiet):
    write_waves(tmp_path / "waves.npz", replace(uniform(), frequency=[400.0]))
    status, out, errors = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out", *quiet)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert status == 3 and not result["usable"]
    assert errors[-1] == f"ngbrain: do not use these maps: {result['reasons'][0]}" and "frequency" in errors[-1]
    assert not out if quiet else out.startswith("Do not use: ")
    assert "Do not use: " in (tmp_path / "out" / "report.html").read_text()


def test_waves_of_the_other_time_convention_are_refused(tmp_path, capsys):
    write_waves(tmp_path / "waves.npz", Phantom.from_name("CV-G", 25).simulate_measurements(0.01).data().conjugate())
    status, _, errors = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out")
    assert status == 2 and "gain energy" in errors[-1] and "--conjugate" in errors[-1]


@pytest.mark.parametrize(("noise", "phase"), [(0.0, 1.0), (0.01, 1.0), (0.01, 0.6 + 0.8j)])
def test_real_parts_of_waves_with_a_loss_are_refused(tmp_path, capsys, noise, phase):
    """The operator would predict a loss of -.3 Pa, beside 10 kPa, with a low score."""
    data = Phantom.from_name("CV-G", 33).simulate_measurements().data()
    data = replace(data, displacement=data.displacement.real * phase)
    write_waves(tmp_path / "waves.npz", data.with_noise(noise, 0) if noise else data)
    status, _, errors = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out")
    assert status == 2 and "displacement is without imaginary parts" in errors[-1]


def pressed(**changes):
    data = few("compression", "validation")  # the first
    u = np.concatenate([np.full_like(data.displacement[0], np.nan), data.displacement[0]], axis=2)
    given = {"poisson": float(data.poisson[0]), "truth": {"youngs": data.storage[0].ravel()}, **changes}
    return square(u, SIDES["compression"], **given)


def test_compression_comes_back_as_images(tmp_path, capsys):
    step = SIDES["compression"] / 30
    write_waves(tmp_path / "echo.nii.gz", pressed(affine=np.diag([step, step, step, 1.0])))
    status, out, errors = run(capsys, tmp_path / "echo.nii.gz", "-o", tmp_path / "out", "-q")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert status == 0 and not out and errors == [f"ngbrain: note: {note}" for note in result["warnings"]]
    assert result["solves"]["forward"] == 1 and any("up to a constant factor" in note for note in result["warnings"])
    assert result["answers"]["youngs"]["relative_l2_error"] < 0.45
    (shown,) = (float(note.split("set to ")[1].split()[0]) for note in result["warnings"] if "set to" in note)
    import nibabel

    for name in ("youngs", "youngs_deviation"):
        image = nibabel.load(tmp_path / "out" / f"{name}.nii.gz")
        assert image.shape == (31, 31, 1) and np.isfinite(np.asarray(image.dataobj)).all()
        if name == "youngs":
            assert np.mean(np.asarray(image.dataobj)) == pytest.approx(1e3 * shown, rel=1e-3)


def test_an_inversion_starts_from_it(tmp_path, capsys):
    write_waves(tmp_path / "waves.npz", Phantom.from_name("CV-G", 27).simulate_measurements(0.01).data())
    rough = ("--regulariser", "smooth", "-q")
    status, _, _ = run(
        capsys, tmp_path / "waves.npz", "-o", tmp_path / "a", "--start", "surrogate", *rough, verb="invert"
    )
    assert status == 0
    result = json.loads((tmp_path / "a" / "result.json").read_text())
    assert set(result["starts"]) == {"given", "both"} and result["selected_start"] == "both"
    assert result["answers"]["storage"]["relative_l2_error"] < 0.02
    assert any("started from the maps of the trained operator" in note for note in result["warnings"])
    for option in (("--starts", "all"), ("--subzones",)):
        status, _, (error,) = run(
            capsys, tmp_path / "waves.npz", "-o", tmp_path / "b", "--start", "surrogate", *option, verb="invert"
        )
        assert status == 2 and "--start" in error and not (tmp_path / "b").exists()


def test_fibres_are_refused(tmp_path, capsys):
    fibrous = replace(uniform(), symmetry="transversely_isotropic", fibre=np.array([1.0, 0.0]), truth={})
    write_waves(tmp_path / "waves.npz", fibrous)
    status, out, (error,) = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out")
    assert status == 2 and not out and not (tmp_path / "out").exists()
    assert "waves.npz: symmetry is transversely_isotropic" in error and "fibres" in error


def test_bad_input_before_the_work(tmp_path, capsys, monkeypatch):
    write_waves(tmp_path / "waves.npz", uniform())
    (tmp_path / "taken").write_text("")
    status, _, (error,) = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "taken")
    assert status == 2 and "-o is" in error
    status, _, (error,) = run(capsys, tmp_path / "none.npz", "-o", tmp_path / "out")
    assert status == 2 and "none.npz" in error and "missing" in error

    def missing():
        raise MissingExtra("onnxruntime", "surrogate")

    monkeypatch.setattr("ngbrain.cli.predict.runtime_version", missing)
    status, _, (error,) = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out")
    assert status == 2 and 'pip install "ngbrain[surrogate]"' in error and not (tmp_path / "out").exists()
