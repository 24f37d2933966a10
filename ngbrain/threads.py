"""Number of threads, set at run time."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import ngsolve as ngs

_CALLS = (
    "openblas_{}_num_threads",
    "openblas_{}_num_threads64_",
    "scipy_openblas_{}_num_threads",
    "scipy_openblas_{}_num_threads64_",
)


def set_threads(n: int) -> None:
    """Use `n` threads in NGSolve's task manager and one in every OpenBLAS library, also after NumPy is loaded.

    Threads of OpenBLAS inside threads of the assembly would compete for the cores. Loaded libraries are found in the process
    map, which only Linux has; on other systems set OPENBLAS_NUM_THREADS=1.

    >>> set_threads(1)
    """
    ngs.SetNumThreads(max(1, int(n)))
    for library in _libraries().values():
        for name in _CALLS:
            if hasattr(library, name.format("set")):
                getattr(library, name.format("set"))(1)


def ngsolve_threads() -> int:
    """Number of threads of NGSolve's task manager."""
    return int(ngs.ngsglobals.numthreads)


def openblas_threads() -> dict[str, int]:
    """Number of threads of every OpenBLAS library in this process, by file name; empty where these cannot be found.

    >>> all(count >= 1 for count in openblas_threads().values())
    True
    """
    found = {}
    for path, library in _libraries().items():
        for name in _CALLS:
            if hasattr(library, name.format("get")):
                found[Path(path).name] = int(getattr(library, name.format("get"))())
    return found


def _libraries() -> dict[str, ctypes.CDLL]:
    """OpenBLAS libraries in the process map, by path."""
    maps = Path("/proc/self/maps")
    if not maps.exists():
        return {}
    lines = (line.split(maxsplit=5) for line in maps.read_text().splitlines() if "openblas" in line.lower())
    found = {}
    for path in sorted({parts[5] for parts in lines if len(parts) > 5}):
        try:
            found[path] = ctypes.CDLL(path)
        except OSError:  # a file deleted since it was mapped
            continue
    return found


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
