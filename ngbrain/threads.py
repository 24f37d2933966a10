"""Number of threads, set at run time."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import ngsolve as ngs

_SETTERS = (
    "openblas_set_num_threads",
    "openblas_set_num_threads64_",
    "scipy_openblas_set_num_threads",
    "scipy_openblas_set_num_threads64_",
)


def set_threads(n: int) -> None:
    """Use `n` threads in NGSolve's task manager and one in every OpenBLAS library, also after NumPy is loaded.

    Threads of OpenBLAS inside threads of the assembly would compete for the cores. Loaded libraries are found in the process
    map, which only Linux has; on other systems set OPENBLAS_NUM_THREADS=1.

    >>> set_threads(1)
    """
    ngs.SetNumThreads(max(1, int(n)))
    maps = Path("/proc/self/maps")
    if not maps.exists():
        return
    paths = {line.split(maxsplit=5)[5] for line in maps.read_text().splitlines() if "openblas" in line.lower()}
    for path in paths:
        try:
            library = ctypes.CDLL(path)
        except OSError:  # a file deleted since it was mapped
            continue
        for name in _SETTERS:
            if hasattr(library, name):
                getattr(library, name)(1)


@contextmanager
def threads(n: int | None) -> Iterator[None]:
    """Context manager: use `n` threads inside, within NGSolve's task manager if n > 1; None changes nothing."""
    if n is None:
        yield
        return
    before = ngs.ngsglobals.numthreads
    set_threads(n)
    try:
        with ngs.TaskManager() if n > 1 else nullcontext():
            yield
    finally:
        set_threads(before)
