"""Factorisation and solution of symmetric systems on the CPU (NGSolve) or on a GPU (cuDSS, or NGSolve with CPU factors).

    A = L D Lᵀ,   x = A⁻¹ b        (free degrees of freedom; A real or complex symmetric, not Hermitian)

NGSolve's own cuDSS inverse treats a matrix as symmetric only if it is so to the last bit, which assembled ones are not, and then
takes twice the work; here the caller says whether it is symmetric.

References
----------
nvmath-python, nvmath.sparse.advanced.DirectSolver, https://docs.nvidia.com/cuda/nvmath-python.
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
import scipy.sparse.linalg as sla

from ngbrain.errors import InputError, MissingExtra, SolverError, nearest, require
from ngbrain.solvers.matrices import to_ngsolve, to_scipy

Array = np.ndarray


class Factor(Protocol):
    """Factorisation of one matrix. For a symmetric one `solve` serves the transposed system too."""

    def solve(self, b: Array) -> Array:
        """Solution x of Ax = b on the free degrees of freedom, zero on the others."""


@dataclass(frozen=True)
class Device:
    """Where matrices are factorised.

    Parameters
    ----------
    name : str
        Name, as for `--device`.
    make : callable
        Matrix and free degrees of freedom (None: all) → `Factor`.

    Examples
    --------
    >>> matrix = ngs.la.SparseMatrixd.CreateFromCOO([0, 1], [0, 1], [2.0, 4.0], 2, 2)
    >>> Device.from_name("cpu").factor(matrix).solve(np.array([1.0, 1.0])).tolist()
    [0.5, 0.25]
    """

    name: str
    make: Callable[[ngs.BaseMatrix, ngs.BitArray | None], Factor]

    def for_unknowns(self, unknowns: int) -> tuple[Device, str]:
        """The device for a system of a given size, and a note where "auto" has chosen it.

        "auto" is the CPU below the size from which a GPU was measured to be faster (`CROSSING`, by `benchmarks/gpu.py`),
        and above it the GPU if cuDSS finds one.

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
        """The device of a name; "cuda" and "ngsolve" are tested on two unknowns first.

        Raises `InputError` for another name or where no GPU answers, `MissingExtra` without nvmath-python.
        """
        if name not in DEVICES:
            raise InputError("device", repr(name), nearest(name, DEVICES))
        device = DEVICES[name]
        if device not in (CPU, AUTO):
            _try(device)
        return device

    def factor(self, matrix: ngs.BaseMatrix, free: ngs.BitArray | None = None, what: str = "the matrix") -> Factor:
        """Factorise a matrix.

        A singular matrix is not always detected: check residuals.

        Parameters
        ----------
        matrix : BaseMatrix
            Symmetric matrix.
        free : BitArray, optional
            Free degrees of freedom; None: all.
        what : str
            Name of the matrix, for messages.

        Returns
        -------
        Factor

        Raises
        ------
        SolverError
            Where the factorisation fails.
        """
        try:
            return self.make(matrix, free)
        except Exception as error:  # NGSolve and nvmath raise bare exceptions of several kinds here
            raise SolverError(f"{what} cannot be factorised: {error}") from error

    def factor_in_order(
        self, matrix: sp.csr_array, order: Array, pivot: float = 0.0, what: str = "the matrix"
    ) -> Factor:
        """Factorise a symmetric SciPy matrix, on the CPU in a given order of elimination.

        A GPU's library orders by itself.

        Parameters
        ----------
        matrix : csr_array (n, n)
            Real symmetric matrix.
        order : array of int (n,)
            The unknowns in the order of their elimination, see `nested_dissection`.
        pivot : float
            As for `OrderedFactor`.
        what : str
            Name of the matrix, for messages.

        Returns
        -------
        Factor

        Raises
        ------
        SolverError
            Where the factorisation fails.
        """
        if self.name not in (CPU.name, AUTO.name):
            return self.factor(to_ngsolve(matrix), what=what)
        try:
            return OrderedFactor(matrix, order, pivot)
        except (RuntimeError, MemoryError) as error:  # SuperLU's
            raise SolverError(f"{what} cannot be factorised: {error}") from error


