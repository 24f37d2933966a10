"""Output that cannot be written: a full disk, a forbidden place, a pipe nobody reads, closed streams, two commands at once."""

import errno
import fcntl
import json
import os
import resource
import subprocess
import sys

import h5py
import numpy as np
import pytest

from ngbrain.atomic import atomic_write
from ngbrain.cli import main, places
from ngbrain.io import Frame, QuadraticGrid, save, write_json
from ngbrain.io.exchange import SUFFIXES, write_mesh
from ngbrain.io.state import save_state
from ngbrain.mesh import block
from ngbrain.mesh.tet_mesh import Elements, Surface
from ngbrain.report.pages.parameters import PARAMETERS

COMMAND = [sys.executable, "-m", "ngbrain"]
BODY = """
[geometry]
kind = "block"
size_mm = [20, 20, 20]
[mesh]
max_size_mm = 20
[[tissue]]
mu_Pa = 1000
poissons_ratio = 0.3
[[displacement_bc]]
boundary = "bottom"
[[displacement_bc]]
boundary = "top"
value_mm = [0, 0, -0.1]
[[quantity]]
name = "force"
boundary = "top"
tolerance = 0.3
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "body.toml"
    path.write_text(BODY)
    return path


def shell(line, **more):
    return subprocess.run(["bash", "-c", line], capture_output=True, text=True, **more)


PYTHON = f"{sys.executable} -m ngbrain"


def test_a_pipe_that_is_not_read_on_is_no_fault():
    done = shell(f"set -o pipefail; {PYTHON} materials | head -1")
    assert (done.returncode, done.stderr) == (0, "") and len(done.stdout.splitlines()) == 1


@pytest.mark.slow
def test_work_goes_on_when_nobody_reads(scene, tmp_path):
    done = shell(f"set -o pipefail; {PYTHON} simulate {scene} --as-described -q -o {tmp_path / 'out'} | true")
    assert (done.returncode, done.stderr) == (0, "")
    assert "answers" in json.loads((tmp_path / "out" / "result.json").read_text())


def test_a_full_standard_output_is_one_line():
    done = shell(f"{PYTHON} materials > /dev/full")
    assert done.returncode == 2 and done.stderr == "ngbrain: standard output: No space left on device\n"


@pytest.mark.parametrize(
    "closed", [*(pytest.param(each, marks=pytest.mark.slow) for each in ("2>&-", ">&- 2>&-")), "<&- >&- 2>&-"]
)
def test_closed_streams_hurt_nobody(scene, tmp_path, closed):
    out = tmp_path / "out"
    assert shell(f"{PYTHON} simulate {scene} --as-described -o {out} {closed}").returncode == 0
    json.loads((out / "result.json").read_text())
    assert shell(f"{PYTHON} simulate {scene}x -o {out} {closed}").returncode == 2


def test_bad_options_are_one_line(capsys):
    for argv in (
        ["mesh"],
        ["mesh", "x.nii", "--size", "much"],
        ["simulate", "x", "--threads", "1e8"],
        ["opera"],
        ["-x"],
    ):
        with pytest.raises(SystemExit) as ended:
            main(argv)
        out, err = capsys.readouterr()
        assert ended.value.code == 2 and out == "" and err.count("\n") == 1 and err.startswith("ngbrain"), argv


@pytest.mark.parametrize("text", ["nan", "inf", "1e8", "0", "-1", "100000000", ""])
def test_threads_are_a_number_that_can_be(text, capsys):
    with pytest.raises(SystemExit):
        main(["simulate", "x.toml", f"--threads={text}"])
    assert "from 1 to 1024" in capsys.readouterr().err


# --- places -----------------------------------------------------------------------------------------------------------


def refused(capsys, *argv):
    assert main(list(map(str, argv))) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


def test_results_are_not_replaced_unasked(scene, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    (out / "result.json").write_text("{}")
    assert "results are already" in refused(capsys, "simulate", scene, "-o", out)
    assert (out / "result.json").read_text() == "{}"
    assert main(["simulate", str(scene), "--as-described", "-o", str(out), "--overwrite", "-q"]) == 0
    capsys.readouterr()  # it may doubt its answer
    assert (out / "result.json").read_text() != "{}"
    for verb in ("mesh", "invert", "predict"):
        said = refused(capsys, verb, tmp_path / "none.npz", "-o", out)
        assert "--overwrite" in said and "--resume" not in said
    assert "results are already" in refused(capsys, "mesh", tmp_path / "none.npz", "-o", out / "other.msh")
    for verb in ("simulate", "calibrate", "twin"):
        said = refused(capsys, verb, tmp_path / "none.toml", "-o", out)
        assert "--overwrite" in said and "--resume" in said


@pytest.mark.parametrize(
    ("verb", "name"),
    [
        ("simulate", "report.html"), ("simulate", "continuous.vtkhdf"), ("simulate", "my own_series.csv"),
        ("simulate", "scene.glb"),
        ("mesh", "head.vtkhdf"), ("mesh", "head_labels.nii.gz"),
        ("invert", "maps.npz"), ("predict", "storage.nii.gz"), ("invert", "loss_low.nii.gz"), ("calibrate", "scene.toml"),
        ("calibrate", "factors.json"), ("twin", "work"),
    ],
)  # fmt: skip
def test_neither_an_unfinished_run_nor_a_file_of_the_users_own_is_replaced_unasked(verb, name, tmp_path, capsys):
    """Without a result.json too: a run that was stopped left steps, and a scene lies where its calibrated copy would go."""
    (tmp_path / name).write_text("mine")
    said = refused(capsys, verb, tmp_path / "none", "-o", tmp_path)
    assert f"a file is already that results would replace ({tmp_path / name})" in said and "--overwrite" in said
    assert (tmp_path / name).read_text() == "mine"
    assert main([verb, str(tmp_path / "none"), "-o", str(tmp_path), "--overwrite"]) == 2
    assert "is already" not in capsys.readouterr().err  # it went on to the input


def test_names_of_maps_are_those_of_the_library():
    assert set(places.MAPS) == set(PARAMETERS)


def test_a_mesh_goes_to_a_folder_like_all_results(tmp_path):
    assert places.mesh_file(tmp_path / "new") == tmp_path / "new/head.vtkhdf"
    (tmp_path / "study.v2").mkdir()
    assert places.mesh_file(tmp_path / "study.v2") == tmp_path / "study.v2/head.vtkhdf"
    assert places.mesh_file(tmp_path / "a.vol.gz") == tmp_path / "a.vol.gz"


def test_a_place_that_cannot_be_written_to_is_noticed_first(tmp_path, capsys):
    """The output is checked before the input."""
    (tmp_path / "file").write_text("")
    for verb in ("simulate", "invert", "predict", "calibrate"):
        for place in (tmp_path / "file" / "below", "/proc/self/fd/none", "/sys/none"):
            said = refused(capsys, verb, tmp_path / "none", "-o", place)
            assert "nothing can be written" in said, (verb, place)
    assert "nothing can be written" in refused(capsys, "mesh", tmp_path / "none", "-o", "/proc/none/head.vtkhdf")


def test_a_folder_that_nothing_came_to_is_gone(tmp_path, capsys):
    assert "missing" in refused(capsys, "simulate", tmp_path / "none.toml", "-o", tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []


def test_one_command_at_a_time(scene, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    number = os.open(out, os.O_RDONLY)
    fcntl.flock(number, fcntl.LOCK_EX)
    assert "another ngbrain command is running" in refused(capsys, "simulate", scene, "-o", out)
    os.close(number)
    assert main(["simulate", str(scene), "--as-described", "-o", str(out), "-q"]) == 0


# --- a full disk ------------------------------------------------------------------------------------------------------


def tetrahedra():
    corners = np.array(list(np.ndindex(2, 2, 2)), float) * 0.1
    sides = [(0, 2, 6, 4), (1, 5, 7, 3), (0, 4, 5, 1), (2, 3, 7, 6), (0, 1, 3, 2), (4, 6, 7, 5)]
    triangles = np.array([part for a, b, c, d in sides for part in ((a, b, c), (a, c, d))])
    return Elements.enclosed(corners, [Surface("skin", triangles, 0)], ("tissue",), 0.04)


def limited(code, tmp_path, size):
    """A Python process with a limit on the size of its files, as on a full disk."""

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    begin = "import sys; sys.path.insert(0, sys.argv[2]); from test_cli_streams import *; folder = sys.argv[1]\n"
    here = os.path.dirname(__file__)
    command = [sys.executable, "-c", begin + code, str(tmp_path), here]
    return subprocess.run(command, capture_output=True, text=True, preexec_fn=limit)


WRITERS = {
    "checkpoint": "save(folder + '/run.vtkhdf', QuadraticGrid(block((.1, .1, .1), .02)))",
    "json": "from pathlib import Path; write_json(Path(folder) / 'a.json', list(range(20000)))",
    "state": "save_state(folder + '/a.npz', {'u': np.zeros(20000)})",
    "nifti": "from ngbrain.image.read.nifti import write_nifti; from ngbrain.image.read.volume import Volume; "
    "write_nifti(folder + '/a.nii', Volume(np.zeros((40, 40, 40)), np.eye(4)))",
    "waves": "from ngbrain.io.waves import *; from ngbrain.datasets import SHIPPED; data = read_waves(SHIPPED / 'ultrasound.npz'); "
    "write_waves(folder + '/a.h5', data)",
} | {suffix: f"write_mesh(folder + '/a{suffix}', tetrahedra())" for suffix in SUFFIXES}


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_an_error_that_leaves_nothing(tmp_path, name):
    code = f"try:\n    {WRITERS[name]}\nexcept OSError as error:\n    print(error.errno)\nelse:\n    print('whole')"
    done = limited(code, tmp_path, 400)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, str(errno.EFBIG), "")
    assert os.listdir(tmp_path) == []
    assert limited(code, tmp_path, 2**30).stdout.strip() == "whole" and len(os.listdir(tmp_path)) == 1


def test_a_full_disk_is_one_line_of_the_command(scene, tmp_path):
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (400, 400))

    command = [*COMMAND, "simulate", str(scene), "--as-described", "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=limit)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "File too large" in done.stderr
    assert not (tmp_path / "out").exists() or os.listdir(tmp_path / "out") == []


def test_processes_that_write_the_same_file_do_not_disturb_one_another(tmp_path):
    lines = ["import sys", "from pathlib import Path", "from ngbrain.io import write_json", "for i in range(100):"]
    code = "\n".join([*lines, "    write_json(Path(sys.argv[1]) / 'result.json', list(range(300)))"])
    running = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path)]) for _ in range(3)]
    assert [run.wait() for run in running] == [0, 0, 0]
    assert os.listdir(tmp_path) == ["result.json"] and len(json.loads((tmp_path / "result.json").read_text())) == 300


def test_what_a_killed_process_left_is_cleared_away_and_no_other(tmp_path):
    dead, alive = (tmp_path / f".a.{number}.00ff.tmp.json" for number in (2**22 + 1, os.getppid()))
    for path in (dead, alive, tmp_path / ".ab.4194305.00ff.tmp.json", tmp_path / ".a.note.json"):
        path.write_text("half")
    atomic_write(tmp_path / "a.json", lambda part: part.write_text("{}"))
    assert sorted(os.listdir(tmp_path)) == sorted([".a.note.json", ".ab.4194305.00ff.tmp.json", "a.json", alive.name])


__all__ = [
    "Frame",
    "QuadraticGrid",
    "block",
    "h5py",
    "np",
    "save",
    "save_state",
    "tetrahedra",
    "write_json",
    "write_mesh",
]
