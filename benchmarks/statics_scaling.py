"""Time and memory of one linearised solve of a cube, from 10⁴ to 10⁶ unknowns, by factors and by iterations.

Tetrahedra of order 2: displacements at K/μ = 50, and with a pressure of order 1 at K/μ = 10⁴. The right-hand side belongs to
a known smooth vector, which the error is relative to; iterations stop at 1e-8. CPU time is of assembly, set-up and solve.
Every size has a process of its own, on one thread, with 12 GiB of address space and 900 s; what does not fit is drawn as a
cross with its reason. Peers: scipy's spsolve (SuperLU), and NGSolve's CG with its BDDC as its tutorials have it, whose
coarse problem at this order is the whole matrix.

    python benchmarks/statics_scaling.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/statics_scaling.py --chart FILE.png < records.json
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
from _command import main
from ngsolve.krylovspace import CGSolver
from scipy.sparse.linalg import spsolve

from ngbrain.errors import require
from ngbrain.mesh import block
from ngbrain.solvers import Condensed, prepare
from ngbrain.threads import set_threads

MU, SIDE, GIB = 1000.0, 0.1, 2**30
MEMORY, SECONDS = 12, 900
RATIO = {"displacement": 50.0, "mixed": 1e4}
METHODS = {
    ("displacement", "ngbrain:sparsecholesky"): ("#0072B2", "s-"),
    ("displacement", "ngbrain:cg-amg"): ("#D55E00", "o-"),
    ("displacement", "ngsolve CG bddc"): ("#009E73", "^--"),
    ("displacement", "scipy spsolve"): ("#999999", "v--"),
    ("mixed", "ngbrain:sparsecholesky"): ("#0072B2", "s-"),
    ("mixed", "ngbrain:minres-amg"): ("#D55E00", "o-"),
    ("mixed", "ngbrain:minres-bddc"): ("#009E73", "^-"),
    ("mixed", "scipy spsolve"): ("#999999", "v--"),
}
SIZES = {"sparsecholesky": 3e5, "bddc": 1e5, "spsolve": 3e4, "amg": 1e6}
"""Where each kind of method stops: a factor's memory grows as n^4/3 and more, its time as n² and more."""


def form(case: str, target: float) -> ngs.BilinearForm:
    """The linearised equations of a clamped cube with about so many unknowns."""
    space = ngs.VectorH1(block((SIDE,) * 3, SIDE / (target / 18) ** (1 / 3)), order=2, dirichlet="bottom|top")
    if case == "mixed":
        space = space * ngs.H1(space.mesh, order=1)
        (u, p), (v, q) = space.TnT()
    else:
        u, v = space.TnT()
    e, f = ngs.Sym(ngs.Grad(u)), ngs.Sym(ngs.Grad(v))
    a = ngs.BilinearForm(space, symmetric=True)
    a += 2 * MU * (ngs.InnerProduct(e, f) - ngs.Trace(e) * ngs.Trace(f) / 3) * ngs.dx
    K = RATIO[case] * MU
    if case == "mixed":
        a += (p * ngs.Trace(f) + q * ngs.Trace(e) - p * q / K) * ngs.dx
    else:
        a += K * ngs.Trace(e) * ngs.Trace(f) * ngs.dx
    return a


def known(a: ngs.BilinearForm) -> np.ndarray:
    """A smooth state, zero where it is held."""
    gfu = ngs.GridFunction(a.space)
    x, y, z = (np.pi / SIDE * s for s in (ngs.x, ngs.y, ngs.z))
    u = 1e-3 * ngs.sin(z) * ngs.CF((ngs.cos(y), ngs.cos(2 * x), ngs.cos(x) * ngs.sin(y)))
    if a.space.type == "VectorH1":
        gfu.Set(u)
    else:
        gfu.components[0].Set(u)
        gfu.components[1].Set(MU * ngs.cos(x) * ngs.cos(2 * z))
    return gfu.vec.FV().NumPy() * np.fromiter(a.space.FreeDofs(), bool, a.space.ndof)


