"""What workers elsewhere do: compute a task, and say what they compute with, so that another version is refused at once."""

from __future__ import annotations

import hashlib
import socket
from collections.abc import Callable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ngbrain.errors import InputError
from ngbrain.parallel.tasks import picklable_error
from ngbrain.threads import threads

_PACKAGES = ("ngbrain", "ngsolve", "netgen-mesher", "numpy", "scipy")
_SOURCE = "source of ngbrain"


@cache
def identity() -> dict[str, str]:
    """Versions of this process, and a digest of every source file of ngbrain."""
    found = dict[str, str]()
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    digest = hashlib.sha256()
    spec = find_spec("ngbrain")
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        for path in sorted(Path(folder).rglob("*.py")):
            digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return found | {_SOURCE: digest.hexdigest()[:12]}


def check_identity(worker: str, theirs: dict[str, str] | None) -> None:
    """Raise `OtherVersions` for a worker without ngbrain (None), or one whose versions are not those of this process."""
    ours = identity()
    if theirs is None:
        wanted = f"ngbrain {ours['ngbrain']} and ngsolve {ours['ngsolve']} there, as here"
        raise OtherVersions(f"worker {worker}", "without ngbrain", wanted)
    if theirs != ours:
        raise mismatch(worker, theirs, ours)


class OtherVersions(InputError):
    """A worker does not compute with what the process that sends it tasks does; no task is of use there."""


def mismatch(worker: str, theirs: dict[str, str], ours: dict[str, str]) -> OtherVersions:
    """The error of a worker whose versions are not those of the process that asks it."""
    differ = [name for name, number in ours.items() if theirs.get(name) != number]
    there, here = (", ".join(f"{name} {of.get(name)}" for name in differ) for of in (theirs, ours))
    return OtherVersions(f"worker {worker}", f"with {there}", f"{here}, as in the process that sends the tasks")


def compute(name: str, function: Callable[..., Any], args: tuple[Any, ...], theirs: dict[str, str]) -> Any:
    """A task, sent by a process of versions `theirs`, on one thread; what it tells is not heard."""
    ours = identity()
    if ours != theirs:
        raise mismatch(socket.gethostname(), ours, theirs)
    with threads(1):
        try:
            return function(*args, callback=lambda *_: 1)
        except Exception as error:
            raise picklable_error(error, name) from None


def call_name(fn: Callable[..., Any], args: tuple[Any, ...]) -> str:
    """What a call is called in messages."""
    return str(args[0]) if fn is compute else getattr(fn, "__name__", "call")
