"""Disk cache of intermediate results, keyed by a digest of their inputs and of the code that computes them."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError
from ngbrain.io.versions import versions
from ngbrain.lazy import definitions
from ngbrain.reading import read_npz

Arrays = dict[str, np.ndarray]

PACKAGE = "ngbrain"
_DIGEST = "sha256 of the rest"
"""Name of the array with the checksum of the others."""
_MOST = 2**34
"""Maximum size (bytes) of an entry."""


def cache_folder() -> Path:
    """Folder of the cache: $NGBRAIN_CACHE, or `ngbrain` in $XDG_CACHE_HOME, or `~/.cache/ngbrain`. Its files may be deleted at any
    time.
    """
    if own := os.environ.get("NGBRAIN_CACHE"):
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ngbrain"


def load_or_compute(stage: str, made_from: Any, modules: Iterable[ModuleType], make: Callable[[], Arrays]) -> Arrays:
    """Load arrays from the cache, or compute and store them; a damaged or modified file is computed again.

    The file name depends on the source of every module of this package that the module of `make` imports, directly or
    indirectly (`source_files`), and on the versions of all numerical packages.

    Parameters
    ----------
    stage : str
        Name of the stage, part of the file name.
    made_from : object
        All other inputs of the result, JSON-compatible.
    modules : iterable of module
        Further modules that `make` uses without importing them.
    make : callable
        Computes the arrays, by name.

    Returns
    -------
    dict of numpy.ndarray
        Arrays by name.
    """
    digest = hashlib.sha256(json.dumps([stage, made_from, versions()], sort_keys=True).encode())
    _feed_sources(digest, (make.__module__, *(module.__name__ for module in modules)))
    path = cache_folder() / f"{stage}-{digest.hexdigest()[:32]}.npz"
    with suppress(InputError, KeyError):
        found = read_npz(path, "cache", _MOST)
        if str(found.pop(_DIGEST)) == _sum(found):
            return found
    arrays = make()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        named: dict[str, Any] = {**arrays, _DIGEST: np.array(_sum(arrays))}
        atomic_write(path, lambda part: np.savez(part, **named))
    except OSError:  # disk full or no write permission: computed again next time
        pass
    return arrays


@cache
def code_digest(names: tuple[str, ...]) -> str:
    """Digest of the source of modules, of all modules of this package that they import, and of the numerical packages."""
    digest = hashlib.sha256(json.dumps(versions(), sort_keys=True).encode())
    _feed_sources(digest, names)
    return digest.hexdigest()


def _feed_sources(digest: Any, names: tuple[str, ...]) -> None:
    for path in source_files(names):
        digest.update(path.read_bytes())


def source_files(names: Iterable[str]) -> list[Path]:
    """Source files of modules and of all modules of this package that they import, directly or indirectly, in order.

    >>> [path.name for path in source_files(["ngbrain.mesh.geometry.cleft"])]
    ['atomic.py', 'errors.py', 'cleft.py', 'result.py']
    """
    found, waiting = set[str](), list(names)
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += _imports_of(name)
    return [path for name in sorted(found) if (path := _file(name)) is not None]


@cache
def _imports_of(name: str) -> frozenset[str]:
    path = _file(name)
    if path is None:
        return frozenset()
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    return frozenset(_imports(ast.parse(path.read_bytes()), package))


def _imports(tree: ast.Module, package: str) -> Iterator[str]:
    """Modules of this package in the import statements that a module executes, also inside functions."""
    for node in _executed(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if _is_internal(alias.name))
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package.split(".")[: 1 - node.level or None]) if node.level else ""
            base = ".".join(filter(None, (base, node.module)))
            if not _is_internal(base):
                continue
            for alias in node.names:
                part = f"{base}.{alias.name}"
                yield part if _file(part) is not None else _home(base, alias.name)


def _executed(tree: ast.Module) -> Iterator[ast.AST]:
    """Nodes of a module without those that only type checkers read."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
        else:
            waiting += ast.iter_child_nodes(node)


def _home(module: str, name: str) -> str:
    """Module in which a name is defined that a package imports on first use; otherwise the given one."""
    path = _file(module)
    if path is None or path.name != "__init__.py":
        return module
    return definitions(module).get(name, (module, name))[0]


def _is_internal(name: str) -> bool:
    return name.partition(".")[0] == PACKAGE


def _file(name: str) -> Path | None:
    """Source file of an imported module, or of a module of this package."""
    if name in sys.modules:
        own = getattr(sys.modules[name], "__file__", None)
        return Path(own) if own and own.endswith(".py") else None
    return _find_source(name) if _is_internal(name) else None


@cache
def _find_source(name: str) -> Path | None:
    try:
        spec = find_spec(name)
    except ModuleNotFoundError:  # its apparent package is a module
        return None
    return Path(spec.origin) if spec and spec.origin and spec.origin.endswith(".py") else None


def _sum(arrays: Arrays) -> str:
    total = hashlib.sha256()
    for name in sorted(arrays):
        values = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {values.dtype.str} {np.shape(arrays[name])}\n".encode())
        total.update(values.tobytes())
    return total.hexdigest()
