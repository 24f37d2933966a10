"""Finished work on disk: results of tasks under the digest of all that they are made from."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import InputError
from ngbrain.io.cache import code_digest
from ngbrain.io.state import load_state, save_state


class FinishedWork:
    """A folder of results that `ngbrain.parallel.run` finds there instead of computing them, in this run or the next.

    The name of a file is the digest of the function, the source of all that its module imports of ngbrain, versions, and the
    arguments: numbers, text, arrays, paths, sequences, mappings and dataclasses of these. A result is whatever `save_state` takes
    (no pickles). Files that are damaged are computed again.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there.

    Examples
    --------
    >>> import math, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     work = FinishedWork(folder)
    ...     key = work.key(math.sqrt, (2.0,))
    ...     work.keep(key, math.sqrt(2.0))
    ...     work.find(key)
    1.4142135623730951
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError("folder of finished work", str(folder), "a folder, or a name that is free")
        self.folder.mkdir(parents=True, exist_ok=True)

    def key(self, function: Callable[..., Any], args: tuple[Any, ...]) -> str:
        """Tells a call from every other."""
        digest = hashlib.sha256(f"{function.__module__}.{function.__qualname__}\n".encode())
        digest.update(code_digest((function.__module__,)).encode())
        _feed(digest, args, f"what {function.__qualname__} is called with")
        return digest.hexdigest()[:32]

    def find(self, key: str) -> Any:
        """The result; `KeyError` where there is none."""
        path = self.folder / f"{key}.npz"
        try:
            return load_state(path)
        except InputError as error:
            raise KeyError(key) from error

    def keep(self, key: str, result: Any) -> None:
        """Keep a result, whole or not at all."""
        save_state(self.folder / f"{key}.npz", result)


def _feed(digest: Any, value: Any, name: str) -> None:
    """Every value with its kind and size in front, so that no two feed the same bytes."""
    if value is None or isinstance(value, (bool, int, float, complex, str, Enum, np.generic)):
        text = f"{value!r}" if not isinstance(value, np.generic) else f"{value.dtype.str} {value.tobytes().hex()}"
        digest.update(f"{type(value).__name__} {len(text)} {text}\n".encode())
    elif isinstance(value, Path):
        _feed(digest, str(value), name)
    elif isinstance(value, bytes):
        digest.update(f"bytes {len(value)}\n".encode() + value)
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        digest.update(f"array {value.dtype.str} {value.shape}\n".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, (list, tuple, range)):
        digest.update(f"{type(value).__name__} {len(value)}\n".encode())
        for i, item in enumerate(value):
            _feed(digest, item, f"{name}[{i}]")
    elif isinstance(value, Mapping):
        digest.update(f"mapping {len(value)}\n".encode())
        for key in sorted(value, key=lambda key: json.dumps(str(key))):
            _feed(digest, key, name)
            _feed(digest, value[key], f"{name}[{key!r}]")
    elif is_dataclass(value) and not isinstance(value, type):
        digest.update(f"{type(value).__module__}.{type(value).__qualname__}\n".encode())
        for field in fields(value):
            _feed(digest, getattr(value, field.name), f"{name}.{field.name}")
    elif callable(value) and hasattr(value, "__qualname__"):
        _feed(digest, f"{value.__module__}.{value.__qualname__}", name)
    else:
        wanted = "numbers, text, arrays, paths, sequences, mappings and dataclasses, to tell finished work by"
        raise InputError(name, f"a {type(value).__name__}", wanted)
