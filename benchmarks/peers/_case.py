"""What every peer's script shares: the cases' numbers, the command line, the clock and the one JSON line.

A script imports this before its library, so that the library starts on one thread:

    python benchmarks/peers/NAME.py --case block|smooth|cook --n N --element P2/P1

An element is its shape functions (P on simplices, Q on hexahedra and quadrilaterals) and order, then its pressure:
"P2/P1" a continuous one (Taylor-Hood), "P4/L2(2)" a discontinuous one, "P2" none.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

THREADS = os.environ.get("PEER_THREADS", "1")
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = THREADS

# block, smooth: mu/2 (J^(-2/3) I1 - 3) + K/2 (J - 1)^2 on [0, L]^3, z = 0 clamped, z = L moved down without sliding:
# by PRESS, sides free, or by WAVE cos(pi x/L) cos(pi y/L) between rollers. The value: the force on the top, weighted so.
L, MU, K = 0.1, 1e3, 1e5
PRESS, WAVE = -0.02, -0.01

# cook: mu/2 (I1 - 3 - 2 ln J) + p ln J - p^2/(2K), plane strain, mm and N; left side clamped, a dead load TRACTION (N/mm)
# up on the right one. The value: u_y at CORNER. The mesh: n x n cells of the unit square through `cook_map`, each cut
# from lower left to upper right;
# `corners` times all cells that touch a corner are bisected, with their neighbours.
COOK_MU, COOK_K, TRACTION = 80.194, 400889.806, 6.25
CORNER = (48.0, 60.0)
CORNERS = ((0.0, 0.0), (48.0, 44.0), CORNER, (0.0, 44.0))

STEPS = {"block": 1, "smooth": 1, "cook": 5}
TOLERANCE, MAX_NEWTON = 1e-8, 30
"""Newton's method stops where the residual is below this fraction of the reactions."""


def cook_map(s: Any, t: Any) -> tuple[Any, Any]:
    """Cook's membrane from the unit square."""
    return 48 * s, 44 * s + t * (44 - 28 * s)


class NotOffered(Exception):
    """The peer lacks this element or case."""


class Failed(Exception):
    """The solve did not reach its tolerance."""

    def __init__(self, reason: str, **found: Any) -> None:
        super().__init__(reason)
        self.found = found


@dataclass(frozen=True)
class Element:
    """What an element's name says."""

    shape: str
    order: int
    pressure: int | None
    continuous: bool

    @classmethod
    def parse(cls, name: str) -> Element:
        """From "P2", "Q2/Q1", "P4/L2(2)" and the like; "auto": simplices, and what ngbrain finds fit."""
        if name == "auto":
            return cls("P", 0, None, False)
        match = re.fullmatch(r"([PQ])(\d)(?:/(?:\1(\d)|L2\((\d)\)))?", name)
        if not match:
            raise SystemExit(f"--element is {name}; wanted: one like P2, Q2/Q1 or P4/L2(2)")
        shape, order, smooth, broken = match.groups()
        pressure = smooth or broken
        return cls(shape, int(order), None if pressure is None else int(pressure), smooth is not None)

    @property
    def key(self) -> str:
        """Its name again."""
        if not self.order:
            return "auto"
        if self.pressure is None:
            return f"{self.shape}{self.order}"
        inner = f"{self.shape}{self.pressure}" if self.continuous else f"L2({self.pressure})"
        return f"{self.shape}{self.order}/{inner}"


def cpu() -> float:
    """CPU seconds of this process and its children so far."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


@dataclass
class Task:
    """One case to solve, and where its CPU seconds went."""

    case: str
    n: int
    element: Element
    steps: int
    corners: int = 0
    phases: dict[str, float] = field(default_factory=dict)
    start: float = field(default_factory=cpu)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Count what happens inside as `name`: compile, assemble, factor, solve or check."""
        start = cpu()
        try:
            yield
        finally:
            self.phases[name] = self.phases.get(name, 0.0) + cpu() - start


def memory_mib() -> float:
    """Peak resident memory of this process."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage would count what the process that started this one held
        found = re.search(r"VmHWM:\s+(\d+)", status.read_text())
        if found:
            return int(found[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main(peer: str, solve: Callable[[Task], dict[str, Any]], versions: dict[str, str]) -> None:
    """Run the case that the command line names and print its record; `solve` gives value, ndof and newton."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--case", choices=STEPS, required=True)
    parser.add_argument("--n", type=int, required=True)
    parser.add_argument("--element", required=True)
    parser.add_argument("--steps", type=int, help="load steps (default: 1; cook 5)")
    parser.add_argument("--corners", type=int, default=0, help="times that a mesh is refined at its corners")
    given = parser.parse_args()
    element = Element.parse(given.element.replace("Q1disc", "L2(1)"))
    task = Task(given.case, given.n, element, given.steps or STEPS[given.case], given.corners)
    method = f"{peer}{':' if peer == 'ngbrain' else ' '}{element.key}{' graded' if given.corners else ''}"
    record: dict[str, Any] = {"method": method, "case": task.case, "n": task.n, "order": element.order}
    record |= {
        "corners": task.corners,
        "steps": task.steps,
        "ndof": None,
        "value": None,
        "newton": None,
        "converged": False,
        "reason": "",
    }
    start, wall = cpu(), time.perf_counter()
    try:
        record |= solve(task) | {"converged": True}
        if not abs(record["value"]) < float("inf"):
            record |= {"value": None, "converged": False, "reason": "the value is not finite"}
    except NotOffered as error:
        record["reason"] = f"not offered: {error}"
        print(f"{record['method']}: {record['reason']}", file=sys.stderr)
    except Failed as error:
        record |= error.found | {"reason": str(error)}
    except Exception as error:
        record["reason"] = f"{type(error).__name__}: " + " ".join(str(error).split())[:200]
    record |= {"cpu_s": cpu() - start, "wall_s": time.perf_counter() - wall, "phases": task.phases}
    record |= {"memory_mib": memory_mib(), "threads": int(THREADS), "versions": versions}
    print(json.dumps(record), flush=True)


def check(residual: float, reactions: float, **found: Any) -> bool:
    """Whether Newton's method is done; it raises where it never will be."""
    if not residual < 1e12 * max(reactions, 1e-300):
        raise Failed(
            "Newton diverged: the residual is not finite" if residual != residual else "Newton diverged", **found
        )
    return residual <= TOLERANCE * reactions


class Pardiso:
    """MKL's direct solver, with its two phases counted; made before the clock starts, since it loads MKL."""

    def __init__(self) -> None:
        import numpy as np
        import pypardiso
        import scipy.sparse

        self.solver, self.task = pypardiso.PyPardisoSolver(), None
        self.solver.solve(scipy.sparse.eye(2, format="csr"), np.ones(2))
        self.versions = {"pypardiso": pypardiso.__version__}

    def __call__(self, A: Any, b: Any) -> Any:
        """Solve A x = b."""
        with self.task.phase("factor"):
            self.solver.factorize(A)
        with self.task.phase("solve"):
            return self.solver.solve(A, b).reshape(b.shape)
