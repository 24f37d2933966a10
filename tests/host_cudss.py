"""nvmath-python's direct solver as far as it is called here, on the host: the same calls in the same order, or the same errors.

As in nvmath 1.0: operands are copied, matrices are CSR of a type that the right-hand side has too, of a symmetric one no more is
read than the half that is named, phases follow one another, right-hand sides that come later are like the first, and nothing
works once it is freed.
"""

import enum
import sys
import types
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu


class DirectSolverMatrixType(enum.IntEnum):
    GENERAL = 0
    SYMMETRIC = 1


class DirectSolverMatrixViewType(enum.IntEnum):
    FULL = 0
    LOWER = 2


@dataclass
class DirectSolverOptions:
    sparse_system_type: int = DirectSolverMatrixType.GENERAL
    sparse_system_view: int = DirectSolverMatrixViewType.FULL
    multithreading_lib: str | None = None


class DirectSolver:
    """Of `made` that were made, `live` are not freed; without a `gpu` none is made."""

    gpu, made, live, solves = True, [], 0, 0

    def __init__(self, a, b, *, options):
        if not self.gpu:
            raise RuntimeError("CUDA_ERROR_NO_DEVICE")
        if not sp.issparse(a) or a.format != "csr" or a.shape[0] != a.shape[1]:
            raise TypeError("The LHS must be a CSR matrix of shape (N, N)")
        if a.dtype not in (np.float64, np.complex128) or a.dtype != b.dtype:
            raise TypeError(f"The LHS dtype {a.dtype} does not match the RHS dtype {b.dtype}.")
        if a.indices.dtype != a.indptr.dtype or b.shape != a.shape[:1]:
            raise TypeError("The indices, or the RHS, do not match.")
        self.options, self._a, self._b = options, a.copy(), b.copy()
        self._planned, self._factor, self._free = False, None, False
        type(self).live += 1
        self.made.append(options.sparse_system_type)

    def plan(self):
        self._check(True)
        self._planned = True

    def factorize(self):
        self._check(self._planned)
        a = self._a
        if self.options.sparse_system_type == DirectSolverMatrixType.SYMMETRIC:
            lower = sp.tril(a if self.options.sparse_system_view == DirectSolverMatrixViewType.LOWER else a.T)
            a = lower + sp.tril(lower, -1).T
        self._factor = splu(sp.csc_array(a))

    def reset_operands(self, *, b):
        self._check(True)
        if (b.shape, b.dtype, b.strides) != (self._b.shape, self._b.dtype, self._b.strides):
            raise TypeError("The shape, dtype or strides of 'b' don't match the original ones.")
        self._b = b.copy()

    def solve(self):
        self._check(self._factor is not None)
        type(self).solves += 1
        return self._factor.solve(self._b)

    def free(self):
        if not self._free:
            self._free, self._factor = True, None
            type(self).live -= 1

    def _check(self, ready):
        if self._free or not ready:
            raise RuntimeError("a phase before those that it needs, or after free()")


def install(monkeypatch):
    """Let `import nvmath.sparse.advanced` find it; returns the solver's class, counting from nothing."""
    names = ("nvmath", "nvmath.sparse", "nvmath.sparse.advanced")
    modules = {name: types.ModuleType(name) for name in names}
    modules["nvmath"].sparse, modules["nvmath.sparse"].advanced = modules[names[1]], modules[names[2]]

    class Counted(DirectSolver):
        made, live, solves = [], 0, 0

    for kind in (Counted, DirectSolverMatrixType, DirectSolverMatrixViewType, DirectSolverOptions):
        setattr(modules[names[2]], "DirectSolver" if kind is Counted else kind.__name__, kind)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    return Counted
