"""Files that are whole or not there."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path


def whole(path: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a name beside the place (of the same suffix), then rename: a reader never sees half a file.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     whole(Path(folder) / "note.txt", lambda part: part.write_text("all of it"))
    ...     [path.name for path in Path(folder).iterdir()]
    ['note.txt']
    """
    part = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
    try:
        write(part)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
