"""Where symmetric systems are factorised and solved: on the processor by NGSolve, on a GPU by NVIDIA's cuDSS, or, with factors of
the processor, by NGSolve's own operators on a GPU.

    A = L D Lᵀ,   x = A⁻¹ b        (unknowns that are free; A real or complex, symmetric without conjugates)

What calls it is the same for all. NGSolve's own cuDSS inverse takes a matrix for symmetric only if it is so to the last bit,
which assembled ones are not, and factorises it as any other, at twice the work; here the callers know.

Source: nvmath-python, nvmath.sparse.advanced.DirectSolver, https://docs.nvidia.com/cuda/nvmath-python.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError, MissingExtra, SolverError, nearest, require
from ngbrain.solvers.matrices import to_ngsolve, to_scipy

Array = np.ndarray


class Factor(Protocol):
    """Of one matrix. Of a symmetric one `solve` serves the transposed system too."""

    def solve(self, b: Array) -> Array:
        """x with Ax = b in the free unknowns and 0 in the others."""


@dataclass(frozen=True)
class Device:
    """Where matrices are factorised.

    name   as `--device` has it
    make   matrix and free unknowns (None: all) → Factor

    >>> matrix = ngs.la.SparseMatrixd.CreateFromCOO([0, 1], [0, 1], [2.0, 4.0], 2, 2)
    >>> Device.from_name("cpu").factor(matrix).solve(np.array([1.0, 1.0])).tolist()
    [0.5, 0.25]
    """

    name: str
    make: Callable[[ngs.BaseMatrix, ngs.BitArray | None], Factor]

    def for_unknowns(self, unknowns: int) -> tuple[Device, str]:
        """The device itself, or what "auto" stands for in a system of this size, with a sentence that says so.

        Below the size at which a GPU was measured to overtake the processor (`CROSSING`, from `benchmarks/gpu.py`), "auto" is the
        processor; above it the GPU, if cuDSS finds one.

        >>> Device.from_name("cpu").for_unknowns(1000)[1]
        ''
        >>> device, note = Device.from_name("auto").for_unknowns(1000)
        >>> device.name
        'cpu'
        """
        if self is not AUTO:
            return self, ""
        if unknowns < CROSSING:
            return (
                CPU,
                f"device auto: the processor, as a GPU is faster only from {CROSSING} unknowns on, not with {unknowns}",
            )
        try:
            return Device.from_name("cuda"), f"device auto: the GPU, with {unknowns} unknowns"
        except (InputError, MissingExtra) as error:
            return CPU, f"device auto: the processor ({error})"

    @staticmethod
    def from_name(name: str) -> Device:
        """cpu or auto, or cuda or ngsolve, which are tried on two unknowns before they are given.

        Raises `InputError` for another name or where no GPU answers, `MissingExtra` without nvmath-python.
        """
        if name not in DEVICES:
            raise InputError("device", repr(name), nearest(name, DEVICES))
        device = DEVICES[name]
        if device not in (CPU, AUTO):
            _try(device)
        return device

    def factor(self, matrix: ngs.BaseMatrix, free: ngs.BitArray | None = None, what: str = "the matrix") -> Factor:
        """A factor; `SolverError` about `what` if there is none. One of a singular matrix may be made: look at residuals."""
        try:
            return self.make(matrix, free)
        except Exception as error:  # NGSolve and nvmath raise bare exceptions of several kinds here
            raise SolverError(f"{what} cannot be factorised: {error}") from error


class CpuFactor:
    """One of NGSolve's inverses, by its name."""

    def __init__(self, matrix: ngs.BaseMatrix, free: ngs.BitArray | None, kind: str) -> None:
        self._inverse = matrix.Inverse(free, inverse=kind)
        self._in, self._out = matrix.CreateColVector(), matrix.CreateRowVector()

    def solve(self, b: Array) -> Array:
        """A⁻¹b."""
        return self._times(self._inverse, b)

    def solve_transpose(self, b: Array) -> Array:
        """A⁻ᵀb, of a factor with pivots."""
        return self._times(self._inverse.T, b)

    def _times(self, inverse: ngs.BaseMatrix, b: Array) -> Array:
        self._in.FV().NumPy()[:] = b
        self._out.data = inverse * self._in
        return np.array(self._out.FV().NumPy())


