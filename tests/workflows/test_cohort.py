"""A cohort: rows equal single commands, nothing is computed twice, and verdicts are independent of other rows."""

import csv
import json
import re
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np
import pytest

import ngbrain
from ngbrain.cli import main, perform
from ngbrain.cli.places import lock_folder
from ngbrain.datasets import SHIPPED
from ngbrain.errors import InputError, SolverError
from ngbrain.parallel import TaskLost
from ngbrain.workflows.cohort import cohort

ROOT = Path(__file__).parents[2]


def waves(path, **changed):
    """The shipped waves in the plane, with something changed."""
    with np.load(SHIPPED / "waves_plane.npz") as arrays:
        np.savez(path, **{**arrays, **changed})


@pytest.fixture
def study(tmp_path):
    """A folder with three sets of waves; a list of the first two."""
    for i, name in enumerate(("a", "b", "c")):
        waves(tmp_path / f"{name}.npz", noise=0.02 + 1e-4 * i)
    write(tmp_path, "a", "b")
    return tmp_path


def write(folder, *names, **files):
    rows = [f"{name},{files.get(name, name)}.npz,{i}" for i, name in enumerate(names)]
    (folder / "list.csv").write_text("\n".join(["name,input,age", *rows]) + "\n")


def done(folder, **how):
    return cohort(folder / "list.csv", folder / "out", "predict", **({"executor": None} | how))


def table(folder):
    with open(folder / "out" / "cohort.csv", newline="", encoding="utf-8") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


@pytest.fixture
def performed(monkeypatch):
    """The rows for which a verb was started; the stand-in writes a result immediately."""
    names = []

    def written(arguments):
        names.append(arguments.output.name)
        number = 1e3 * np.load(arguments.data)["noise"]
        result = {"verb": "predict", "answers": {"storage": {"median": float(number), "iqr": 1.0}}, "time_s": 1.0}
        (arguments.output / "result.json").write_text(json.dumps(result))
        return 0

    monkeypatch.setattr("ngbrain.workflows.rows.perform", written)
    return names


def bits(folder):
    """All results of a row without times and data of the run."""
    result = json.loads((folder / "result.json").read_text())
    del result["time_s"]
    with np.load(folder / "maps.npz") as maps:
        return result, {name: values.tobytes() for name, values in maps.items()}


def test_a_row_is_what_the_command_gives(study, capsys):
    found = done(study)
    assert [row.verdict for row in found.rows] == ["ok", "ok"] and found.usable
    assert main(["predict", str(study / "a.npz"), "-o", str(study / "by_hand"), "-q"]) == 0
    assert bits(study / "out" / "rows" / "a") == bits(study / "by_hand")
    assert (study / "out" / "rows" / "a" / "report.html").exists()
    result = json.loads((study / "out" / "result.json").read_text())
    assert {"verb", "versions", "seed", "threads", "time_s", "checks", "warnings", "answers"} <= set(result)
    storage = json.loads((study / "by_hand" / "result.json").read_text())["answers"]["storage"]["median"]
    assert result["answers"]["rows"]["a"]["numbers"]["storage_kPa_median"] == 1e-3 * storage
    row = table(study)["a"]
    assert float(row["storage_kPa_median"]) == 1e-3 * storage and row["verdict"] == "ok" and row["age"] == "0"
    assert repr(found) == f"Cohort: 2 ok; {study / 'out'}; converged; 2 rows; 2 computed now"
    with pytest.raises(InputError, match="storage_kPa_median"):
        found.values("stiffness")


