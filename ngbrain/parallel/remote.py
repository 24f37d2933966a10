"""Work on remote workers: compute a task, and report versions, so that a worker with other versions is refused at once."""

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
    """Versions of this process, and a digest of all source files of ngbrain."""
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
    """Check that a worker has the versions of this process.

    Parameters
    ----------
    worker : str
        Name of the worker, for messages.
    theirs : dict or None
        Its `identity`; None without ngbrain.

    Raises
    ------
    OtherVersions
        The worker has no ngbrain, or other versions.
    """
    ours = identity()
    if theirs is None:
        wanted = f"ngbrain {ours['ngbrain']} and ngsolve {ours['ngsolve']} there, as here"
        raise OtherVersions(f"worker {worker}", "without ngbrain", wanted)
    if theirs != ours:
        raise mismatch(worker, theirs, ours)


class OtherVersions(InputError):
    """A worker has other versions than the process that sends the tasks; no task can run there."""


def mismatch(worker: str, theirs: dict[str, str], ours: dict[str, str]) -> OtherVersions:
    """The error for a worker with other versions.

    Parameters
    ----------
    worker : str
        Name of the worker.
    theirs, ours : dict
        `identity` of the worker and of the process that sends the tasks.

    Returns
    -------
    OtherVersions
    """
    differ = [name for name, number in ours.items() if theirs.get(name) != number]
    there, here = (", ".join(f"{name} {of.get(name)}" for name in differ) for of in (theirs, ours))
    return OtherVersions(f"worker {worker}", f"with {there}", f"{here}, as in the process that sends the tasks")


def compute(name: str, function: Callable[..., Any], args: tuple[Any, ...], theirs: dict[str, str]) -> Any:
    """Compute a task on one thread of a worker; its progress is not reported.

    Parameters
    ----------
    name : str
        Name of the task, for messages.
    function : callable
        Called as `function(*args, callback=...)`.
    args : tuple
        Its arguments.
    theirs : dict
        `identity` of the process that sends the task.

    Returns
    -------
    object
        Result of the function.

    Raises
    ------
    OtherVersions
        The versions differ.
    """
    ours = identity()
    if ours != theirs:
        raise mismatch(socket.gethostname(), ours, theirs)
    with threads(1):
        try:
            return function(*args, callback=lambda *_: 1)
        except Exception as error:
            raise picklable_error(error, name) from None


def call_name(fn: Callable[..., Any], args: tuple[Any, ...]) -> str:
    """Name of a call in messages.

    Parameters
    ----------
    fn : callable
        The function.
    args : tuple
        Its arguments; the first is the name if the function is `compute`.

    Returns
    -------
    str
    """
    return str(args[0]) if fn is compute else getattr(fn, "__name__", "call")
