"""Sample data: what is shipped is what it says it is, and nothing is overwritten."""

import hashlib
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import ngbrain
from ngbrain import datasets
from ngbrain.cli import main
from ngbrain.datasets import DATASETS, SHIPPED
from ngbrain.errors import InputError
from ngbrain.image import mni152, read_scan
from ngbrain.scene import Scene
from ngbrain.surgery.observations import Observations

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import _samples

WAVES = [name for name, dataset in DATASETS.items() if dataset.kind == "waves"]


def test_what_is_shipped_is_listed_and_small():
    listed = [file for dataset in DATASETS.values() for file in dataset.files if not dataset.external_size]
    assert sorted(set(listed)) == sorted(path.name for path in SHIPPED.iterdir())
    assert sum(path.stat().st_size for path in SHIPPED.iterdir()) <= 1e6
    assert ngbrain.datasets is datasets


@pytest.mark.parametrize("name", ["waves_plane", "ultrasound"])
def test_the_script_makes_them_anew(name):
    made, shipped = _samples.WAVES[name](), datasets.load_waves(name)
    np.testing.assert_allclose(shipped.points, made.points)
    off = np.abs(shipped.displacement - made.displacement) / np.where(made.rms > 0, made.rms, 1)
    assert np.nanmax(off) < 0.1 * made.noise and shipped.noise == made.noise
    assert (np.isnan(shipped.displacement) == np.isnan(made.displacement)).all()
    for each in made.truth:
        np.testing.assert_allclose(shipped.truth[each], made.truth[each], rtol=1e-6)


def test_waves_carry_noise_as_stated_and_their_truth():
    """At points of one line, second differences of smooth waves are small beside those of white noise at 2 %."""
    for name in WAVES:
        data = datasets.load_waves(name)
        assert data.truth and data.noise and data.grid is not None
    plane = datasets.load_waves("waves_plane")
    u = plane.grid.box(plane.displacement[0, :, 0] / plane.rms[0, 0, 0])
    left = u
    for _ in range(4):
        left = np.diff(left, axis=0)
    assert np.sqrt(np.mean(np.abs(left) ** 2) / 70) == pytest.approx(plane.noise, rel=0.25)
    assert np.abs(plane.truth["shear"]).max() > 1.8 * np.abs(np.median(plane.truth["shear"]))


def test_ultrasound_is_axial_and_at_rest():
    data = datasets.load_waves("ultrasound")
    assert not data.frequency.any() and not data.displacement.imag[~np.isnan(data.displacement)].any()
    assert (~data.measured[..., 0]).all() and data.measured[..., 1].all()


def test_files_are_written_and_never_replaced_unasked(tmp_path):
    (path,) = datasets.write("waves_plane", tmp_path / "new")
    assert path.read_bytes() == (SHIPPED / "waves_plane.npz").read_bytes()
    path.write_text("mine")
    with pytest.raises(InputError, match="there already"):
        datasets.write("waves_plane", tmp_path / "new")
    assert path.read_text() == "mine"
    datasets.write("waves_plane", tmp_path / "new", overwrite=True)
    assert path.stat().st_size > 4 and len(list(path.parent.iterdir())) == 1


def test_of_several_files_none_is_written_where_one_is_there(tmp_path):
    name, dataset = next((name, each) for name, each in DATASETS.items() if len(each.files) > 1)
    (tmp_path / dataset.files[-1]).write_text("mine")
    with pytest.raises(InputError, match="there already"):
        datasets.write(name, tmp_path)
    assert len(list(tmp_path.iterdir())) == 1


def test_a_head_in_a_file_is_the_head(tmp_path):
    (path,) = datasets.write("mni152", tmp_path)
    scan, template = read_scan(path), mni152()
    np.testing.assert_array_equal(scan.volume.data, template.volume.data)
    np.testing.assert_allclose(scan.volume.affine, template.volume.affine, atol=1e-9)


def test_colin27_is_taken_from_where_it_is_or_said_to_be_missing(tmp_path, monkeypatch):
    where = tmp_path / "ch2.nii.gz"
    monkeypatch.setattr(datasets, "COLIN27", (tmp_path / "none", where))
    with pytest.raises(InputError, match="apt install mricron-data"):
        datasets.write("colin27", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (made,) = datasets.write("mni152", tmp_path)
    shutil.move(made, where)
    (path,) = datasets.write("colin27", tmp_path / "out")
    assert path.read_bytes() == where.read_bytes()
    assert datasets.load_head("colin27").volume.data.shape == (197, 233, 189)


def test_maps_are_fetched_checked_and_written_whole(tmp_path, monkeypatch):
    """A file that is not the published one, or a host that does not answer, leaves nothing behind; no test goes to the network."""
    there = tmp_path / "there"
    there.mkdir()
    monkeypatch.setattr(datasets, "MRE134", there.as_uri())
    stiffness, damping = DATASETS["mre134"].files
    (there / stiffness).write_bytes(b"stiffness")
    with pytest.raises(InputError, match=f"{damping}|{stiffness}"):
        datasets.write("mre134", tmp_path / "out")
    (there / damping).write_bytes(b"damping")
    with pytest.raises(InputError, match=f"{stiffness} is of SHA-256 .* as fetched from .*; wanted: 360cecd11236"):
        datasets.write("mre134", tmp_path / "out")
    sums = {file: hashlib.sha256((there / file).read_bytes()).hexdigest() for file in (stiffness, damping)}
    monkeypatch.setattr(datasets, "SHA256", sums)
    (there / damping).rename(there / "away")
    with pytest.raises(InputError, match=rf"{damping} is not available from .*; wanted: .*by hand"):
        datasets.write("mre134", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (there / "away").rename(there / damping)
    assert [path.read_bytes() for path in datasets.write("mre134", tmp_path / "out")] == [b"stiffness", b"damping"]


@pytest.mark.parametrize("load", [datasets.load_waves, datasets.load_head, datasets.write])
def test_other_names_are_refused_with_the_nearest(load):
    with pytest.raises(InputError, match="data set is 'waves_plan'"):
        load("waves_plan")
    with pytest.raises(InputError, match="wanted"):
        datasets.load_waves("mni152")


def test_the_verb_lists_and_writes(tmp_path, capsys):
    assert main(["data"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:]] == list(DATASETS)
    assert main(["data", "ultrasound", "plate", "-o", str(tmp_path)]) == 0
    assert [Path(line.split()[0]).name for line in capsys.readouterr().out.splitlines()] == [
        "ultrasound.npz",
        "plate.toml",
    ]
    assert main(["data", "plate", "-o", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "plate.toml" in said and "--overwrite" in said and said.count("\n") == 1
    assert main(["data", "plate", "-o", str(tmp_path), "--overwrite", "-q"]) == 0
    assert main(["data", "plates"]) == 2 and main(["data", "plate", "-o", str(tmp_path / "plate.toml")]) == 2
    assert capsys.readouterr().out == ""


def test_scenes_are_read_by_their_verbs():
    assert Scene.from_toml(SHIPPED / "plate.toml").quantities
    scene = Scene.from_toml(SHIPPED / "retraction.toml")
    assert [protocol.kind for protocol in scene.protocols] == ["continuous"]
    seen = Observations.read(SHIPPED / "retraction_landmarks.csv", SHIPPED / "retraction_force.csv")
    assert len(seen.landmarks) == 16 and seen.force.max() > 0.5
