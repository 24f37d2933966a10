"""One system of equations solved in several ways on the processor and on a GPU: a JSON line before and one after each.

    python _gpu_cells.py PROBLEM N [--skip METHOD …] [--reference]

A process of its own, so that whoever started it can end a method that takes too long and outlives one that crashes. Where there
is no GPU, methods on the device are left out, or run on NGSolve's reference device (--reference): that is the processor playing
a GPU, records say device "host", and their times mean nothing.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import time
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from _gpu_pack import preload

LOADED = preload(Path(os.environ["NGBRAIN_GPU_SITE"])) if "NGBRAIN_GPU_SITE" in os.environ else {}
import ngsolve as ngs  # noqa: E402  (after the libraries that it looks for)
import numpy as np  # noqa: E402

with warnings.catch_warnings(record=True) as TROUBLE:
    warnings.simplefilter("always")
    import ngsolve.gpu as gpu
from ngsolve import Grad, InnerProduct, Sym, div, dx  # noqa: E402
from ngsolve.comp import IntegrationRuleSpace  # noqa: E402
from ngsolve.krylovspace import CGSolver, DeviceCGSolver, DeviceTFQMRSolver, MinResSolver, TFQMRSolver  # noqa: E402
from ngsolve.meshes import MakeStructured3DMesh  # noqa: E402

Array = np.ndarray
Record = dict
TOLERANCE, ITERATIONS = 1e-10, 3000
DIRECT_UNKNOWNS = 120_000
"""Above this the processor makes no factors: they would take minutes."""
HELD = "back|left|right|front"
ERROR_ALLOWED = 1e-8
"""Relative residual, or distance from what the processor finds."""


@dataclass
class System:
    """A x = b in the free unknowns.

    blocks : unknowns of each node, for block Jacobi
    preconditioned : the matrix of which block Jacobi takes the diagonal blocks (A itself by default)
    complex : the same waves as one complex symmetric matrix with its right-hand side, for direct solvers
    """

    order: int
    matrix: ngs.BaseMatrix
    b: ngs.BaseVector
    free: ngs.BitArray
    blocks: list[list[int]]
    krylov: str
    definite: bool = True
    preconditioned: ngs.BaseMatrix | None = None
    complex: tuple[ngs.BaseMatrix, ngs.BaseVector, ngs.BitArray] | None = None
    keep: list = field(default_factory=list)

    def residual(self, x: ngs.BaseVector) -> float:
        """‖b − A x‖ / ‖b‖ in the free unknowns, computed on the processor."""
        project = ngs.Projector(self.free, True)
        r = self.b.CreateVector()
        r.data = project * (self.b - self.matrix * x)
        b = self.b.CreateVector()
        b.data = project * self.b
        return float(ngs.Norm(r) / ngs.Norm(b))

    def smoother(self) -> ngs.BaseMatrix:
        """Block Jacobi."""
        return (self.preconditioned or self.matrix).CreateBlockSmoother(self.blocks)


def cube(n: int) -> ngs.Mesh:
    """Six tetrahedra in each of n³ cells of the unit cube."""
    return MakeStructured3DMesh(hexes=False, nx=n, ny=n, nz=n)


def node_blocks(free: ngs.BitArray, *groups: Array) -> list[list[int]]:
    """Free unknowns of each node; a group has the unknowns of a node in each row."""
    mask = np.fromiter(free, bool, len(free))
    rows = (row[mask[row]].tolist() for group in groups for row in group)
    return [row for row in rows if row]


def by_component(space: ngs.FESpace, components: int = 3, first: int = 0) -> Array:
    """(nodes, components) unknowns of a vector space, which stores one component after another."""
    nodes = space.ndof // components
    return first + np.arange(nodes)[:, None] + nodes * np.arange(components)[None, :]


def elasticity(n: int) -> System:
    """Order 2, Poisson's ratio 1/3."""
    space = ngs.VectorH1(cube(n), order=2, dirichlet=HELD)
    u, v = space.TnT()
    form = ngs.BilinearForm(2 * InnerProduct(Sym(Grad(u)), Sym(Grad(v))) * dx + 2 * div(u) * div(v) * dx).Assemble()
    load = ngs.LinearForm(v[2] * dx).Assemble()
    free = space.FreeDofs()
    return System(2, form.mat, load.vec, free, node_blocks(free, by_component(space)), "cg", keep=[form, load])


