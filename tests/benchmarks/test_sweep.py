"""Independent cases of a benchmark: the same records whoever computes them."""

import json
import os
import subprocess
import sys
from pathlib import Path

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SCRIPT = """
import os
import numpy as np
from _command import main, sweep

def case(seed, scale):
    return {"seed": seed, "value": scale(np.random.default_rng(seed).random(999)).sum(), "here": os.getpid() == PARENT}

def measure(quick, executor=None):
    seen = []
    found = sweep(case, {f"seed {seed}": (seed, np.sqrt) for seed in range(3)}, executor, seen.append)
    assert sorted(each["seed"] for each in seen) == [0, 1, 2]
    plain = {f"seed {seed}": (seed, lambda x: np.sqrt(x)) for seed in range(3)}  # which cannot be sent
    return found + sweep(case, plain)

PARENT = int(os.environ.setdefault("PARENT", str(os.getpid())))
if __name__ == "__main__":
    main("Test.", measure, None, None)
"""


def test_cases_in_other_processes(tmp_path):
    script = tmp_path / "little.py"
    script.write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, str(script), "--json", "--executor", "2"],
        env=os.environ | {"PYTHONPATH": str(BENCHMARKS), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    there, here = (records := json.loads(done.stdout.strip().splitlines()[-1]))[:3], records[3:]
    assert not any(record["here"] for record in there) and all(record["here"] for record in here)
    assert [(r["seed"], r["value"]) for r in there] == [(r["seed"], r["value"]) for r in here]