class CudssFactor:
    """Factor by cuDSS in the GPU's memory, of the lower half of a symmetric matrix; a general one keeps both halves.

    Right-hand sides and solutions are copied there and back. Raises `MissingExtra`, and what nvmath raises.
    """

    def __init__(self, matrix: ngs.BaseMatrix, free: ngs.BitArray | None, symmetric: bool = True) -> None:
        cudss = require("nvmath.sparse.advanced", "gpu")
        from ngsolve.solvers.cudss import make_directsolver_options

        options = make_directsolver_options()  # names cuDSS's library of threads, which orders the unknowns
        n = matrix.height
        self._free = np.ones(n, bool) if free is None else np.fromiter(free, bool, n)
        inner = to_scipy(matrix)[self._free][:, self._free]
        if symmetric:
            options.sparse_system_type = cudss.DirectSolverMatrixType.SYMMETRIC
            options.sparse_system_view = cudss.DirectSolverMatrixViewType.LOWER
            inner = sp.tril(inner, format="csr")
        inner.indices, inner.indptr = inner.indices.astype(np.int32), inner.indptr.astype(np.int32)
        self._type = inner.dtype
        self._solver = cudss.DirectSolver(inner, np.zeros(inner.shape[0], self._type), options=options)
        weakref.finalize(self, self._solver.free).atexit = False  # a process that ends gives all back
        self._solver.plan()
        self._solver.factorize()

    def solve(self, b: Array) -> Array:
        """A⁻¹b."""
        x = np.zeros(len(self._free), self._type)
        self._solver.reset_operands(b=np.asarray(b[self._free], self._type))
        x[self._free] = self._solver.solve()
        return x


class NgsolveFactor:
    """Factor on the processor, solved with by NGSolve's device operators: on its GPU, or on its host reference device.

    That is as slow as it is exact: it plays a GPU. Of a complex A = R + iS the factor is that of the real

        [R  S] [ Re x]   [Re b]
        [S -R] [-Im x] = [Im b] ,

    symmetric too, as device operators are real.
    """

    def __init__(self, matrix: ngs.BaseMatrix, free: ngs.BitArray | None) -> None:
        import ngsolve.gpu  # noqa: F401  (chooses the device)

        n = matrix.height
        self._free = np.ones(n, bool) if free is None else np.fromiter(free, bool, n)
        inner = to_scipy(matrix)[self._free][:, self._free]
        self._type = inner.dtype
        if np.iscomplexobj(inner):
            inner = sp.block_array([[inner.real, inner.imag], [inner.imag, -inner.real]])
        real = to_ngsolve(inner)
        self._inverse = ngs.la.DeviceSparseCholeskyD(real.Inverse(inverse="sparsecholesky"))
        self._in, self._out = real.CreateColVector(), real.CreateRowVector()

    def solve(self, b: Array) -> Array:
        """A⁻¹b."""
        x, inner = np.zeros(len(self._free), self._type), np.asarray(b[self._free], self._type)
        parts = [inner.real, inner.imag] if np.iscomplexobj(x) else [inner]
        self._in.FV().NumPy()[:] = np.concatenate(parts)
        self._out.data = self._inverse * self._in
        found = np.split(np.array(self._out.FV().NumPy()), len(parts))
        x[self._free] = found[0] - 1j * found[1] if len(parts) == 2 else found[0]
        return x


def _try(device: Device) -> None:
    matrix = ngs.la.SparseMatrixd.CreateFromCOO([0, 0, 1, 1], [0, 1, 0, 1], [2.0, 1.0, 1.0, 3.0], 2, 2)
    try:
        x = device.make(matrix, None).solve(np.array([4.0, 7.0]))
    except MissingExtra:
        raise
    except Exception as error:  # no driver, no device, another version of a library: each has its own
        found = f"{error}"
    else:
        found = "" if np.allclose(x, [1, 2]) else f"2 x 2 unknowns come out as {x}"
        if device.name == "ngsolve" and ngs.gpu.backend == "host":
            found = "it has none, and its reference device only plays one"
    if found:
        by = {"cuda": "cuDSS", "ngsolve": "NGSolve"}[device.name]
        raise InputError("device", repr(device.name), f"a GPU that {by} solves on ({found}), or 'cpu'")


CPU = Device("cpu", partial(CpuFactor, kind="sparsecholesky"))
PIVOTED = Device("cpu, with pivots", partial(CpuFactor, kind="umfpack"))
"""Where a factor that chooses no pivots, or few, leaves too much."""
CROSSING = 21_000
"""Complex unknowns from which on a GPU (H200) factorises and solves waves faster than 16 threads: `benchmarks/gpu.py`."""
AUTO = Device("auto", CPU.make)
DEVICES = {"auto": AUTO, "cpu": CPU, "cuda": Device("cuda", CudssFactor), "ngsolve": Device("ngsolve", NgsolveFactor)}