def mixed(n: int) -> System:
    """Displacement of order 2 and pressure of order 1, K/μ = 1000."""
    mesh = cube(n)
    displacement, pressure = ngs.VectorH1(mesh, order=2, dirichlet=HELD), ngs.H1(mesh, order=1)
    space = displacement * pressure
    (u, p), (v, q) = space.TnT()
    shear = 2 * InnerProduct(Sym(Grad(u)), Sym(Grad(v))) * dx
    form = ngs.BilinearForm(shear + (div(u) * q + div(v) * p - 1e-3 * p * q) * dx).Assemble()
    diagonal = ngs.BilinearForm(shear + p * q * dx).Assemble()
    load = ngs.LinearForm(v[2] * dx).Assemble()
    free, one = space.FreeDofs(), np.arange(displacement.ndof, space.ndof)[:, None]
    blocks = node_blocks(free, by_component(displacement), one)
    return System(
        2, form.mat, load.vec, free, blocks, "minres", False, diagonal.mat, keep=[form, diagonal, load]
    )  # fmt: skip


def waves(n: int) -> System:
    """Order 2, G = 1 + 0.5i, one wavelength across: real and imaginary parts as unknowns of a real matrix.

    With one and a half wavelengths block Jacobi is too weak, and TFQMR stagnates or breaks down.
    """
    mesh, stiffness, omega2 = cube(n), 1 + 0.5j, (2 * np.pi) ** 2
    part = ngs.VectorH1(mesh, order=2, dirichlet=HELD)
    space = part * part
    (a, b), (v, w) = space.TnT()

    def strain(u: ngs.CoefficientFunction, v: ngs.CoefficientFunction) -> ngs.CoefficientFunction:
        return 2 * InnerProduct(Sym(Grad(u)), Sym(Grad(v))) + 2 * div(u) * div(v)

    real = stiffness.real * (strain(a, v) + strain(b, w)) - omega2 * (a * v + b * w)
    form = ngs.BilinearForm((real + stiffness.imag * (strain(a, w) - strain(b, v))) * dx).Assemble()
    load = ngs.LinearForm(v[2] * dx).Assemble()
    free = space.FreeDofs()
    both = np.hstack([by_component(part), by_component(part, first=part.ndof)])
    whole = ngs.VectorH1(mesh, order=2, complex=True, dirichlet=HELD)
    u, v = whole.TnT()
    complex_form = ngs.BilinearForm((stiffness * strain(u, v) - omega2 * u * v) * dx).Assemble()
    complex_load = ngs.LinearForm(v[2] * dx).Assemble()
    one = complex_form.mat, complex_load.vec, whole.FreeDofs()
    keep = [form, load, complex_form, complex_load]
    return System(2, form.mat, load.vec, free, node_blocks(free, both), "tfqmr", False, complex=one, keep=keep)


def on_processor(system: System, threads: int) -> Record:
    """A Krylov method of NGSolve's with block Jacobi."""
    kind = {"cg": CGSolver, "minres": MinResSolver, "tfqmr": TFQMRSolver}[system.krylov]
    project = ngs.Projector(system.free, True)
    with parallel(threads):
        begun = time.perf_counter()
        smoother = system.smoother()
        matrix = system.matrix if system.krylov == "cg" else project @ system.matrix @ project
        b = system.b.CreateVector()
        b.data = project * system.b
        ready = time.perf_counter()
        solver = kind(mat=matrix, pre=smoother, tol=TOLERANCE, maxiter=ITERATIONS, printrates=False)
        x = solver.Solve(rhs=b)
        return outcome(system, x, begun, ready, solver.iterations)


def on_device(system: System) -> Record:
    """The same methods with all vectors and matrices on the device."""
    begun = time.perf_counter()
    matrix, smoother = system.matrix.CreateDeviceMatrix(), system.smoother().CreateDeviceMatrix()
    project = ngs.Projector(system.free, True)
    masked = system.b.CreateVector()
    masked.data = project * system.b
    b = matrix.CreateColVector()
    b.data = masked
    common = {"pre": smoother, "tol": TOLERANCE, "maxiter": ITERATIONS, "printrates": False}
    if system.krylov == "minres":
        mask = project.CreateDeviceMatrix()
        solver = MinResSolver(mat=mask @ matrix @ mask, **common)
    elif system.krylov == "tfqmr":
        mask = project.CreateDeviceMatrix()
        solver = DeviceTFQMRSolver(mat=mask @ matrix @ mask, **common)
    else:
        solver = DeviceCGSolver(mat=matrix, **common)
    ready = time.perf_counter()
    found = solver.Solve(rhs=b)
    x = system.b.CreateVector()
    x.data = found
    return outcome(system, x, begun, ready, solver.iterations)


