"""The verb `invert` end to end on a small grid, and what it says to bad input before any work is begun."""

import json
import re
import sys
from dataclasses import replace

import host_cudss
import numpy as np
import pytest
from corrupted_waves import spoiled
from planewaves import RHO, grid, shear_waves

from ngbrain.cli import main
from ngbrain.errors import MissingExtra, SolverError
from ngbrain.inverse.data.quality import octahedral_shear_strain, strain_snr_mask
from ngbrain.io.waves import WaveData, read_waves, write_waves
from ngbrain.report.pages.parameters import percent

SHEAR = 2500 + 500j
PURPOSES = ("forward", "adjoint", "incremental", "traces", "checks", "refinements")
ROUGH = ("--regulariser", "smooth", "--starts", "waves", "-q")


def plane(shear=SHEAR, **changes):
    points = grid(10, 9, spacing=4e-3)
    u = np.array([shear_waves(points, shear), shear_waves(points[:, ::-1], shear)[:, ::-1]])
    given = {
        "symmetry": "isotropic",
        "rheology": "viscoelastic",
        "poisson": 0.4,
        "truth": {"shear": np.full(90, shear)},
    }
    return WaveData(points, u, [50.0] * 2, RHO, **{**given, **changes}).with_noise(0.02, seed=0)


@pytest.fixture
def waves(tmp_path):
    write_waves(tmp_path / "waves.npz", plane(labels=np.repeat([1, 2], 45)))
    return tmp_path / "waves.npz"


@pytest.fixture
def no_work(monkeypatch):
    def work(*_, **__):
        raise AssertionError("hours of work were begun")

    monkeypatch.setattr("ngbrain.cli.invert.invert", work)


def run(capsys, *arguments):
    status = main(["invert", *map(str, arguments)])
    out, err = capsys.readouterr()
    return status, out, err.strip().splitlines()


def test_files_numbers_and_words(tmp_path, capsys, waves):
    status, out, errors = run(capsys, waves, "-o", tmp_path / "out", "--regulariser", "smooth")
    assert status == 0 and not errors
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"result.json", "report.html", "maps.npz"}
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["verb"] == "invert" and result["source"] == "waves.npz" and result["threads"] == 1
    assert {"versions", "seed", "time_s", "checks", "model", "noise", "starts", "warnings"} <= set(result)
    assert set(result["solves"]) == {"factorisations", *PURPOSES}
    assert set(result["starts"]) == {"waves", "uniform", "both"} and result["noise"]["assumed"] == pytest.approx(0.02)
    assert result["answers"]["storage"]["median"] == pytest.approx(2500, rel=0.02)
    assert result["answers"]["storage"]["relative_l2_error"] < 0.05
    assert set(result["by_label"]["storage"]) == {"1", "2"}
    assert 0.8 < result["checks"]["misfit_over_expected"] < 1.3 and result["checks"]["strain_snr"] > 3
    assert "resonance_distance" not in result["checks"]  # there is loss
    determined = result["model"]["effective_dof"]["storage"]
    assert 0 <= determined < 10  # the truth is the same everywhere
    side = (36 * 32 / max(determined, 1)) ** 0.5
    assert result["model"]["resolution_mm"]["storage"] == pytest.approx(side)
    with np.load(tmp_path / "out" / "maps.npz") as file:
        arrays = dict(file)
    assert arrays["points"].shape == (90, 2) and arrays["predicted"].shape == (2, 90, 2)
    found = arrays["storage"] + 1j * arrays["loss"]
    np.testing.assert_allclose(arrays["magnitude"], np.abs(found))
    np.testing.assert_allclose(arrays["damping_ratio"], found.imag / found.real / 2)
    assert np.median(found) == pytest.approx(SHEAR, rel=0.05)
    assert np.sum(np.abs(arrays["residual"]) ** 2) == pytest.approx(
        result["starts"][result["selected_start"]]["misfit"], rel=1e-6
    )
    words = (
        "Storage modulus G′ kPa",
        "G″ error",
        "uniform fields",
        "Misfit over its expected value",
        " factorisations, ",
        " traces, ",
        "report: ",
    )
    assert all(word in out for word in words), out
    error = percent(result["answers"]["storage"]["relative_l2_error"])
    assert error in out and error in (tmp_path / "out" / "report.html").read_text()


