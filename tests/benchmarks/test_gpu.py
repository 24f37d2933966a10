"""What is packed for a machine with a GPU arrives whole, and a run that is cut keeps what it has."""

import json
import sys
import zipfile
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def gpu(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import gpu

    yield gpu
    for name in ("gpu", "_gpu_pack"):
        sys.modules.pop(name, None)


@pytest.fixture
def packing(gpu):
    import _gpu_pack

    return _gpu_pack


def wheel(path, files):
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def test_parts_hold_no_more_than_they_may_and_unpack_to_the_same_files(packing, tmp_path, rng):
    big, small = rng.bytes(2300), rng.bytes(100)
    wheels = tmp_path / "wheels"
    wheels.mkdir()
    source = wheel(wheels / "one-1.whl", {"one/libfirst.so.1": big, "one/unused.so": rng.bytes(9000)})
    archives = [
        packing.reduced(source, "libfirst", wheels),
        wheel(wheels / "two-1.whl", {"two/__init__.py": small}),
    ]
    parts = packing.lay_out(archives, tmp_path, 1000)
    assert len(parts) > 2 and all(sum(f.stat().st_size for f in part.iterdir()) <= 1000 for part in parts)
    site = tmp_path / "site"
    pieces = [part for part in parts if any("xz." in file.name for file in part.iterdir())]
    for part in pieces[:-1]:
        assert "one.tar.xz" not in packing.unpack([part], site)  # its pieces wait for the last one
    assert not (site / "one").exists()
    assert "one.tar.xz" in packing.unpack([pieces[-1]], site)
    packing.unpack(parts, site)
    assert (site / "two/__init__.py").read_bytes() == small
    assert (site / "one/libfirst.so.1").read_bytes() == big
    assert not (site / "one/unused.so").exists()


def test_versions_that_a_wheel_fixes(packing, tmp_path):
    metadata = (
        "Name: a\nRequires-Dist: netgen-occt==7.8.1\nRequires-Dist: numpy\nRequires-Dist: pytest; extra == 'test'\n"
    )
    found = dict(packing.requirements(wheel(tmp_path / "a.whl", {"a-1.dist-info/METADATA": metadata})))
    assert found == {"netgen-occt": "7.8.1"}


SCRIPT = """
import json, os, sys, time
listed = sys.argv[sys.argv.index("--skip") + 1:]
skip, slow = listed[:listed.index("--too-slow")], listed[listed.index("--too-slow") + 1:]
common = {"problem": sys.argv[1], "n": int(sys.argv[2]), "order": 1, "ndof": 5, "device": "host"}
for method in ("good", "hangs", "crashes", "missing", "last"):
    if method in skip:
        continue
    record = common | {"method": method, "last": method == "last"}
    print("CUDA Device Query...")
    print(json.dumps(record | {"begun": True}), flush=True)
    if method == "hangs" and method not in slow:
        time.sleep(60)
    if method == "crashes":
        print("out of memory", file=sys.stderr)
        os.abort()
    print(json.dumps(record | {"error": 0.0, "reason": "", "converged": True, "missing": method == "missing"}), flush=True)
"""


def test_methods_that_hang_or_crash_are_recorded_and_the_others_run(gpu, tmp_path, monkeypatch):
    (tmp_path / "_gpu_cells.py").write_text(SCRIPT)
    monkeypatch.setattr(gpu, "HERE", tmp_path)
    file = tmp_path / "records" / "gpu.json"
    kept = gpu.Measurements(file)
    jobs = [("waves", 3, 0.5)]
    assert gpu.measure(jobs, kept, tmp_path / "site", 60) == []
    found = {r["method"]: r["reason"] for r in json.loads(file.read_text())}
    assert found == {"good": "", "hangs": "more than 0.5 s", "crashes": "out of memory", "missing": "", "last": ""}
    again = gpu.Measurements(file)
    assert sorted(again.done(jobs[0])) == ["crashes", "good", "hangs", "last"]  # what was missing runs again
    assert not again.complete(jobs[0])
    assert gpu.measure(jobs, again, tmp_path / "site", -1) == ["waves 3"]  # no time is left
    (tmp_path / "_gpu_cells.py").write_text(SCRIPT.replace('"missing": method == "missing"', '"missing": False'))
    gpu.measure(jobs, again, tmp_path / "site", 60)
    assert again.complete(jobs[0])
    (tmp_path / "_gpu_cells.py").write_text("raise SystemExit('a problem that is complete is not set up again')")
    assert gpu.measure(jobs, again, tmp_path / "site", 60) == []
    assert all(r["method"] != gpu.SET_UP for r in again.records)


def test_what_took_too_long_is_not_tried_with_more_unknowns(gpu, tmp_path, monkeypatch):
    (tmp_path / "_gpu_cells.py").write_text(
        SCRIPT.replace('("good", "hangs", "crashes", "missing", "last")', '("hangs",)')
    )
    monkeypatch.setattr(gpu, "HERE", tmp_path)
    kept = gpu.Measurements(tmp_path / "gpu.json")
    gpu.measure([("waves", 3, 0.5), ("waves", 4, 20.0), ("mixed", 4, 0.5)], kept, tmp_path / "site", 60)
    found = {(r["problem"], r["n"]): r["converged"] for r in kept.records}
    assert found == {("waves", 3): False, ("waves", 4): True, ("mixed", 4): False}


def test_cells_record_what_is_too_slow_without_running_it(gpu, capsys, monkeypatch):
    import _gpu_cells

    monkeypatch.setattr(
        _gpu_cells, "cells", lambda *_: ({"ndof": 5}, {"slow": lambda: 1 / 0, "last": lambda: {"error": 0.0}})
    )
    monkeypatch.setattr(sys, "argv", ["_gpu_cells.py", "waves", "4", "--skip", "--too-slow", "slow"])
    _gpu_cells.main()
    slow, last = (r for line in capsys.readouterr().out.splitlines() if not (r := json.loads(line)).get("begun"))
    assert slow["reason"] == _gpu_cells.TOO_SLOW and slow["ndof"] == 5 and last["converged"]
    kept = gpu.Measurements(Path("none.json"))
    kept.records = [slow]
    assert kept.too_slow(("waves", 9, 20.0)) == ["slow"] and kept.too_slow(("waves", 4, 20.0)) == []


def test_the_choice_of_a_device_rests_on_what_was_measured(gpu):
    from ngbrain.solvers.device import CROSSING

    assert gpu.crossing(json.loads((BENCHMARKS / "gpu.json").read_text())) == CROSSING


def test_crossing_of_two_powers(gpu):
    def waves(method, n, seconds):
        common = {"problem": "waves", "n": n, "ndof": 2 * n, "converged": True, "setup_s": 0.0}
        return common | {"method": method, "solve_s": seconds}

    sizes = (1000, 4000, 16000)
    records = [waves("cudss, device", n, n / 1000) for n in sizes]
    records += [waves("direct, processor, threads 1", n, (n / 1000) ** 2 / 2.5) for n in sizes]
    assert gpu.crossing(records) == 2500