def refined(system: System, rounds: int = 8) -> Record:
    """CG in single precision on the device, its residuals in double."""
    begun = time.perf_counter()
    matrix, single = system.matrix.CreateDeviceMatrix(), system.matrix.CreateDeviceMatrix(fp32=True)
    smoother = system.smoother().CreateDeviceMatrix(fp32=True)
    b, x, r = (matrix.CreateColVector() for _ in range(3))
    masked = system.b.CreateVector()
    project = ngs.Projector(system.free, True)
    masked.data = project * system.b
    b.data = masked
    mask = project.CreateDeviceMatrix()
    x[:] = 0
    low, step = single.CreateColVector(), matrix.CreateColVector()
    solver = DeviceCGSolver(mat=single, pre=smoother, tol=1e-5, maxiter=ITERATIONS, printrates=False)
    ready, iterations, size = time.perf_counter(), 0, float(ngs.Norm(b))
    for _ in range(rounds):
        r.data = b - matrix * x
        r.data = mask * r
        if float(ngs.Norm(r)) <= TOLERANCE * size:
            break
        low.data = r
        step.data = solver.Solve(rhs=low)
        iterations += solver.iterations
        x.data += step
    host = system.b.CreateVector()
    host.data = x
    return outcome(system, host, begun, ready, iterations)


def direct_on_processor(system: System, threads: int) -> Record:
    """NGSolve's sparse Cholesky, or UMFPACK where pivots are needed."""
    matrix, b, free = system.complex or (system.matrix, system.b, system.free)
    kind = "sparsecholesky" if system.definite or system.complex else "umfpack"
    with parallel(threads):
        begun = time.perf_counter()
        inverse = matrix.Inverse(free, inverse=kind)
        ready = time.perf_counter()
        x = b.CreateVector()
        x.data = inverse * b
        return outcome(system, x, begun, ready)


def cholesky_on_device(system: System) -> Record:
    """The processor's factor, its triangles solved with on the device."""
    begun = time.perf_counter()
    inverse = ngs.la.DeviceSparseCholeskyD(system.matrix.Inverse(system.free, inverse="sparsecholesky"))
    ready = time.perf_counter()
    x = system.b.CreateVector()
    x.data = inverse * system.b
    return outcome(system, x, begun, ready)


def cudss(system: System) -> Record:
    """LDLᵀ by cuDSS, of the complex symmetric matrix where there is one."""
    matrix, b, free = system.complex or (system.matrix, system.b, system.free)
    from ngbrain.solvers import CudssFactor

    need_cudss()
    begun = time.perf_counter()
    factor = CudssFactor(matrix, free)
    ready = time.perf_counter()
    x = b.CreateVector()
    x.FV().NumPy()[:] = factor.solve(np.array(b.FV().NumPy()))
    return outcome(system, x, begun, ready)


def need_cudss() -> None:
    """Raise `ImportError` where cuDSS or its interface is not there."""
    from cuda.pathfinder import DynamicLibNotFoundError, load_nvidia_dynamic_lib

    try:
        load_nvidia_dynamic_lib("cudss")
    except DynamicLibNotFoundError as error:
        raise ImportError(f"cuDSS' library is not there: {error}") from error


def parallel(threads: int) -> object:
    """NGSolve's tasks on so many threads."""
    ngs.SetNumThreads(threads)
    return ngs.TaskManager() if threads > 1 else nullcontext()


def outcome(system: System, x: ngs.BaseVector, begun: float, ready: float, iterations: int | None = None) -> Record:
    """Seconds to set up and to solve, and the residual."""
    solved = time.perf_counter()
    if np.iscomplexobj(x.FV().NumPy()):
        both = system.b.CreateVector()
        values = x.FV().NumPy()
        both.FV().NumPy()[:] = np.concatenate([values.real, values.imag])
        x = both
    return {
        "setup_s": ready - begun,
        "solve_s": solved - ready,
        "iterations": iterations,
        "error": system.residual(x),
        "solution": float(ngs.Norm(x)),
    }


def methods(system: System) -> dict[str, Callable[[], Record]]:
    """Name → what it does: direct solvers of the processor only where they do not take minutes."""
    krylov = system.krylov
    found: dict[str, Callable[[], Record]] = {f"{krylov}, device": lambda: on_device(system)}
    if krylov == "cg":
        found["cg in single precision, refined, device"] = lambda: refined(system)
    if len(system.b) <= DIRECT_UNKNOWNS and system.definite:
        found["cholesky, device"] = lambda: cholesky_on_device(system)
    found["cudss, device"] = lambda: cudss(system)
    for count in sorted({1, os.cpu_count() or 1}, reverse=True):
        found[f"{krylov}, processor, threads {count}"] = lambda count=count: on_processor(system, count)
        if len(system.b) <= DIRECT_UNKNOWNS:
            found[f"direct, processor, threads {count}"] = lambda count=count: direct_on_processor(system, count)
    return found