def test_only_what_is_new_or_changed_is_done(study, performed):
    assert [row.computed for row in done(study).rows] == [True, True]
    assert [row.computed for row in done(study).rows] == [False, False] and performed == ["a", "b"]
    write(study, "c", "b", "a")
    assert [row.name for row in done(study).rows] == ["c", "b", "a"] and performed == ["a", "b", "c"]
    waves(study / "b.npz", noise=0.03)
    done(study)
    assert performed == ["a", "b", "c", "b"]
    write(study, "c", "a")
    found = done(study)
    assert found.left_out == ["b"] and set(table(study)) == {"a", "c"} and len(performed) == 4
    assert (study / "out" / "rows" / "b" / "result.json").exists()
    assert "still in the folder: b" in (study / "out" / "report.html").read_text()
    done(study, again=True)
    assert performed[4:] == ["c", "a"]


def test_rows_that_fail_or_are_refused_end_no_others(study, monkeypatch, capsys):
    performed = []

    def counted(arguments):
        performed.append(arguments.output.name)
        return perform(arguments)

    monkeypatch.setattr("ngbrain.workflows.rows.perform", counted)
    (study / "broken.npz").write_bytes(b"PK nothing")
    random = np.random.default_rng(0).standard_normal((2, 2, 961, 2))
    waves(study / "noise.npz", displacement=1e-6 * (random[0] + 1j * random[1]))
    write(study, "broken", "noise", "a")
    found = {row.name: row for row in done(study).rows}
    assert {name: row.verdict for name, row in found.items()} == {"broken": "failed", "noise": "excluded", "a": "ok"}
    assert found["broken"].reason.startswith(f"{study / 'broken.npz'}: data is damaged")
    assert found["noise"].reason.startswith("do not use")
    assert found["broken"].time_s is None and not found["broken"].numbers and found["noise"].numbers
    shown = table(study)
    assert shown["broken"]["storage_kPa_median"] == "" and shown["noise"]["reason"] == found["noise"].reason
    again = ["cohort", str(study / "list.csv"), "--verb", "predict", "-o", str(study / "out"), "-q"]
    assert main(again) == 3 and performed == ["broken", "noise", "a"]  # what fails by its input fails again
    said = capsys.readouterr()
    assert not said.out and [line.split(":")[1] for line in said.err.splitlines()] == [" broken", " noise"]
    page = (study / "out" / "report.html").read_text()
    assert "1 of 3 rows are usable; 1 excluded; 1 failed." in page
    assert "http" not in page and 'href="rows/a/report.html"' in page and "rows/broken/report" not in page


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RuntimeError("a bug"), MemoryError()])
def test_what_may_be_the_machines_fault_is_tried_again(study, performed, monkeypatch, error):
    def fail(_):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr("ngbrain.workflows.rows.perform", fail)
        assert {row.verdict for row in done(study).rows} == {"failed"}
    assert {row.verdict for row in done(study).rows} == {"ok"}


def test_a_solver_that_gives_up_is_not_asked_again(study, monkeypatch):
    asked = []

    def give_up(arguments):
        asked.append(arguments.output.name)
        raise SolverError("no convergence")

    monkeypatch.setattr("ngbrain.workflows.rows.perform", give_up)
    reasons = [row.reason for _ in range(2) for row in done(study).rows]
    assert asked == ["a", "b"] and all(reason.startswith("no convergence") for reason in reasons)


class Losing(Executor):
    """An executor that loses one row's process and computes the others in this one."""

    def __init__(self):
        self.asked = []

    def submit(self, fn, /, name, *args):
        self.asked.append(name)
        future = Future()
        if name == "a":
            future.set_exception(TaskLost("a: its process died (signal 9)"))
        else:
            future.set_result(fn(name, *args))
        return future


def test_a_row_whose_process_dies(study, performed):
    executor = Losing()
    found = {row.name: row for row in done(study, executor=executor).rows}
    assert executor.asked.count("a") == 2 and found["a"].verdict == "failed" and "signal 9" in found["a"].reason
    assert found["b"].verdict == "ok"
    assert {row.verdict for row in done(study).rows} == {"ok"} and performed == ["b", "a"]


