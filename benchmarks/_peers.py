"""Solvers on the statics benchmarks' cases, ngbrain among them: each runs in a process and an environment of its own.

`make bench-peers` makes the environments under out/peers (variable PEERS: elsewhere); ours and plain NGSolve need none.

    python benchmarks/_peers.py dolfinx smooth 4 P2/P1      one record
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SCRIPTS = {
    "ngbrain": "ngbrain_case.py",
    "ngsolve": "ngsolve_plain.py",
    "dolfinx": "dolfinx_peer.py",
    "felupe": "felupe_peer.py",
    "skfem": "skfem_peer.py",
}
LABELS = {
    "ngbrain": "ngbrain:",
    "ngsolve": "NGSolve ",
    "dolfinx": "dolfinx ",
    "felupe": "FElupe ",
    "skfem": "scikit-fem ",
}
HERE_TOO = ("ngbrain", "ngsolve")
"""Those that run in this environment; only they refine meshes at corners."""

_compiled: set[tuple[str, str]] = set()


def environments() -> Path:
    """The folder of the environments."""
    return Path(os.environ.get("PEERS", HERE.parent / "out" / "peers")).resolve()


def available() -> dict[str, str]:
    """Solvers that can run here, with their Python."""
    found = dict.fromkeys(HERE_TOO, sys.executable)
    for peer in SCRIPTS:
        if python := python_of(peer):
            found[peer] = python
    return found


def python_of(peer: str) -> str | None:
    """Of its environment, where that was made."""
    folder = environments() / peer
    return str(folder / "bin" / "python") if (folder / ".done").exists() else None


def run(
    peer: str,
    case: str,
    n: int,
    element: str,
    timeout: float = 600,
    steps: int | None = None,
    cold: bool = False,
    threads: int = 1,
    corners: int = 0,
) -> dict:
    """The record of one solve; where there is none, `converged` is False and `reason` says why.

    dolfinx compiles C once for each element: `cold` counts that, else it is done before.
    """
    python = available().get(peer)
    order = int(element[1]) if element[1].isdigit() else None
    record = {"method": f"{LABELS[peer]}{element}{' graded' if corners else ''}", "case": case, "n": n, "order": order}
    record |= {"steps": steps, "corners": corners}
    record |= {"ndof": None, "value": None, "newton": None, "cpu_s": None, "wall_s": None, "phases": {}}
    record |= {"memory_mib": None, "threads": threads, "versions": {}, "converged": False}
    if python is None:
        return record | {"reason": "not installed: make bench-peers"}
    if corners and peer not in HERE_TOO:
        return record | {"reason": "not offered: refinement at corners"}
    command = [python, str(HERE / "peers" / SCRIPTS[peer]), "--case", case, "--element", element]
    command += ["--steps", str(steps)] if steps else []
    command += ["--corners", str(corners)] if corners else []
    with tempfile.TemporaryDirectory() as empty:
        cache = empty if cold else str(environments() / "cache")
        given = os.environ | {"XDG_CACHE_HOME": cache, "PEER_THREADS": str(threads), "PYTHONWARNINGS": "ignore"}
        if peer == "dolfinx" and not cold and (case, element) not in _compiled:
            _compiled.add((case, element))
            _call([*command, "--n", "1"], given, 300)
        return record | _call([*command, "--n", str(n)], given, timeout)


def _call(command: list[str], environment: dict[str, str], timeout: float) -> dict:
    """What a script printed, or how it ended without."""
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, errors="replace", timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired:
        return {"reason": f"took more than {timeout:g} s"}
    for text in reversed(done.stdout.splitlines()):
        if text.startswith("{"):
            return json.loads(text)
    if done.returncode < 0:
        return {"reason": f"crashed: signal {-done.returncode}"}
    last = (done.stderr.strip() or "no output").splitlines()[-1]
    return {"reason": f"exit status {done.returncode}: {last[:200]}"}


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4])))