def test_data_without_loss_say_how_near_a_resonance_is_and_images_come_back_as_images(tmp_path, capsys):
    affine = np.diag([4e-3, 4e-3, 4e-3, 1.0])
    data = plane(3000.0, rheology="elastic", truth={}, affine=affine)
    write_waves(tmp_path / "waves.nii.gz", data)
    status, out, errors = run(
        capsys, tmp_path / "waves.nii.gz", "-o", tmp_path / "out", *ROUGH, "--bars", "--bids", "sub-7"
    )
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert status == 0 and not out and result["warnings"]
    assert errors == [f"ngbrain: note: {note}" for note in result["warnings"]]  # never silenced
    assert 0 < result["checks"]["resonance_distance"] < 1 and "relative_l2_error" not in result["answers"]["youngs"]
    assert result["answers"]["youngs"]["median"] == pytest.approx(2.8 * 3000, rel=0.03)
    import nibabel

    image = nibabel.load(tmp_path / "out" / "youngs.nii.gz")
    assert image.shape == (10, 9, 1) and np.median(np.asarray(image.dataobj)) == pytest.approx(2.8 * 3000, rel=0.03)
    low, high = (nibabel.load(tmp_path / "out" / f"stiffness_{end}.nii.gz").get_fdata() for end in ("low", "high"))
    assert np.all(low < high) and {"youngs_low.nii.gz", "magnitude_high.nii.gz"} <= set(result["files"])
    assert image.header["descrip"].tobytes().rstrip(b"\0") == b"Young's modulus (Pa)"
    assert image.header.get_intent()[2] == "Young's modulus" and image.header.get_xyzt_units()[0] == "mm"
    about = json.loads((tmp_path / "out" / "youngs_low.json").read_text())
    assert about["Units"] == "Pa" and about["LongName"] == "Young's modulus, lower end of the 95 % interval"
    assert "waves.nii.gz" in about["Sources"][0]
    dataset = tmp_path / "out" / "bids_derivative"
    maps = sorted(path.name for path in (dataset / "sub-7" / "anat").iterdir())
    assert "sub-7_desc-stiffnessLow_mre.nii.gz" in maps and "sub-7_desc-stiffnessLow_mre.json" in maps
    assert all(re.fullmatch(r"sub-7_desc-[A-Za-z0-9]+_mre\.(nii\.gz|json)", name) for name in maps)
    described = json.loads((dataset / "dataset_description.json").read_text())
    assert described["DatasetType"] == "derivative" and described["GeneratedBy"][0]["Name"] == "ngbrain"
    assert "bids_derivative/sub-7/anat/sub-7_desc-youngs_mre.nii.gz" in result["files"]
    strain = nibabel.load(tmp_path / "out" / "oss_snr.nii.gz")  # of both loads
    assert strain.shape == (10, 9, 1, 2) and "oss.nii.gz" in result["files"]
    with np.load(tmp_path / "out" / "maps.npz") as file:
        assert file["oss"].shape == (2, 90) and np.median(file["oss_snr"]) == result["checks"]["strain_snr"]
        np.testing.assert_allclose(np.asarray(strain.dataobj)[..., 0, :].reshape(-1, 2, order="F").T, file["oss_snr"])
    assert all((tmp_path / "out" / name).is_file() for name in result["files"])


