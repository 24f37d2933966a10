"""Atomic file writes: a file is complete, or it is not there."""

from __future__ import annotations

import glob
import os
import secrets
from collections.abc import Callable
from pathlib import Path


def atomic_write(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file under a temporary name beside its final path, then rename it: a reader never sees half a file.

    The temporary name (with the same suffix) is unique, so that several processes and threads may write the same file; the last
    one wins. Temporary files of killed processes are removed.

    Parameters
    ----------
    path : Path
        Path of the file.
    write : callable
        Writes the whole file to the path that it is given. Its exceptions are passed on, and no file is left.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     atomic_write(Path(folder) / "note.txt", lambda part: part.write_text("all of it"))
    ...     [path.name for path in Path(folder).iterdir()]
    ['note.txt']
    """
    stem, dot, suffixes = path.name.partition(".")
    part = path.with_name(f".{stem}.{os.getpid()}.{secrets.token_hex(4)}.tmp{dot}{suffixes}")
    try:
        write(part)
        with open(part, "r+b") as stream:  # some file systems report a full disk only here
            os.fsync(stream.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    for left in path.parent.glob(f".{glob.escape(stem)}.[0-9]*.tmp{glob.escape(dot + suffixes)}"):
        number = left.name.removeprefix(f".{stem}.").partition(".")[0]
        if number.isdigit() and _gone(int(number)):
            left.unlink(missing_ok=True)


def _gone(process: int) -> bool:
    if os.name == "nt":  # on Windows, signal 0 would end the process
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (PermissionError, OverflowError):
        pass
    return False
