"""Safe reading of HDF5 files: damaged files are read in a subprocess first, and references to other files are refused."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ngbrain.errors import InputError
from ngbrain.reading.files import MOST, check_regular, check_size

if TYPE_CHECKING:
    import h5py

MOST_OBJECTS = 10_000
"""Maximum number of groups and arrays of an HDF5 file."""
PATIENCE = 20
"""CPU time (s) within which a library must read a file that may be damaged."""
_TRIED = set[tuple[str | int, ...]]()
"""Files (path, reader, inode, size, time) that a subprocess has read, or refused, without a crash."""
_TRIAL = """import sys
sys.path[:] = sys.argv[2:]
from ngbrain.reading.hdf5 import _begin
_begin()
from {0} import {1}
{1}(sys.argv[1])
"""


@contextmanager
def hdf5(path: str | os.PathLike[str], what: str, most: int = MOST, whole: bool = False) -> Iterator[h5py.File]:
    """Open an HDF5 file for reading; all its data must be in the file itself.

    Parameters
    ----------
    path : str or Path
        The file.
    what : str
        Name of the content, for messages.
    most : int, optional
        Maximum size (bytes), of the file and of its unpacked arrays.
    whole : bool, optional
        Whether the file is known to be undamaged. Otherwise it is first read in a subprocess, because libhdf5 may crash or hang
        on a damaged file.

    Yields
    ------
    h5py.File

    Raises
    ------
    InputError
        `read_bytes` refuses the file; it is damaged, too large, or refers to other files.
    """
    import h5py

    path = Path(path)
    check_regular(path, what, most)
    if not whole:
        check_in_subprocess(path, what, __name__, "_read_hdf5")
    try:
        file = h5py.File(path, "r")
    except (OSError, RuntimeError) as error:
        raise InputError(what, f"unreadable ({error})", "a whole HDF5 file", path) from error
    with file:
        check_contained(file, what, path, most)
        yield file


def check_contained(file: h5py.File, what: str, path: Path, most: int = MOST) -> None:
    """Check that an open HDF5 file refers to no other file and is not too large.

    Parameters
    ----------
    file : h5py.File
        The open file.
    what : str
        Name of the content, for messages.
    path : Path
        Its path, for messages.
    most : int, optional
        Maximum size (bytes) of its unpacked arrays.

    Raises
    ------
    InputError
        Data are in other files, too large, or in too many objects.
    """
    import h5py

    waiting: list[h5py.Group] = [file]
    seen, size = set[int](), 0
    while waiting:
        group = waiting.pop()
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise InputError(f"{what} {name}", f"in another file ({link.filename})", "data in this file", path)
            item = None if isinstance(link, h5py.SoftLink) else group.get(name)
            if item is None or (number := h5py.h5o.get_info(item.id).addr) in seen:
                continue
            seen.add(number)
            if len(seen) > MOST_OBJECTS:
                raise InputError(what, "full of groups and arrays", f"at most {MOST_OBJECTS} of them", path)
            if isinstance(item, h5py.Group):
                waiting.append(item)
            elif isinstance(item, h5py.Dataset):
                if item.external or item.is_virtual:
                    raise InputError(f"{what} {name}", "in another file", "data in this file", path)
                size += item.size * item.dtype.itemsize if item.size else 0
                check_size(size, what, most, path, "one that unpacks to")


def check_in_subprocess(path: Path, what: str, module: str, function: str) -> None:
    """Read a file in a subprocess first, where a crash or an endless loop of a library does no harm; once for a file as it is.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        Name of the content, for messages.
    module, function : str
        Module and name of the function that reads the file. Its own exceptions are ignored here; they are raised again when the
        file is read.

    Raises
    ------
    InputError
        The process crashed or took more than `PATIENCE` seconds of CPU time.
    """
    status = path.stat()
    version = (str(path.resolve()), function, status.st_ino, status.st_size, status.st_mtime_ns)
    if version in _TRIED:
        return
    command = [sys.executable, "-c", _TRIAL.format(module, function), str(path), *map(str, sys.path)]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=30 * PATIENCE)
    except (subprocess.TimeoutExpired, OSError, ValueError) as error:
        raise InputError(what, f"unreadable ({type(error).__name__})", "a whole file", path) from error
    if done.returncode not in (0, 1):
        raise InputError(what, "damaged: its library crashes or hangs on it", "a whole file", path)
    _TRIED.add(version)


def _begin() -> None:
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except ImportError:  # Windows has no such limits
        pass


def _read_hdf5(name: str) -> None:
    import h5py

    with h5py.File(name, "r") as file:
        check_contained(file, "data", Path(name))
        file.visititems(lambda _, item: item[()] is None if isinstance(item, h5py.Dataset) else None)
