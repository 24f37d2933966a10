"""What is said of two versions: numbers of benchmarks that differ, what took longer, numbers of tests that changed."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / ".ci"))
compare_tests, compare_versions = map(import_module, ("compare_tests", "compare_versions"))


def runs(*records, cpu=1.0):
    """Of one version: a list of records for each run."""
    return [compare_versions.Run(each, cpu, 100.0) for each in records]


def record(n, **of):
    return {"method": "P2", "n": n, "cpu_s": 1.0, "run": {"commit": 1}} | of


def test_an_answer_that_differs_is_found_and_a_measurement_is_not():
    """What varies from run to run of a version is no answer; nor is a time, even one that happens not to vary."""
    old = runs(
        [record(1, force=2.0, wall=3.0), record(2, force=4.0)], [record(1, force=2.0, wall=3.1), record(2, force=4.0)]
    )
    new = runs([record(1, force=2.0, wall=5.0), record(2, force=5.0, cpu_s=9.0)]) * 2
    total, found = compare_versions.differences("press", old, new, [("press: f*", "a finer mesh")])
    assert total == 4  # two numbers n and two forces
    (one,) = found
    assert (one.record, one.name, one.old, one.new, one.reason) == ("n 2", "force", 4.0, 5.0, "a finer mesh")
    assert one.change == pytest.approx(0.2)


def test_times_are_the_least_of_all_runs():
    old = runs([record(1, cpu_s=2.0)], cpu=3.0) + runs([record(1, cpu_s=1.0)], cpu=2.0)
    new = runs([record(1, cpu_s=1.5)], cpu=4.0) + runs([record(1, cpu_s=1.2)], cpu=5.0)
    whole, one = compare_versions.costs("press", old, new)
    assert (whole.ratio, one.ratio, one.spread) == (2.0, 1.2, 1.0)


def test_numbers_of_tests_that_changed(tmp_path):
    """A moved function is none; one that is gone, one with another tolerance, and one with one number more are."""

    def git(*arguments):
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *arguments], cwd=tmp_path, check=True)

    def commit(subject, **files):
        for name, text in files.items():
            (tmp_path / "tests" / "forward" / f"{name}.py").write_text(text)
        git("add", "-A")
        git("commit", "-qm", subject)

    (tmp_path / "tests" / "forward").mkdir(parents=True)
    git("init", "-q")
    kept = "def test_kept():\n    assert 1 < 2\n"
    commit(
        "first",
        test_a=f"SIZE = 3\n{kept}def test_near():\n    assert 1e-3 > -2\n",
        test_b="def test_gone():\n    assert 7\n",
    )
    commit("bound", test_a="SIZE = 3\ndef test_near():\n    assert 1e-2 > -2\n", test_c=kept)
    (tmp_path / "tests" / "forward" / "test_b.py").unlink()
    commit("other", test_a="SIZE = 4\ndef test_near():\n    assert 1e-2 > -2\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        found = {c.name: (c.before, c.after, c.commits) for c in compare_tests.changes("HEAD~2", "HEAD")}
    assert found == {
        compare_tests.MODULE: ((3.0,), (4.0,), ("other",)),
        "test_near": ((0.001,), (0.01,), ("bound",)),
        "test_gone": ((7.0,), None, ("other",)),
    }