def test_data_in_space(tmp_path, capsys):
    points = grid(9, 8, 8, spacing=3e-3)
    u = shear_waves(points, SHEAR)[None]
    data = WaveData(
        points, u, [50.0], RHO, "isotropic", "viscoelastic", bulk=2e5, labels=np.repeat([0, 2], len(points) // 2)
    )
    write_waves(tmp_path / "space.npz", data.with_noise(0.02, seed=0))
    assert main(["invert", str(tmp_path / "space.npz"), "-o", str(tmp_path / "out"), "--by-label"]) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["model"]["form"] == "P3" and set(result["model"]["weights"]) >= {"storage 0", "storage 2"}
    assert result["answers"]["storage"]["median"] == pytest.approx(SHEAR.real, rel=0.1)
    with np.load(tmp_path / "out" / "maps.npz") as file:
        G = file["storage"] + 1j * file["loss"]
    wanted = {"storage": G.real, "loss": G.imag, "magnitude": np.abs(G), "phase": np.angle(G)}
    wanted |= {"damping_ratio": G.imag / G.real / 2, "stiffness": RHO / np.sqrt(RHO / G).real ** 2}
    assert set(result["by_label"]) == set(wanted)
    for name, values in wanted.items():  # of both labels that have fields, 0 too
        for label, own in zip(("0", "2"), np.split(values, 2), strict=True):
            low, median, high = np.percentile(own, (25, 50, 75))
            told = result["by_label"][name].pop(label)
            assert (told["median"], told["iqr"]) == pytest.approx((median, high - low)), (name, label)
        assert not result["by_label"][name]
    page = (tmp_path / "out" / "report.html").read_text()
    assert '<th scope="row">0</th>' in page and "ρc² (kPa)" in page
    assert "Storage modulus" in capsys.readouterr().out


@pytest.mark.slow
def test_data_in_space_by_zones(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("ngbrain.inverse.subzones.invert.SIDE", 0.7)  # two of them
    monkeypatch.setattr("ngbrain.inverse.subzones.invert.OVERLAP", 0.2)
    points = grid(16, 8, 8, spacing=3e-3)
    labels = 1 + (points[:, 1] > 0.01)
    kind = ("isotropic", "viscoelastic")
    data = WaveData(points, shear_waves(points, SHEAR)[None], [50.0], RHO, *kind, bulk=2e5, labels=labels)
    write_waves(tmp_path / "space.npz", data.with_noise(0.02, seed=0))
    status, out, errors = run(capsys, tmp_path / "space.npz", "-o", tmp_path / "out", "--subzones", "--by-label")
    assert status == 0 and not errors
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"result.json", "report.html", "maps.npz"}
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["model"]["zones"] == 2 and result["selected_start"] == "pass 1"
    assert set(result["by_label"]["storage"]) == set("12") and set(result["model"]["weights"]) >= {
        "storage 1",
        "storage 2",
    }
    assert result["answers"]["storage"]["median"] == pytest.approx(SHEAR.real, rel=0.1)
    assert all(word in out for word in ("zones among their neighbours", "Zones", "differ"))


def test_choices_reach_the_zones(tmp_path, capsys, monkeypatch, waves):
    chosen = {}

    def caught(data, **options):
        chosen.update(options)
        raise SolverError("zone 1 of 2: seen enough")

    monkeypatch.setattr("ngbrain.cli.invert.invert_by_subzones", caught)
    options = ("--subzones", "--threads", 2, "--by-label", "--noise", 0.03, "--rounds", 3, "-q")
    status, _, lines = run(capsys, waves, "-o", tmp_path / "out", *options)
    assert status == 3 and "zone 1 of 2: seen enough" in lines[0]
    told = {"labelled": True, "noise": 0.03, "max_iterations": 3, "checkpoint": tmp_path / "out" / "zones"}
    assert {name: chosen[name] for name in told} == told and chosen["executor"].workers == 2


def test_outliers_are_left_out_where_that_is_asked_for(tmp_path, capsys):
    data, where = spoiled(plane(), 0.05, 1.0, seed=3)
    write_waves(tmp_path / "waves.npz", data)
    status, _, _ = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out", *ROUGH)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    said = [note for note in result["warnings"] if "far off a smooth field" in note]
    assert status == 0 and where.sum() == 2
    assert result["answers"]["storage"]["relative_l2_error"] < 0.04
    assert int(said[0].split()[0]) in range(6, 16) and "of 360 displacements" in said[0]


def test_waves_of_the_other_time_convention_are_refused_and_taken_where_that_is_said(tmp_path, capsys, monkeypatch):
    taken = []

    def caught(data, elements, **options):
        taken.append(data)
        raise SolverError("seen enough")

    monkeypatch.setattr("ngbrain.cli.invert.invert", caught)
    data = plane()
    write_waves(tmp_path / "waves.npz", data.conjugate())
    status, _, errors = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out", *ROUGH)
    assert status == 2 and len(errors) == 1 and "gain energy" in errors[0] and "--conjugate" in errors[0]
    status, _, _ = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out", "--conjugate", *ROUGH)
    assert status == 3
    np.testing.assert_array_equal(taken[0].displacement, data.displacement)


def test_outliers_are_kept_where_that_is_asked_for(tmp_path, capsys, monkeypatch):
    """Their effect on an inversion is tested in `stability/test_outliers`."""
    taken = []

    def caught(data, elements, **options):
        taken.append(data)
        raise SolverError("seen enough")

    monkeypatch.setattr("ngbrain.cli.invert.invert", caught)
    data, where = spoiled(plane(), 0.05, 1.0, seed=3)
    write_waves(tmp_path / "waves.npz", data)
    status, _, _ = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out", "--no-drop-outliers", *ROUGH)
    assert status == 3 and where.sum() == 2
    np.testing.assert_array_equal(taken[0].displacement, data.displacement)


@pytest.mark.parametrize(
    ("starts", "levels"), [("waves", ()), ("auto", None), ("all", (1.0,)), ("many", (0.5, 0.7, 1.0, 1.4, 2.0))]
)
def test_choices_reach_the_inversion(tmp_path, capsys, monkeypatch, waves, starts, levels):
    chosen = {}

    def caught(data, elements, **options):
        chosen.update(options)
        raise SolverError("seen enough")

    monkeypatch.setattr("ngbrain.cli.invert.invert", caught)
    choices = ("--regulariser", "matern", "--weight", "l-curve", "--starts", starts, "--model-error", "0.01", "-q")
    choices += ("--unknowns", "polar", "--misfit", "huber", "--rounds", "5")
    status, _, lines = run(capsys, waves, "-o", tmp_path / "out", *choices)
    assert status == 3 and "seen enough" in lines[0]
    told = {"regulariser": "matern", "weight": "l-curve", "levels": levels, "model_error": 0.01, "noise": None}
    told |= {"unknowns": "polar", "misfit": "huber", "max_iterations": 5}
    assert {name: chosen[name] for name in told} == told


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--noise", "-0.1"], ["--noise is -0.1", "0.02"]),
        (["--noise", "nan"], ["--noise is nan"]),
        (["--rounds", "0"], ["--rounds is 0", "at least 1"]),
        (["--executor", "banana"], ["executor is 'banana'", "dask:ADDRESS"]),
        (["--oss-snr", "-3"], ["--oss-snr is -3.0", "positive"]),
        (["--model-error", "20"], ["--model-error is 20.0"]),
        (["--discretisation", "data"], ["waves.npz: element is not given", "q4"]),
        (["--bids", "sub-01"], ["--bids is given with data that are no image", "a NIfTI image"]),
        (["--bids", "patient 7"], ["--bids is 'patient 7'", "sub-LABEL"]),
        (["-o", "waves.npz"], ["-o is waves.npz", "a folder"]),
        (["--subzones", "--unknowns", "polar"], ["--unknowns is polar", "moduli with --subzones"]),
        (["--subzones", "--weight", "l-curve"], ["--weight is l-curve", "evidence with --subzones"]),
        (["--subzones", "--device", "cuda"], ["--device is cuda", "cpu with --subzones"]),
        (["--subzones", "--discretisation", "data"], ["--discretisation is data", "left out with --subzones"]),
        (["--subzones"], ["waves.npz: points is in the plane"]),
    ],
)
def test_bad_options(tmp_path, capsys, monkeypatch, waves, no_work, arguments, words):
    monkeypatch.chdir(tmp_path)
    status, out, lines = run(capsys, "waves.npz", "-q", *arguments)
    assert status == 2 and len(lines) == 1 and not out
    assert all(word in lines[0] for word in [*words, "wanted"]), lines[0]
    assert not list(tmp_path.rglob("result.json"))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("absent.npz", None, ["absent.npz", "missing"]),
        ("cut.npz", b"PK\x03\x04 and no more", ["cut.npz: data is damaged, or no archive; wanted: a whole archive"]),
        ("text.npz", b"points = 1", ["text.npz: data is damaged, or no archive; wanted: a whole archive"]),
        ("waves.mat", b"", ["waves.mat", ".mat file"]),
    ],
)
def test_bad_files(tmp_path, capsys, no_work, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    status, _, lines = run(capsys, tmp_path / name, "-o", tmp_path / "out", "-q")
    assert status == 2 and len(lines) == 1 and all(word in lines[0] for word in words), lines
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"displacement": np.zeros((2, 90, 2))}, "displacement is 0 everywhere in load 0; wanted: a body that moves"),
        (
            {"frequency": [50e3, 50e3]},
            "frequency is 50000, so that waves of 31.1 mm mean a shear modulus of 2.42 GPa; wanted: Hz",
        ),
        (
            {"frequency": [0.05, 0.05]},
            "frequency is 0.05, so that waves of 31.1 mm mean a shear modulus of 0.00242 Pa; wanted: Hz",
        ),
        (
            {"dirichlet": np.ones((9, 10), bool)},
            "dirichlet is bool of shape (9, 10); wanted: true or false for each of the 90",
        ),
        (
            {"noise": np.full(9, 0.1)},
            "noise is float64 of shape (9,); wanted: one number, relative (0.02: two per cent), or 90",
        ),
        (
            {"labels": np.array([{}] * 90, object)},
            "labels is made of Python objects; wanted: a plain array, without pickles",
        ),
    ],
    ids=["still", "kHz", "mHz", "flags", "noise", "pickled"],
)
def test_bad_fields(tmp_path, capsys, recwarn, waves, changes, line):
    """Each error is one line, without a NumPy warning before it."""
    np.savez(tmp_path / "bad.npz", **{**dict(np.load(waves)), **changes})
    status, out, lines = run(capsys, tmp_path / "bad.npz", "-o", tmp_path / "out", *ROUGH)
    assert status == 2 and len(lines) == 1 and not out and not recwarn.list
    assert lines[0].startswith(f"ngbrain: {tmp_path}/bad.npz: {line}")