@dataclass
class Stiffness:
    """∫ ∇u·∇v of order p, assembled and matrix-free: reference gradients, the geometry at integration points, and back."""

    p: int
    n: int

    def __post_init__(self) -> None:
        mesh = cube(self.n)
        self.space = ngs.H1(mesh, order=self.p)
        points = IntegrationRuleSpace(mesh, order=2 * self.p - 2)
        rules = points.GetIntegrationRules()
        u, q = self.space.TrialFunction(), points.TestFunction()
        jacobian = ngs.specialcf.JacobianMatrix(3)
        size = ngs.sqrt(ngs.Det(jacobian) ** 2)
        reference = (
            jacobian.trans * Grad(u) / size
        )  # nothing of an element's shape is left: one small matrix serves all of them
        self.gradients = []
        for axis in range(3):
            form = ngs.BilinearForm(trialspace=self.space, testspace=points, geom_free=True)
            form += reference[axis] * q * dx(intrules=rules)
            self.gradients.append(form.Assemble().mat)
        volume = np.array(ngs.LinearForm(q * dx(intrules=rules)).Assemble().vec.FV().NumPy())
        inverse = ngs.Inv(jacobian)
        values = ngs.GridFunction(points)

        def at_points(coefficient: ngs.CoefficientFunction) -> Array:
            values.Interpolate(coefficient)
            return np.array(values.vec.FV().NumPy())

        scale = at_points(size) ** 2 / volume
        metric = inverse * inverse.trans
        self.metric = [
            [ngs.DiagonalMatrix(vector(scale * at_points(metric[i, j]))) for j in range(3)] for i in range(3)
        ]
        u, v = self.space.TnT()
        self.matrix = ngs.BilinearForm(Grad(u) * Grad(v) * dx).Assemble().mat

    def apply(self, gradients: list, transposed: list, metric: list, x: ngs.BaseVector, y: ngs.BaseVector) -> None:
        """y = A x."""
        at = [g.CreateColVector() for g in gradients]
        flux = gradients[0].CreateColVector()
        for value, gradient in zip(at, gradients, strict=True):
            value.data = gradient * x
        y[:] = 0
        for row, back in zip(metric, transposed, strict=True):
            flux[:] = 0
            for entry, value in zip(row, at, strict=True):
                flux.data += entry * value
            y.data += back * flux

    def methods(self) -> dict[str, Callable[[], Record]]:
        """Assembled on the processor and on the device, and matrix-free on the device."""
        return {
            "assembled, processor, threads 1": lambda: self.timed(self.matrix, None),
            "assembled, device": lambda: self.timed(self.matrix.CreateDeviceMatrix(), None),
            "matrix-free, device": lambda: self.timed(
                None,
                (
                    [g.CreateDeviceMatrix() for g in self.gradients],
                    [g.T.CreateDeviceMatrix() for g in self.gradients],
                    [[d.CreateDeviceMatrix() for d in row] for row in self.metric],
                ),
            ),
        }

    def timed(self, matrix: ngs.BaseMatrix | None, parts: tuple | None) -> Record:
        """Seconds of one application, and how far it is from the processor's."""
        begun = time.perf_counter()
        start = self.matrix.CreateRowVector()
        start.FV().NumPy()[:] = np.random.default_rng(0).normal(size=len(start))
        wanted = self.matrix.CreateColVector()
        wanted.data = self.matrix * start
        x = self.matrix.CreateRowVector() if matrix is self.matrix else ngs.la.DeviceVectorD(len(start))
        y = x.CreateVector()
        x.data = start

        def once() -> None:
            if matrix:
                y.data = matrix * x
            else:
                self.apply(*parts, x, y)

        once()
        ngs.Norm(y)  # waits for the device
        ready = time.perf_counter()
        count = 0
        while count < 3 or (time.perf_counter() - ready < 0.3 and count < 100):
            once()
            count += 1
            ngs.Norm(y)
        seconds = (time.perf_counter() - ready) / count
        found = self.matrix.CreateColVector()
        found.data = y
        found.data -= wanted
        return {"setup_s": ready - begun, "solve_s": seconds, "error": float(ngs.Norm(found) / ngs.Norm(wanted))}


def vector(values: Array) -> ngs.BaseVector:
    """Of NGSolve's kind."""
    made = ngs.la.CreateVVector(len(values))
    made.FV().NumPy()[:] = values
    return made


