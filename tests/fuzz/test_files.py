"""Files that are nearly right are read, or refused in one line: no traceback, no signal, no hang, no gigabytes."""

import os
import resource
import subprocess
import sys
import warnings

import numpy as np
import pytest

pytest.importorskip("nibabel")
pytest.importorskip("onnxruntime")

from fuzz.mutations import changed, made

from ngbrain.cli import main
from ngbrain.errors import NgbrainError
from ngbrain.image.read.image_file import read_scan
from ngbrain.io import load
from ngbrain.io.waves import read_waves
from ngbrain.scene import Scene
from ngbrain.surgery.observations import Observations
from ngbrain.surrogate.prediction.pretrained import ModelCard

READ = {
    "waves.npz": read_waves,
    "waves.h5": read_waves,
    "waves.nii": read_waves,
    "plate.toml": Scene.from_toml,
    "retraction.toml": Scene.from_toml,
    "retraction_force.csv": lambda path: Observations.read(None, path),
    "retraction_landmarks.csv": lambda path: Observations.read(path, None),
    "card.json": ModelCard.read,
    "run.vtkhdf": load,
    "scan.nii.gz": read_scan,
}
DEAR = ("waves.h5",)
"""Read in a process of their own first."""
FAST, EACH_SLOW = 30, 400
STATUS = (0, 2, 3)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return made(tmp_path_factory.mktemp("good"))


def refused_or_read(read, path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            read(path)
        except NgbrainError as error:
            assert "\n" not in str(error) and 0 < len(str(error)) < 3000
            return 1
    return 0


@pytest.mark.parametrize("name", READ)
def test_files_that_are_nearly_right(files, tmp_path, name):
    random = np.random.default_rng(list(name.encode()))
    count = 6 if name in DEAR else FAST
    assert refused_or_read(READ[name], files[name]) == 0
    refused = sum(refused_or_read(READ[name], changed(files[name], tmp_path, random)) for _ in range(count))
    assert refused > count // 4


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", READ)
def test_many_files_that_are_nearly_right(files, tmp_path, name, seed):
    random = np.random.default_rng([seed, *name.encode()])
    for _ in range(20 if name in DEAR else EACH_SLOW):
        refused_or_read(READ[name], changed(files[name], tmp_path, random))


VERBS = {
    "plate.toml": ("simulate",),
    "waves.npz": ("predict",),
    "waves.h5": ("predict",),
    "waves.nii": ("predict",),
    "retraction.toml": ("calibrate", "--force", "none.csv", "--force-sd", "1"),
    "scan.nii.gz": ("mesh", "--labels"),
}


def limited():
    resource.setrlimit(resource.RLIMIT_CPU, (40, 41))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def said(argv, folder):
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "NGBRAIN_CACHE": str(folder / "cache")}
    command = [sys.executable, "-m", "ngbrain", *map(str, argv)]
    return subprocess.run(
        command, capture_output=True, text=True, preexec_fn=limited, env=environment, errors="replace"
    )


def held(done, argv):
    """The contract of the command line."""
    assert done.returncode in STATUS, (argv, done.returncode, done.stderr[-2000:])
    assert "Traceback" not in done.stderr and "Exception ignored" not in done.stderr, (argv, done.stderr[-2000:])
    if done.returncode == 2:
        assert done.stderr.count("\n") == 1 and done.stderr.startswith("ngbrain"), (argv, done.stderr)


@pytest.mark.parametrize("number", range(6))
def test_commands_given_files_that_are_nearly_right(files, tmp_path, number):
    name = list(VERBS)[number]
    random = np.random.default_rng([7, number])
    verb, *options = VERBS[name]
    path = changed(files[name], tmp_path, random)
    if name == "plate.toml":
        path.write_bytes(path.read_bytes()[: len(path.read_bytes()) // 2])  # whole ones are solved for minutes
    output = tmp_path / ("out.vtkhdf" if verb == "mesh" else "out")
    argv = [verb, path, *options, "-o", output, "-q"]
    held(said(argv, tmp_path), argv)


ARGUMENTS = [
    ["simulate"], ["simulate", ""], ["simulate", "/dev/zero"], ["simulate", "a\udcffb.toml"], ["mesh", "/dev/null"], ["mesh", "."],
    ["invert", "/dev/zero"], ["predict", "x.mat"], ["simulate", "/proc/self/mem"], ["calibrate", "x"], ["materials", "\udcff"],
    ["data", "nothing"], ["data", "../../etc"], ["mesh", "x", "--names", "1"], ["mesh", "x", "--size", "1e999"],
    ["mesh", "x", "--site", "nan,0,0"], ["simulate", "x", "--threads", "1e8"], ["invert", "x", "--noise", "nan"],
    ["invert", "x", "--rounds", "-1"], ["invert", "x", "--oss-snr", "inf"], ["--no-such"], ["simulate", "x" * 5000],
    ["mesh", "x", "--names", "1=\udcff"], ["predict", "x.npz", "--weights", "/dev/null"],
]  # fmt: skip


@pytest.mark.parametrize("argv", ARGUMENTS, ids=range(len(ARGUMENTS)))
def test_arguments_that_mean_nothing(argv, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            status = main(argv)
        except SystemExit as ended:
            status = ended.code
    out, err = capsys.readouterr()
    assert status == 2 and err.count("\n") == 1 and err.startswith("ngbrain"), (status, out, err)
