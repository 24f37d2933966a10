"""Every benchmark runs in its quick form, and its last line is a list of records with what all of them have."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
ON_FILES = {"heads_of_strangers.py", "living_slice.py"}  # run over files of other people
SCRIPTS = sorted(path.name for path in BENCHMARKS.glob("[!_]*.py") if path.name not in ON_FILES)
NEEDS = {"surrogate_training.py": "torch"}
KEYS = {"method", "order", "ndof", "error", "cpu_s", "converged"}


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS)
def test_quick_form(script):
    if script in NEEDS:
        pytest.importorskip(NEEDS[script])
    done = subprocess.run(
        [sys.executable, script, "--quick", "--json"],
        cwd=BENCHMARKS,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    records = json.loads(done.stdout.strip().splitlines()[-1])
    assert records
    for record in records:
        assert set(record) >= KEYS | {"run"}, set(KEYS) - set(record)