def test_what_is_not_installed_is_said_first(tmp_path, capsys, monkeypatch, waves, no_work):
    def missing(package, extra):
        raise MissingExtra(package, extra)

    monkeypatch.setattr("ngbrain.cli.invert.require", missing)
    status, _, lines = run(capsys, waves, "-o", tmp_path / "out")
    assert status == 2 and lines == ['ngbrain: matplotlib is not installed; get it with: pip install "ngbrain[report]"']


def test_a_gpu_without_its_library_is_said_first(tmp_path, capsys, monkeypatch, waves, no_work):
    monkeypatch.setitem(sys.modules, "nvmath.sparse.advanced", None)
    status, _, lines = run(capsys, waves, "-o", tmp_path / "out", "--device", "cuda")
    assert status == 2 and lines == ['ngbrain: nvmath is not installed; get it with: pip install "ngbrain[gpu]"']


def test_an_inversion_on_a_gpu(tmp_path, capsys, monkeypatch, waves):
    cudss = host_cudss.install(monkeypatch)
    status, _, _ = run(capsys, waves, "-o", tmp_path / "out", *ROUGH, "--device", "cuda")
    assert status == 0 and len(cudss.made) > 5
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["device"] == "cuda" and result["answers"]["storage"]["median"] == pytest.approx(2500, rel=0.02)


