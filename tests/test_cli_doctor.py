"""The verb `doctor`: what is missing, broken or slow is said with what helps, also where the core does not work."""

import configparser
import subprocess
import sys
from pathlib import Path

import pytest

from ngbrain import threads
from ngbrain.cli import main
from ngbrain.io import show_versions
from ngbrain.io.versions import FOR_DEVELOPERS, is_older, requirements
from ngbrain.workflows import doctor
from ngbrain.workflows.doctor import BROKEN, OK, OPTIONAL, SLOW, Finding, diagnose


def findings(**options):
    return {finding.name: finding for finding in diagnose(**{"timing": False, **options})}


def test_what_is_here_is_found_and_works(capsys):
    assert main(["doctor", "--no-timing"]) == 0
    said = capsys.readouterr().out
    show_versions()
    for line in capsys.readouterr().out.splitlines():
        name, value = line.split(maxsplit=1)
        if name != "cores":
            assert value in said, line
    assert "\nworks\n" in said and "\nspeed\n" not in said


def test_the_requirements_are_those_of_setup_cfg(monkeypatch):
    config = configparser.ConfigParser()
    config.read(Path(__file__).parents[1] / "setup.cfg")
    lines = config["options"]["install_requires"].split()
    for extra, of in config["options.extras_require"].items():
        lines += [f'{line}; extra == "{extra}"' for line in of.split("\n") if line]
    monkeypatch.setattr(sys.modules["ngbrain.io.versions"], "requires", lambda _: lines)  # as installing writes them
    assert set(requirements()) - {""} == set(config["options.extras_require"])
    for package, least in requirements()[""].items():
        assert f"{package}>={least}" in config["options"]["install_requires"]
    assert requirements()["dev"]["ruff"] == "0.17" and {"matplotlib", "nibabel", "tqdm"} <= set(requirements()["demo"])
    assert set(doctor.PURPOSES) == set(requirements()) - {"", *FOR_DEVELOPERS}


def test_a_missing_extra_has_the_line_that_gets_it(monkeypatch):
    real = doctor.find_version
    monkeypatch.setattr(doctor, "find_version", lambda name: None if name == "nilearn" else real(name))
    found = findings()["mri"]
    assert found.state == OPTIONAL and "nilearn missing" in found.value
    assert found.advice.startswith('pip install "ngbrain[mri]" ')


def test_an_old_package_of_the_core_is_broken(monkeypatch, capsys):
    real = doctor.find_version
    monkeypatch.setattr(doctor, "find_version", lambda name: "1.9.2" if name == "numpy" else real(name))
    found = findings()["numpy"]
    assert found.state == BROKEN and found.value == "1.9.2, older than 2.0" and '"numpy>=2.0"' in found.advice
    assert main(["doctor", "--no-timing"]) == 3 and "does not work (x): numpy" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("one", "other", "older"), [("2.10", "2.9", False), ("2.9", "2.10", True), ("2.0", "2.0", False), ("7", "", False)]
)
def test_versions_are_compared_by_numbers(one, other, older):
    assert is_older(one, other) is older


def test_it_speaks_where_ngsolve_cannot_be_imported(tmp_path):
    """As on a system without libquadmath, which is the first thing that many meet."""
    (tmp_path / "ngsolve.py").write_text("raise ImportError('libquadmath.so.0: cannot open shared object file')\n")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from ngbrain.cli import main; sys.exit(main(['doctor']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 3 and not done.stderr
    assert "apt install libquadmath0" in done.stdout and "does not work (x): ngsolve" in done.stdout
    assert "writing to the cache" in done.stdout and "\nspeed\n" not in done.stdout


def test_the_factorisation_is_measured():
    found = doctor._solver()
    assert "14739 unknowns" in found.value and found.value.endswith("one thread")
    clock, used = numbers(found.value)
    assert 0 < used <= clock + 0.2


def numbers(text):
    words = text.replace(",", "").split()
    return [float(words[i - 1]) for i, word in enumerate(words) if word == "s"][:2]


def test_a_processor_that_others_use_is_noticed(monkeypatch):
    clock, used = iter([0.0, 10.0]), iter([0.0, 1.0])
    monkeypatch.setattr(doctor.time, "perf_counter", lambda: next(clock))
    monkeypatch.setattr(doctor.time, "process_time", lambda: next(used))
    found = doctor._solver()
    assert found.state == SLOW and "10.0 s, 1.0 s of them" in found.value and "other programs" in found.advice


def test_a_slow_or_forbidden_cache_is_said(monkeypatch, tmp_path):
    monkeypatch.setenv("NGBRAIN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(doctor, "_write_rate", lambda _: 3.0)
    found = {each.name: each for each in doctor._cache(True)}
    assert found["writing to the cache"].state == SLOW and "3 MB/s" in found["writing to the cache"].value
    assert str(tmp_path / "cache") in found["cache"].value and "0 files" in found["cache"].value

    def refuse(_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(doctor, "_write_rate", refuse)
    found = {each.name: each for each in doctor._cache(True)}
    assert "NGBRAIN_CACHE" in found["writing to the cache"].advice and not (tmp_path / "cache").exists()


def test_threads_of_openblas_are_those_that_were_set():
    threads.set_threads(1)
    assert set(threads.openblas_threads().values()) <= {1}


def test_little_memory_is_said(monkeypatch):
    monkeypatch.setattr(doctor, "LEAST_MEMORY", 1e18)
    assert findings()["memory"].state == SLOW and "--threads 1" in findings()["memory"].advice


def test_findings_are_whole():
    for finding in diagnose(timing=False):
        assert isinstance(finding, Finding) and finding.topic and finding.name and finding.value
        assert finding.advice or finding.state in (OK,)