def test_folders_of_others(study, tmp_path):
    (study / "out").mkdir()
    (study / "out" / "result.json").write_text('{"verb": "invert"}')
    with pytest.raises(InputError, match="results that are not of a cohort"):
        done(study)
    (study / "out" / "result.json").unlink()
    with lock_folder(study / "out"), pytest.raises(InputError, match="another ngbrain command is running"):
        done(study)
    with pytest.raises(InputError, match="group is 'centre'"):
        done(study, group="centre")
    assert not (study / "out" / "rows").exists()
    (study / "out" / "rows" / "a").mkdir(parents=True)
    (study / "out" / "rows" / "a" / "scan.nii").touch()  # somebody's own
    with pytest.raises(InputError, match="rows is not of a cohort"):
        done(study)
    assert (study / "out" / "rows" / "a" / "scan.nii").exists()


def test_a_row_without_its_result_is_computed_again(study, performed):
    done(study)
    (study / "out" / "rows" / "b" / "result.json").unlink()
    assert done(study).usable and performed == ["a", "b", "b"]


def cohort_process(study):
    command = [sys.executable, "-m", "ngbrain", "cohort", str(study / "list.csv"), "--verb", "predict"]
    return subprocess.Popen(
        [*command, "-o", str(study / "out")], cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def record(study, name):
    path = study / "out" / "rows" / name / "row.json"
    return json.loads(path.read_text()) if path.exists() else {"outcome": "", "runs": 0}


@pytest.mark.slow
def test_killed_in_the_middle_it_goes_on_without_doing_anything_twice(study):
    write(study, "a", "b", "c")
    with cohort_process(study) as process:
        until = time.monotonic() + 120
        while not (record(study, "a")["outcome"] and record(study, "b")["runs"]):
            assert process.poll() is None and time.monotonic() < until
            time.sleep(0.005)
        process.kill()
    begun = (study / "out" / "rows" / "a" / "result.json").stat().st_mtime_ns
    assert not (study / "out" / "cohort.csv").exists()
    time.sleep(1.0)  # its worker hears that it is alone
    with cohort_process(study) as process:
        said, warned = process.communicate(timeout=120)
    assert process.returncode == 0 and not warned, warned
    finished = int(re.search(r"3 rows: 3 ok; (\d) were finished before", said)[1])
    assert finished >= 1 and begun == (study / "out" / "rows" / "a" / "result.json").stat().st_mtime_ns
    runs = [record(study, name)["runs"] for name in "abc"]
    assert runs[0] == 1 and sum(runs) <= 4
    straight = cohort(study / "list.csv", study / "straight", "predict", executor=None)
    for row in straight.rows:
        assert bits(row.folder) == bits(study / "out" / "rows" / row.name), row.name


def test_statistics_by_group_and_outliers(study, performed):
    values = [30, 31, 29, 30.5, 28, 33, 32, 90, 60, 61, 59, 60.5, 58, 63, 62]
    rows = []
    for i, value in enumerate(values):
        waves(study / f"p{i}.npz", noise=float(value))
        rows.append(f"p{i},p{i}.npz,{'old' if value > 50 and value != 90 else 'young'}")
    (study / "list.csv").write_text("\n".join(["name,input,group", *rows]) + "\n")
    found = done(study)
    assert {row.name: row.verdict for row in found.rows if row.verdict != "ok"} == {"p7": "warning"}
    assert found.usable and "Storage modulus, median 90 kPa is" in found.rows[7].reason
    assert "above the median" in found.rows[7].reason and "(limit " in found.rows[7].reason
    spreads = {spread.group: spread for spread in found.spreads if spread.key == "storage_kPa_median"}
    assert spreads["old"].n == 7 and spreads["old"].median == 60.5 and spreads["young"].n == 8
    page = (study / "out" / "report.html").read_text()
    assert "15 of 15 rows are usable, 1 of them with a warning." in page and page.count(">p7</span>") == 2
    assert "half of the rows have the same value" in page
    assert ngbrain.cohort is cohort