def test_a_solver_that_gives_up_leaves_its_rounds(tmp_path, capsys, monkeypatch, waves):
    def descend(*_):
        raise SolverError("no way down")

    monkeypatch.setattr("ngbrain.inverse.optimise.gauss_newton.GaussNewton.descend", descend)
    status, _, lines = run(capsys, waves, "-o", tmp_path / "out", *ROUGH)
    assert status == 3 and lines == [f"ngbrain: no way down; the steps so far are in {tmp_path / 'out'}"]
    rounds = json.loads((tmp_path / "out" / "rounds.json").read_text())
    assert rounds[0]["phase"] == "waves" and rounds[-1]["misfit"] > 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["rounds.json"]


def test_a_stopped_inversion_promises_no_resume(tmp_path, capsys, monkeypatch, waves):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("ngbrain.cli.invert.invert", stop)
    status, _, lines = run(capsys, waves, "-o", tmp_path / "out")
    assert status == 130 and lines == ["ngbrain: stopped"]


def test_what_is_hardly_strained_is_left_out_where_that_is_asked_for(tmp_path, capsys, monkeypatch, waves):
    taken = []

    def caught(data, elements, **options):
        taken.append(data)
        raise SolverError("seen enough")

    monkeypatch.setattr("ngbrain.cli.invert.invert", caught)
    snr = octahedral_shear_strain(data := read_waves(waves), 0.02).snr.max(axis=0)
    least = float(np.quantile(snr, 0.7))
    status, _, _ = run(capsys, waves, "-o", tmp_path / "out", *ROUGH, "--oss-snr", least)
    assert status == 3 and not taken[0].mask.all() and taken[0].mask.sum() > 5
    np.testing.assert_array_equal(taken[0].mask, strain_snr_mask(data, None, least))
    assert not (taken[0].dirichlet & ~taken[0].mask).any()