def ours(name: str, a: ngs.BilinearForm) -> tuple[Callable, Callable]:
    """What sets a solver of ngbrain up, and what solves with it."""
    make = prepare(name, a, MU)
    made = []

    def solve(b: np.ndarray) -> tuple[np.ndarray, int]:
        return made[0](b), made[0].iterations

    return lambda: made.append(make()), solve


def bddc(a: ngs.BilinearForm) -> tuple[Callable, Callable]:
    """NGSolve's own."""
    preconditioner = ngs.Preconditioner(a, "bddc")

    def solve(b: np.ndarray) -> tuple[np.ndarray, int]:
        right = a.mat.CreateColVector()
        right.FV().NumPy()[:] = b
        cg = CGSolver(a.mat, preconditioner, tol=1e-8, maxiter=500)
        return cg.Solve(right).FV().NumPy().copy(), cg.iterations

    return lambda: None, solve


def superlu(a: ngs.BilinearForm) -> tuple[Callable, Callable]:
    """scipy's own."""

    def solve(b: np.ndarray) -> tuple[np.ndarray, int]:
        free = np.fromiter(a.space.FreeDofs(), bool, a.space.ndof)
        matrix = sp.csr_array(tuple(np.array(part) for part in a.mat.CSR()), shape=a.mat.shape)
        x = np.zeros(len(b))
        x[free] = spsolve(matrix[free][:, free].tocsc(), b[free])
        return x, 1

    return lambda: None, solve


