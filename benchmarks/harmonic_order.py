"""Error of shear waves against unknowns and time, by order 1 to 8, without loss and with a damping ratio of 0.2.

A strip of length L and height L/4, driven on one end, clamped on the other, rollers on its long sides: u = sin k(L - x) /
sin kL, kL = 20 and 80 (3 and 13 wavelengths), on triangles. Error: L2 over the strip. A wave that is off by its own size
has failed: without loss its phase has drifted away, or the mesh's resonances have moved onto the frequency. One thread;
CPU time of mesh, assembly, factor and solution. Peers: plain NGSolve, scikit-fem with SciPy's SuperLU (`make bench-peers`).

    python benchmarks/harmonic_order.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/harmonic_order.py --chart FILE.png < records.json
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import _command
import _front
import _peers
import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh

from ngbrain.forward import HarmonicProblem, Wave
from ngbrain.materials import Shearing

HERTZ, RHO, LENGTH, BULK = 50.0, 1000.0, 0.1, 1e5
OMEGA = 2 * np.pi * HERTZ
ORDERS = (1, 2, 3, 4, 5, 6, 7, 8)
PER_WAVELENGTH = (6, 10, 14, 20, 30)
PEERS = {
    "NGSolve P1": ("ngsolve_waves.py", sys.executable, 1),
    "NGSolve P2": ("ngsolve_waves.py", sys.executable, 2),
    "NGSolve P4": ("ngsolve_waves.py", sys.executable, 4),
    "scikit-fem P1": ("skfem_waves.py", "skfem", 1),
    "scikit-fem P2": ("skfem_waves.py", "skfem", 2),
    "scikit-fem P4": ("skfem_waves.py", "skfem", 4),
}


def elements(kL: float, per_wavelength: float, order: int) -> int:
    """Along the strip, in fours."""
    return max(4, 4 * round(kL / (2 * np.pi) * per_wavelength / order / 4))


def ours(kL: float, xi: float, n: int, order: int) -> dict:
    """One solve."""
    modulus = RHO * (OMEGA * LENGTH / kL) ** 2 * (1 + 2j * xi)
    start = time.process_time()
    mesh = MakeStructured2DMesh(quads=False, nx=n, ny=n // 4, mapping=lambda x, y: (LENGTH * x, LENGTH / 4 * y))
    held, wave = {"x": ".*", "y": "left|right"}, Wave(HERTZ, {"left": (0, 1e-3)})
    body = HarmonicProblem(mesh, Shearing(modulus), [wave], bulk=BULK, density=RHO, form=f"P{order}", dirichlet=held)
    u = body.solve()[0]
    cpu = time.process_time() - start
    k = complex(OMEGA * np.sqrt(RHO / modulus))
    exact = ngs.CF((0, 1e-3 / np.sin(k * LENGTH) * ngs.sin(k * (LENGTH - ngs.x))))
    off, whole = (ngs.Integrate(ngs.Norm(f) ** 2, mesh, order=2 * order + 4) for f in (u - exact, exact))
    versions = {"ngsolve": ngs.__version__}
    return {"ndof": body.fes.ndof, "error": float(np.sqrt(off / whole)), "cpu_s": cpu, "versions": versions}


def theirs(name: str, kL: float, xi: float, n: int) -> dict:
    """One solve in a process, and perhaps an environment, of its own."""
    script, python, order = PEERS[name]
    if python == "skfem":
        python = _peers.available().get("skfem", "")
        if not python:
            return {"reason": "not installed: make bench-peers"}
    folder = Path(__file__).resolve().parent / "peers"
    command = [python, str(folder / script), *map(str, (kL, xi, n, order))]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=False)
    if done.returncode:
        return {"reason": (done.stderr.strip() or "no output").splitlines()[-1][:200]}
    return json.loads(done.stdout.strip().splitlines()[-1])


def record(method: str, order: int, kL: float, xi: float, n: int, found: dict) -> dict:
    """As all benchmarks write it."""
    made = {"method": method, "order": order, "kL": kL, "xi": xi, "n": n, "ndof": None, "error": None, "cpu_s": None}
    made |= {"per_wavelength": n * order * 2 * np.pi / kL, "converged": False} | found
    if made["error"] is not None:
        made["converged"] = made["error"] < 1
        if not made["converged"]:
            made["reason"] = "off by more than the wave"
    return made


def measure(quick: bool) -> list[dict]:
    """All orders on all meshes, then the peers."""
    ours(20.0, 0.0, 4, 1)  # what a first call loads is no method's
    records = []
    for kL in (20.0, 80.0):
        for xi in (0.0, 0.2):
            for per in PER_WAVELENGTH[: 3 if quick else None]:
                for order in ORDERS:
                    n = elements(kL, per, order)
                    found = min((ours(kL, xi, n, order) for _ in range(1 if quick else 2)), key=lambda r: r["cpu_s"])
                    records.append(record(f"ngbrain:P{order}", order, kL, xi, n, found))
                for name, (*_, order) in PEERS.items():
                    if kL < 80 or (quick and (per != 10 or order == 1)):
                        continue
                    n = elements(kL, per, order)
                    records.append(record(name, order, kL, xi, n, theirs(name, kL, xi, n)))
    return records


def chart(records: list[dict], file: str) -> None:
    """Error against unknowns and against time, 13 wavelengths long."""
    plt, made, axes = _front.figure(19, 5.2, 4)
    styles = _front.looks(r["method"] for r in records)
    panels = [(x, xi) for x in ("ndof", "cpu_s") for xi in (0.0, 0.2)]
    for axis, (x, xi) in zip(axes, panels, strict=True):
        rows = [r for r in records if r["xi"] == xi and r["kL"] == 80]
        label = "unknowns" if x == "ndof" else "CPU time, one thread (s)"
        title = "without loss" if xi == 0 else "damping ratio 0.2"
        _front.front(rows, axis, x, label, "relative error (L2)", title, styles, "order", legend=(x, xi) == panels[-1])
    made.suptitle("Shear waves in a strip 13 wavelengths long: order against unknowns and time")
    made.savefig(file, dpi=110)
    plt.close(made)


def line(r: dict) -> str:
    """A record in words."""
    error = f"{r['error']:.2e}" if r["error"] is not None else r.get("reason", "")
    times = f"{r['ndof']:7d} unknowns {r['cpu_s']:7.3f} s" if r["ndof"] else ""
    where = f"kL {r['kL']:3.0f} xi {r['xi']:3.1f} {r['per_wavelength']:5.1f} per wavelength"
    return f"{r['method']:<14} {where} {times}  {error}{'' if r['converged'] else '  failed'}"


if __name__ == "__main__":
    _command.main(__doc__, measure, chart, line)
