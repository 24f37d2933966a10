"""Files that are whole or not there."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable
from pathlib import Path


def whole(path: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a name beside the place (of the same suffix), then rename: a reader never sees half a file.

    The name is another one each time, so that several processes and threads may write the same file; the last one's stays.

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
    ...     whole(Path(folder) / "note.txt", lambda part: part.write_text("all of it"))
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