def one(case: str, method: str, target: float) -> dict:
    """A record, measured in this process."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY * GIB, MEMORY * GIB))
    phases, since = {}, [time.process_time()]

    def lap(phase: str) -> None:
        phases[phase], since[0] = time.process_time() - since[0], time.process_time()

    a = form(case, target)
    print(json.dumps({"ndof": a.space.ndof}), flush=True)  # for the record of a failure: Netgen's sizes come in jumps
    lap("mesh")
    wall = time.perf_counter()
    x = known(a)
    since[0] = time.process_time()
    setup, solve = bddc(a) if "CG" in method else superlu(a) if "spsolve" in method else ours(method.split(":")[1], a)
    a.Assemble()
    lap("assemble")
    setup()
    lap("set-up")
    condensed = Condensed(a)
    b = condensed.apply(x)
    since[0] = time.process_time()
    found, iterations = solve(b)
    lap("solve")
    u = slice(0, a.space.ndof if case == "displacement" else a.space.components[0].ndof)
    error = float(np.linalg.norm(found[u] - x[u]) / np.linalg.norm(x[u]))
    residual = float(np.linalg.norm(condensed.apply(found) - b) / np.linalg.norm(b))
    return {
        "ndof": a.space.ndof, "error": error, "residual": residual, "cpu_s": sum(phases.values()) - phases["mesh"],
        "wall_s": time.perf_counter() - wall, "memory_gib": peak(), "iterations": iterations,
        "converged": error < 1e-4, "reason": "" if error < 1e-4 else f"error {error:.1e}", "phases": phases,
    }  # fmt: skip


def size(said: list[str]) -> dict:
    """The number of unknowns that a process that failed had come to."""
    return json.loads(said[0]) if said else {}


def peak() -> float:
    """Most memory that this process has had (GiB); what a parent had before it started does not count."""
    status = Path("/proc/self/status")
    if status.exists():
        return (
            next(int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith("VmHWM")) / 2**20
        )
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / GIB  # bytes elsewhere


def apart(case: str, method: str, target: float) -> dict:
    """The same, measured in a process of its own."""
    record = {"method": method, "case": case, "order": 2, "ratio": RATIO[case], "threads": 1, "ndof": round(target)}
    failed = {"error": None, "cpu_s": None, "wall_s": None, "memory_gib": None, "iterations": None, "converged": False}
    command = [sys.executable, __file__, "--case", case, method, str(target)]
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
    except subprocess.TimeoutExpired as stopped:
        said = (stopped.stdout or b"").decode().splitlines()
        return {**record, **size(said), **failed, "reason": f"more than {SECONDS} s", "phases": {}}
    said = child.stdout.splitlines()
    if child.returncode == 0:
        return {**record, **json.loads(said[-1])}
    last = (child.stderr.strip().splitlines() or [f"exit status {child.returncode}"])[-1]
    memory = "alloc" in child.stderr or "MemoryError" in child.stderr or child.returncode < 0
    return {
        **record,
        **size(said),
        **failed,
        "reason": f"more than {MEMORY} GiB" if memory else last[:120],
        "phases": {},
    }


def measure(quick: bool) -> list[dict]:
    """One record for each case, method and size; a method stops at its first failure."""
    records = []
    for case, method in METHODS:
        most = next(most for kind, most in SIZES.items() if kind in method)
        for target in (2e3, 5e3) if quick else (1e4, 3e4, 1e5, 2e5, 3e5, 1e6):
            if target > most:
                break
            records.append(apart(case, method, target))
            if not records[-1]["converged"]:
                break
    return records


def slope(x: list[float], y: list[float]) -> str:
    """Exponent of the growth over the last sizes."""
    if len(x) < 2:
        return ""
    return f", n^{np.polyfit(np.log(x[-4:]), np.log(y[-4:]), 1)[0]:.2f}"


def chart(records: list[dict], path: str) -> None:
    """CPU time and memory against unknowns, a row for each case; a failure is a cross on top, with its reason."""
    plt = require("matplotlib.pyplot", "report")
    figure, rows = plt.subplots(2, 2, figsize=(11, 8.4), layout="constrained", sharex=True)
    titles = {"displacement": "displacements, P2, K/μ = 50", "mixed": "with a pressure, P2/P1, K/μ = 10⁴"}
    for case, panels in zip(titles, rows, strict=True):
        for key, label, axes in zip(
            ("cpu_s", "memory_gib"), ("CPU time (s)", "peak memory (GiB)"), panels, strict=True
        ):
            good = [r for r in records if r["case"] == case and r["converged"]]
            top = 2 * max(r[key] for r in good)
            for (of, method), (colour, style) in METHODS.items():
                if of != case:
                    continue
                found = [r for r in good if r["method"] == method]
                x, y = [r["ndof"] for r in found], [r[key] for r in found]
                axes.loglog(x, y, style, color=colour, label=f"{method}{slope(x, y)}")
                for r in records:
                    if (r["case"], r["method"], r["converged"]) == (case, method, False):
                        axes.plot(r["ndof"], top, "x", color=colour, ms=9, mew=2)
                        axes.annotate(
                            r["reason"], (r["ndof"], top), (0, -12), textcoords="offset points", ha="center", fontsize=7
                        )
            axes.set(ylabel=label, title=titles[case], xlabel="unknowns")
            axes.grid(alpha=0.3, which="both")
            axes.legend(fontsize=8)
    figure.savefig(path, dpi=150)


def line(r: dict) -> str:
    """One record as text."""
    start = f"{r['case']:<12} {r['method']:<24} {r['ndof']:8d}"
    if not r["converged"]:
        return f"{start}  failed: {r['reason']}"
    return f"{start}  {r['error']:.1e}  {r['iterations']:4d} its  {r['cpu_s']:7.2f} s  {r['memory_gib']:5.2f} GiB"


if __name__ == "__main__":
    if sys.argv[1:2] == ["--case"]:
        set_threads(1)
        ngs.ngsglobals.msg_level = 0
        print(json.dumps(one(sys.argv[2], sys.argv[3], float(sys.argv[4]))))
    else:
        main(__doc__, measure, chart, line)
