"""What takes long to make, kept on disk under the digest of all that it was made from."""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

Arrays = dict[str, np.ndarray]


def cache_folder() -> Path:
    """$NGBRAIN_CACHE, or `ngbrain` in $XDG_CACHE_HOME, or `~/.cache/ngbrain`. Anything in it may be deleted."""
    if own := os.environ.get("NGBRAIN_CACHE"):
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ngbrain"


def kept(stage: str, made_from: Any, modules: Iterable[ModuleType], make: Callable[[], Arrays]) -> Arrays:
    """The arrays that `make` gives, from the cache if they were made before; a damaged file is made again.

    stage       its name, part of the file's
    made_from   everything that decides the result, fit for JSON
    modules     whose source decides it too
    """
    digest = hashlib.sha256(json.dumps([stage, made_from], sort_keys=True).encode())
    for module in modules:
        digest.update(Path(str(module.__file__)).read_bytes())
    path = cache_folder() / f"{stage}-{digest.hexdigest()[:32]}.npz"
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}  # the archive checks its sums as it is read
    except (OSError, ValueError, EOFError, TypeError, RuntimeError, zipfile.BadZipFile):
        arrays = make()
    part = path.with_name(f".{path.stem}.{os.getpid()}.tmp.npz")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(part, **arrays)  # type: ignore[arg-type]
        os.replace(part, path)
    except OSError:  # no room or no right to write: made again next time
        with suppress(OSError):
            part.unlink()
    return arrays
