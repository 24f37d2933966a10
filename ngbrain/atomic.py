"""Files that are whole or not there."""

from __future__ import annotations

import glob
import os
import secrets
from collections.abc import Callable
from pathlib import Path


def atomic_write(path: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a name beside the place (of the same suffix), then rename: a reader never sees half a file.

    The name is another one each time, so that several processes and threads may write the same file; the last one's stays. What
    processes that were killed have left of it is cleared away.

    Parameters
    ----------
    path : Path
        Where the file is to be.
    write : callable
        Writes all of it to the path that it is given; whatever it raises is passed on, and nothing is left.

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
        with open(part, "r+b") as stream:  # a disk may be found full only now
            os.fsync(stream.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    for left in path.parent.glob(f".{glob.escape(stem)}.[0-9]*.tmp{glob.escape(dot + suffixes)}"):
        number = left.name.removeprefix(f".{stem}.").partition(".")[0]
        if number.isdigit() and _gone(int(number)):
            left.unlink(missing_ok=True)


def _gone(process: int) -> bool:
    if os.name == "nt":  # no such question there: signal 0 would end the process
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (PermissionError, OverflowError):
        pass
    return False