class OrderedFactor:
    """Factorisation on the CPU by SciPy's SuperLU in a given order of elimination.

    Parameters
    ----------
    matrix : csr_array (n, n)
        The matrix.
    order : array of int (n,)
        The unknowns in the order of their elimination.
    pivot : float
        A diagonal entry of less than this share of its column's largest is no pivot. 0: no other pivots, for symmetric
        quasi-definite matrices, which need none in any order (Vanderbei 1995, 10.1137/0805005).

    Examples
    --------
    >>> OrderedFactor(sp.csr_array([[2.0, 1.0], [1.0, -3.0]]), np.array([1, 0])).solve(np.array([4.0, -5.0])).tolist()
    [1.0, 2.0]
    """

    def __init__(self, matrix: sp.csr_array, order: Array, pivot: float = 0.0) -> None:
        self._order = order
        ordered = sp.csc_array(matrix[order][:, order])
        options = {"SymmetricMode": True, "Equil": False}
        self._factor = sla.splu(ordered, permc_spec="NATURAL", diag_pivot_thresh=pivot, options=options)

    def solve(self, b: Array) -> Array:
        """A⁻¹ b."""
        x = np.empty_like(b)
        x[self._order] = self._factor.solve(b[self._order])
        return x


class CpuFactor:
    """Factorisation on the CPU by NGSolve.

    Parameters
    ----------
    matrix : BaseMatrix
        The matrix.
    free : BitArray or None
        Free degrees of freedom; None: all.
    kind : str
        NGSolve's name of the inverse.
    """

    def __init__(self, matrix: ngs.BaseMatrix, free: ngs.BitArray | None, kind: str) -> None:
        self._inverse = matrix.Inverse(free, inverse=kind)
        self._in, self._out = matrix.CreateColVector(), matrix.CreateRowVector()

    def solve(self, b: Array) -> Array:
        """A⁻¹ b."""
        return self._times(self._inverse, b)

    def solve_transpose(self, b: Array) -> Array:
        """A⁻ᵀ b, for a factorisation with pivoting."""
        return self._times(self._inverse.T, b)

    def _times(self, inverse: ngs.BaseMatrix, b: Array) -> Array:
        self._in.FV().NumPy()[:] = b
        self._out.data = inverse * self._in
        return np.array(self._out.FV().NumPy())


class CudssFactor:
    """Factorisation on the GPU by cuDSS. Right-hand sides and solutions are copied there and back.

    Parameters
    ----------
    matrix : BaseMatrix
        The matrix.
    free : BitArray or None
        Free degrees of freedom; None: all.
    symmetric : bool
        Whether the matrix is symmetric; only its lower triangle is then kept.

    Raises
    ------
    MissingExtra
        Without nvmath-python. Errors of nvmath are passed on.
    """

    def __init__(self, matrix: ngs.BaseMatrix, free: ngs.BitArray | None, symmetric: bool = True) -> None:
        cudss = require("nvmath.sparse.advanced", "gpu")
        from ngsolve.solvers.cudss import make_directsolver_options

        options = make_directsolver_options()  # sets cuDSS's threading library, used for reordering
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
        weakref.finalize(self, self._solver.free).atexit = False  # a process that ends frees everything
        self._solver.plan()
        self._solver.factorize()

    def solve(self, b: Array) -> Array:
        """A⁻¹ b."""
        x = np.zeros(len(self._free), self._type)
        self._solver.reset_operands(b=np.asarray(b[self._free], self._type))
        x[self._free] = self._solver.solve()
        return x


class NgsolveFactor:
    """Factorisation on the CPU, solves by NGSolve's device operators on its GPU or on its host reference device.

    The reference device emulates a GPU, exactly but slowly. Device operators are real, so a complex A = R + iS is
    factorised as the symmetric

        [R  S] [ Re x]   [Re b]
        [S -R] [-Im x] = [Im b] .

    Parameters
    ----------
    matrix : BaseMatrix
        Symmetric matrix.
    free : BitArray or None
        Free degrees of freedom; None: all.
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
        """A⁻¹ b."""
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
    except Exception as error:  # the exception depends on the cause: no driver, no device, another library version
        found = f"{error}"
    else:
        found = "" if np.allclose(x, [1, 2]) else f"2 x 2 unknowns come out as {x}"
        if device.name == "ngsolve" and ngs.gpu.backend == "host":
            found = "there is none; the reference device only emulates one"
    if found:
        by = {"cuda": "cuDSS", "ngsolve": "NGSolve"}[device.name]
        raise InputError("device", repr(device.name), f"a GPU that {by} solves on ({found}), or 'cpu'")


CPU = Device("cpu", partial(CpuFactor, kind="sparsecholesky"))
PIVOTED = Device("cpu, with pivots", partial(CpuFactor, kind="umfpack"))
"""For matrices whose factorisation without pivoting is not accurate enough."""
CROSSING = 21_000
"""Complex unknowns from which a GPU (H200) is faster than 16 CPU threads for waves, measured by `benchmarks/gpu.py`."""
AUTO = Device("auto", CPU.make)
DEVICES = {"auto": AUTO, "cpu": CPU, "cuda": Device("cuda", CudssFactor), "ngsolve": Device("ngsolve", NgsolveFactor)}
