"""Store of finished task results on disk, keyed by a digest of all their inputs."""

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
    """Folder of results that `ngbrain.parallel.run` loads instead of computing them, in this run or the next.

    The file name is a digest of the function, the source of all modules of ngbrain that its module imports, versions, and the
    arguments: numbers, text, arrays, paths, sequences, mappings and dataclasses of these. A result is whatever `save_state`
    accepts (no pickles). Damaged files are computed again.

    Parameters
    ----------
    folder : str or Path
        Created if it does not exist.

    Raises
    ------
    InputError
        The path is a file.

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
        """Unique key of a call.

        Parameters
        ----------
        function : callable
            The function.
        args : tuple
            Its arguments.

        Returns
        -------
        str

        Raises
        ------
        InputError
            An argument has a type that cannot be digested.
        """
        digest = hashlib.sha256(f"{function.__module__}.{function.__qualname__}\n".encode())
        digest.update(code_digest((function.__module__,)).encode())
        _feed(digest, args, f"what {function.__qualname__} is called with")
        return digest.hexdigest()[:32]

    def find(self, key: str) -> Any:
        """Look up a result; `KeyError` if there is none."""
        path = self.folder / f"{key}.npz"
        try:
            return load_state(path)
        except InputError as error:
            raise KeyError(key) from error

    def keep(self, key: str, result: Any) -> None:
        """Store a result atomically.

        Parameters
        ----------
        key : str
            Key of the call.
        result : object
            Its result.
        """
        save_state(self.folder / f"{key}.npz", result)


def _feed(digest: Any, value: Any, name: str) -> None:
    """Digest a value with its type and size in front, so that no two values give the same bytes."""
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
        wanted = "numbers, text, arrays, paths, sequences, mappings and dataclasses, which identify finished work"
        raise InputError(name, f"a {type(value).__name__}", wanted)