def bandwidth(device: bool, size: int) -> Record:
    """Bytes that y = 3 x reads and writes in a second."""
    x = ngs.la.DeviceVectorD(size) if device else ngs.la.CreateVVector(size)
    y = x.CreateVector()
    x[:] = 1.0
    y.data = 3 * x
    ngs.Norm(y)
    begun = time.perf_counter()
    for _ in range(10):
        y.data = 3 * x
    ngs.Norm(y)
    seconds = time.perf_counter() - begun
    return {"setup_s": 0.0, "solve_s": seconds, "error": 0.0, "bytes_per_s": 11 * 16 * size / seconds}


def memory(size: int) -> dict[str, Callable[[], Record]]:
    """Of the processor and of the device."""
    return {"processor": lambda: bandwidth(False, size), "device": lambda: bandwidth(True, size)}


def loaded() -> dict[str, Callable[[], Record]]:
    """What loads: NGSolve with its device, NVIDIA's libraries and cuDSS' interface."""

    def ngsolve() -> Record:
        device = gpu.GetGPUDevice()
        trouble = [str(warning.message) for warning in TROUBLE]
        found = {"version": ngs.__version__, "backend": gpu.backend, "name": str(device), "libraries": LOADED}
        return found | {"error": 0.0, "python": platform.python_version(), "trouble": trouble}

    def driver() -> Record:
        query = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
        return {"name": subprocess.run(query, capture_output=True, text=True, check=True).stdout.strip(), "error": 0.0}

    def nvmath() -> Record:
        import nvmath
        import nvmath.sparse.advanced

        return {"version": nvmath.__version__, "error": 0.0}

    return {"ngsolve": ngsolve, "driver": driver, "nvmath": nvmath}


TOO_SLOW = "too slow with fewer unknowns"
"""Why a method was not run."""
PROBLEMS = {"elasticity": elasticity, "mixed": mixed, "waves": waves}


def cells(problem: str, n: int) -> tuple[Record, dict[str, Callable[[], Record]]]:
    """What all records of a problem share, and its methods."""
    if problem == "loading":
        return {"order": None, "ndof": None}, loaded()
    if problem == "memory":
        return {"order": None, "ndof": n}, memory(n)
    if problem.startswith("stiffness"):
        body = Stiffness(int(problem.split()[-1]), n)
        return {"order": body.p, "ndof": body.space.ndof, "entries": body.matrix.nze}, body.methods()
    if problem.startswith("inversion"):
        from _gpu_inversion import inversions

        return inversions(problem.split(" ", 1)[1], n)
    system = PROBLEMS[problem](n)
    return {"order": system.order, "ndof": len(system.b), "entries": system.matrix.nze}, methods(system)


def main() -> None:
    """Print what begins and what came of it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("problem")
    parser.add_argument("n", type=int)
    parser.add_argument("--skip", nargs="*", default=[])
    parser.add_argument("--too-slow", nargs="*", default=[], help="methods to record as too slow, not run")
    parser.add_argument("--reference", action="store_true")
    arguments = parser.parse_args()
    ngs.ngsglobals.msg_level = 0
    begun = time.perf_counter()
    shared, found = cells(arguments.problem, arguments.n)
    shared |= {"problem": arguments.problem, "n": arguments.n, "device": gpu.backend}
    shared |= {"assembly_s": time.perf_counter() - begun}
    for name, method in found.items():
        if name in arguments.skip:
            continue
        shared["last"] = name == list(found)[-1]
        print(json.dumps(shared | {"method": name, "begun": True}), flush=True)
        cpu = time.process_time()
        if name in arguments.too_slow:
            record = {"error": None, "converged": False, "reason": TOO_SLOW}
        elif name.endswith("device") and gpu.backend == "host" and not arguments.reference:
            record = {"error": None, "converged": False, "missing": True, "reason": "no GPU"}
        else:
            try:
                record = {"converged": True, "reason": ""} | method()
                if record["error"] is None or not record["error"] <= record.pop("error_allowed", ERROR_ALLOWED):
                    record |= {"converged": False, "reason": record["reason"] or f"error {record['error']:.1e}"}
            except ImportError as error:  # a later part of the pack may bring it
                record = {
                    "error": None,
                    "converged": False,
                    "missing": True,
                    "reason": str(error).splitlines()[0][:300],
                }
            except Exception as error:  # each library has its own kinds
                record = {"error": None, "converged": False, "reason": f"{type(error).__name__}: {error}"[:300]}
        if record["error"] != record["error"]:
            record["error"] = None  # JSON has no NaN
        print(json.dumps(shared | {"method": name, "cpu_s": time.process_time() - cpu} | record), flush=True)


if __name__ == "__main__":
    main()