def test_without_a_component_there_is_no_strain(tmp_path, capsys):
    data = plane()
    u = data.displacement.copy()
    u[:, :, 0] = np.nan
    write_waves(tmp_path / "axial.npz", replace(data, displacement=u))
    status, out, errors = run(capsys, tmp_path / "axial.npz", "-o", tmp_path / "out", *ROUGH[:-1], "--rounds", "1")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    said = "no octahedral shear strain (OSS) where a component is never measured: component x of load 1, component x of load 2"
    assert status == 0 and not errors and said in result["warnings"] and said in out
    page = (tmp_path / "out" / "report.html").read_text()
    assert "strain_snr" not in result["checks"] and said[1:] in page and 'img alt="Octahedral' not in page


def test_what_has_not_settled_is_said_everywhere(tmp_path, capsys):
    """Viscoelastic waves with real parts only: one iteration does not converge, and the maps are not usable."""
    data = plane()
    write_waves(tmp_path / "waves.npz", replace(data, displacement=data.displacement.real))
    chosen = (*ROUGH[:-1], "--noise", "0.07", "--rounds", "1")
    status, out, errors = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out", *chosen)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    kept = result["starts"][result["selected_start"]]
    assert status == 3 and errors and not result["checks"]["converged"] and not kept["converged"]
    level = f"the misfit is {kept['misfit']:.4g}, its expected value {kept['expected_misfit']:.4g}"
    assert result["warnings"][0].startswith("stopped after 1 iteration, before") and result["warnings"][0].endswith(
        level
    )
    for words in (out, (tmp_path / "out" / "report.html").read_text()):
        assert "not converged: stopped after 1 iteration" in words and level in words


def test_error_bars(tmp_path, capsys, waves):
    status, out, errors = run(capsys, waves, "-o", tmp_path / "out", *ROUGH[:-1], "--bars")
    assert (
        status == 0 and "Mean of G′, 95 % credible interval" in out and "mean (95 % interval)" in out.split("start")[0]
    )
    assert "half its width" in (tmp_path / "out" / "report.html").read_text()
    assert len(errors) == 1 and errors[0].startswith("ngbrain: error bars: about ")
    bars = json.loads((tmp_path / "out" / "result.json").read_text())["error_bars"]
    for name, truth in (("storage", SHEAR.real), ("loss", SHEAR.imag)):
        mean = bars[name]["mean"]
        assert mean["low"] < mean["value"] < mean["high"] and abs(mean["value"] - truth) < 4 * mean["deviation"]
        assert set(bars[name]["by_label"]) == {"1", "2"}
    with np.load(tmp_path / "out" / "maps.npz") as maps:
        for name in ("storage", "loss", "magnitude", "stiffness"):
            assert np.all((maps[f"{name}_low"] < maps[name]) & (maps[name] < maps[f"{name}_high"]))


@pytest.mark.slow
def test_a_hole_in_data_in_their_own_elements_with_a_known_truth(tmp_path, capsys):
    mask = np.ones(90, bool)
    mask[44] = False
    write_waves(tmp_path / "hole.npz", plane(element="q4", mask=mask))
    status, _, errors = run(capsys, tmp_path / "hole.npz", "-o", tmp_path / "out", *ROUGH)
    assert status == 0 and any("errors are too optimistic" in line for line in errors)


@pytest.mark.parametrize("quiet", [(), ("-q",)])
def test_what_is_not_to_be_used_is_said_and_ends_with_3(tmp_path, capsys, quiet):
    data = plane()
    shuffled = np.random.default_rng(0).permutation(len(data.points))
    write_waves(tmp_path / "waves.npz", replace(data, displacement=data.displacement[:, shuffled], truth={}))
    arguments = [a for a in ROUGH if a != "-q"] + ["--rounds", "3", "--no-drop-outliers", *quiet]
    status, out, errors = run(capsys, tmp_path / "waves.npz", "-o", tmp_path / "out", *arguments)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert status == 3 and not result["usable"] and "are not explained" in result["reasons"][0]
    assert "do not use these maps" in errors[-1] and "are not explained" in errors[-1]
    assert ("Do not use: " in out) == (not quiet)
    assert "Do not use" in (tmp_path / "out" / "report.html").read_text()
