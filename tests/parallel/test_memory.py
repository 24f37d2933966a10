"""Memory foretold: the table is the one that was fitted to what is measured, and holds where a task takes 1 GiB or more."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from ngbrain import parallel
from ngbrain.errors import InputError
from ngbrain.parallel import memory

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
RECORDS = json.loads((BENCHMARKS / "memory.json").read_text())


def written(script, option, records, place, tmp_path):
    """What a script writes from the records, to a place of this test's."""
    code = f"import pathlib, sys, json; sys.argv = ['x']; import {script} as s; " + option
    done = subprocess.run(
        [sys.executable, "-c", code], input=records, capture_output=True, text=True, cwd=BENCHMARKS, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_table_is_that_of_the_records(tmp_path):
    code = "print(json.dumps(s.table(json.load(sys.stdin))))"
    made = json.loads(written("memory", code, json.dumps(RECORDS), memory._TABLE, tmp_path))
    assert made == parallel.memory_table()


def test_the_page_is_that_of_the_records(tmp_path):
    code = "import _cluster_page as p; m = json.loads(pathlib.Path('memory.json').read_text()); "
    code += "sys.stdout.write(p.page(json.load(sys.stdin), m))"
    made = written("throughput", code, (BENCHMARKS / "throughput.json").read_text(), None, tmp_path)
    assert made == (BENCHMARKS / "results" / "cluster.md").read_text()


@pytest.mark.parametrize("record", [r for r in RECORDS if r["peak_gib"] >= 1], ids=lambda r: f"{r['kind']} {r['n']}")
def test_what_takes_a_gibibyte_is_foretold_within_a_quarter(record):
    foretold = parallel.predicted_memory(record["kind"], record["n"], record.get("frequencies", 1)) / 2**30
    assert foretold == pytest.approx(record["peak_gib"], rel=0.25)


def test_larger_takes_more_and_no_other_kind_is_known():
    for kind, of in parallel.memory_table().items():
        n = of["measured"][1]
        assert parallel.predicted_memory(kind, 2 * n) >= parallel.predicted_memory(kind, n) > 2**27
    assert parallel.predicted_memory("zone", 343, 2) > 1.4 * parallel.predicted_memory("zone", 343)
    with pytest.raises(InputError, match=r"^kind of work is 'zones'; wanted: did you mean 'zone'"):
        parallel.predicted_memory("zones", 1)
