"""What an installation has, lacks and does slowly; nothing here needs a package that may be missing or broken."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from ngbrain.io.versions import FOR_DEVELOPERS, find_version, is_older, platform_rows, requirements

OK, OPTIONAL, SLOW, BROKEN = "ok", "optional", "slow", "broken"
"""States of a finding: fine; an extra that is not there; works slowly or will; does not work."""
CORE_MODULES = {"netgen-mesher": "netgen"}
"""Package → its module, where that has another name."""
PURPOSES = {
    "mri": "scans: NIfTI, MGH, DICOM, labelling",
    "report": "reports and plots; the commands need it",
    "surrogate": "`predict`, and its maps as a start of `invert`",
    "progress": "a bar for long work",
    "viz": "meshes and pictures in a notebook",
    "xarray": "arrays with named axes, of `to_xarray`",
    "completion": "completion of commands in a shell",
    "deepbet": "another program for brain extraction",
    "robex": "another program for brain extraction",
    "train": "training the operators of `predict` anew",
    "interop": "models as functions of PyTorch, JAX or UM-Bridge",
    "mumps": "another direct solver",
    "pardiso": "another direct solver",
    "cluster": "tasks on a Dask cluster or as jobs of Slurm",
    "mpi": "tasks as ranks of an MPI job",
    "gpu": "factorisation on an NVIDIA GPU",
}
"""Extra → what it adds."""
LIMITS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
CELLS = 8
"""Cells along an edge of the cube that is factorised: 14 739 unknowns."""
LONG, SHARE = 5.0, 0.6
"""Processor time (s) of that factorisation from which it is slow, and the part of the elapsed time below which others use it."""
MEGABYTES, LEAST_RATE = 32, 20.0
"""Size of the file that is written to the cache (MB), and the rate (MB/s) below which the disk is slow."""
LEAST_MEMORY, LEAST_DISK = 4e9, 2e9
"""Bytes below which heads do not fit: a demo takes 2 to 3 GB of memory, a run with its frames some hundred MB of disk."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Parameters
    ----------
    topic : str
        What it belongs to, such as "extras".
    name : str
        What was looked at.
    value : str
        What was found.
    state : str
        `OK`, `OPTIONAL`, `SLOW` or `BROKEN`.
    advice : str
        What helps, a command or a sentence; "" where nothing is needed.
    """

    topic: str
    name: str
    value: str
    state: str = OK
    advice: str = ""


def diagnose(timing: bool = True) -> Iterator[Finding]:
    """Look at packages, threads, memory, disk and display, and measure the solver and the disk.

    Parameters
    ----------
    timing : bool
        Factorise a fixed problem and write a file, which takes some seconds.

    Yields
    ------
    Finding

    Examples
    --------
    >>> [finding.name for finding in diagnose(timing=False) if finding.state == BROKEN]
    []
    """
    yield Finding("system", "python", f"{sys.version.split()[0]} in {sys.prefix}")
    for name, value in platform_rows().items():
        yield Finding("system", name, value)
    works = True
    for finding in _core():
        works &= finding.state != BROKEN
        yield finding
    yield from _extras()
    yield from _threads(works)
    yield from _memory()
    yield from _cache(timing)
    yield from _display()
    if timing and works:
        yield _solver()


def _core() -> Iterator[Finding]:
    """The packages that are always needed: installed, new enough, importable."""
    yield Finding("core", "ngbrain", find_version("ngbrain") or "not installed: run from a folder")
    for package, least in requirements()[""].items():
        found = find_version(package)
        if found is None or is_older(found, least):
            value = f"{found}, older than {least}" if found else "missing"
            yield Finding("core", package, value, BROKEN, f'pip install --upgrade "{package}>={least}"')
            continue
        try:
            import_module(CORE_MODULES.get(package, package))
        except ImportError as error:
            advice = f"pip install --force-reinstall {package}"
            if "libquadmath" in str(error):
                advice = (
                    "apt install libquadmath0 (Debian, Ubuntu), or `make demo`, which links the one that SciPy brings"
                )
            yield Finding(
                "core", package, f"{found}, cannot be imported: {' '.join(str(error).split())}", BROKEN, advice
            )
        else:
            yield Finding("core", package, found)


def _extras() -> Iterator[Finding]:
    """Each extra for users: versions, or what is missing."""
    for extra, packages in requirements().items():
        if not extra or extra in FOR_DEVELOPERS:
            continue
        have = {name: find_version(name) for name in packages}
        bad = [
            name for name, found in have.items() if not found or (packages[name] and is_older(found, packages[name]))
        ]
        told = ", ".join(f"{name} {found}" if found else f"{name} missing" for name, found in have.items())
        advice = f'pip install "ngbrain[{extra}]"   {PURPOSES.get(extra, "")}' if bad else ""
        yield Finding("extras", extra, told, OPTIONAL if bad else OK, advice)


def _threads(works: bool) -> Iterator[Finding]:
    """Threads of NGSolve and of OpenBLAS beside the cores."""
    cores = int(platform_rows()["cores"])
    given = [f"{name}={os.environ[name]}" for name in LIMITS if name in os.environ]
    yield Finding("threads", "environment", ", ".join(given) or "no limit of threads is set")
    if works:
        threads = import_module("ngbrain.threads")
        import_module("scipy.linalg")
        blas = threads.openblas_threads()
        words = ", ".join(f"{name}: {count}" for name, count in blas.items()) or "not found in this process"
        many = cores > 1 and any(count > 1 for count in blas.values())
        # Commands set one thread themselves; those of OpenBLAS within several processes would compete for the cores.
        advice = "commands use 1; for scripts of your own: export OPENBLAS_NUM_THREADS=1" if many else ""
        yield Finding("threads", "OpenBLAS", words, OK, advice)
        yield Finding("threads", "NGSolve", str(threads.ngsolve_threads()))
    if hasattr(os, "getloadavg"):
        load = os.getloadavg()[0]
        busy = load > cores
        advice = "other programs use the cores: measured times are longer than they need be" if busy else ""
        yield Finding(
            "threads", "load", f"{load:.1f} running on {cores} cores (last minute)", SLOW if busy else OK, advice
        )


def _memory() -> Iterator[Finding]:
    try:
        page = os.sysconf("SC_PAGE_SIZE")
        total = page * os.sysconf("SC_PHYS_PAGES")
        free = page * os.sysconf("SC_AVPHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # not on this system
        return
    try:  # what the kernel would give back of its caches counts too
        lines = Path("/proc/meminfo").read_text().splitlines()
        free = next(1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        pass
    little = free < LEAST_MEMORY
    advice = "larger elements, --threads 1; a head takes 2 to 3 GB for each process" if little else ""
    yield Finding(
        "memory", "memory", f"{free / 1e9:.1f} of {total / 1e9:.1f} GB available", SLOW if little else OK, advice
    )


def _cache(timing: bool) -> Iterator[Finding]:
    """Where meshes and labels are cached, and how fast that disk is."""
    folder = import_module("ngbrain.io.cache").cache_folder()
    files = [path for path in folder.glob("*.npz")] if folder.is_dir() else []
    size = sum(path.stat().st_size for path in files)
    yield Finding(
        "disk", "cache", f"{folder}: {len(files)} files, {size / 1e6:.0f} MB, which may be deleted at any time"
    )
    there = next((each for each in (folder, *folder.parents) if each.exists()), Path())
    for name, place in (("of the cache", there), ("of this folder", Path())):
        free = shutil.disk_usage(place).free
        state, advice = (SLOW, "make room: runs write their steps") if free < LEAST_DISK else (OK, "")
        yield Finding("disk", f"disk {name}", f"{free / 1e9:.1f} GB free", state, advice)
    try:
        rate = _write_rate(there) if timing else None
    except OSError as error:
        advice = "export NGBRAIN_CACHE=DIR, a folder that can be written to: meshes and labels are made anew each time"
        yield Finding("disk", "writing to the cache", str(error.strerror), SLOW, advice)
        return
    if rate is not None:
        slow = rate < LEAST_RATE
        advice = "export NGBRAIN_CACHE=DIR, a folder on a local disk" if slow else ""
        yield Finding("disk", "writing to the cache", f"{rate:.0f} MB/s, measured", SLOW if slow else OK, advice)


def _write_rate(folder: Path) -> float:
    """MB/s of a file that is written, flushed and removed."""
    data = os.urandom(1 << 20)
    with tempfile.TemporaryFile(dir=folder) as file:
        started = time.perf_counter()
        for _ in range(MEGABYTES):
            file.write(data)
        file.flush()
        os.fsync(file.fileno())
        return MEGABYTES * len(data) / 1e6 / max(time.perf_counter() - started, 1e-9)


def _display() -> Iterator[Finding]:
    """Whether pictures that turn can be shown; reports are files, which need nothing here."""
    screen = sys.platform in ("win32", "darwin") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    value = (
        "a screen" if screen else "no screen here: copy report.html to one that has a browser; nothing else needs it"
    )
    yield Finding("display", "screen", value)


def _solver() -> Finding:
    """Time of a fixed factorisation, by the clock and of the processor."""
    import ngsolve as ngs
    from ngsolve.meshes import MakeStructured3DMesh

    mesh = MakeStructured3DMesh(hexes=False, nx=CELLS)
    space = ngs.VectorH1(mesh, order=2, dirichlet="bottom")
    u, v = space.TnT()
    strain = ngs.Grad(u) + ngs.Grad(u).trans
    form = ngs.BilinearForm(space, symmetric=True)
    form += (ngs.InnerProduct(strain, ngs.Grad(v)) + ngs.div(u) * ngs.div(v)) * ngs.dx
    form.Assemble()
    clock, used = time.perf_counter(), time.process_time()
    form.mat.Inverse(space.FreeDofs(), "sparsecholesky")
    clock, used = time.perf_counter() - clock, time.process_time() - used
    words = f"{clock:.1f} s, {used:.1f} s of them on the processor, measured: linear elasticity, {space.ndof} unknowns, one thread"
    waits = used < SHARE * clock
    advice = "other programs use the cores" if waits else ""
    if used > LONG:
        advice = "a slow processor: larger elements, `--quick` and `--fast` first"
    return Finding("speed", "factorisation", words, SLOW if waits or used > LONG else OK, advice)
