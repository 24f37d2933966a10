"""Executors by the name that a command line gives them."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from ngbrain.errors import InputError
from ngbrain.parallel.processes import ProcessExecutor


@contextmanager
def open_executor(spec: str | int | None) -> Iterator[Executor | None]:
    """The executor of a name, closed afterwards.

    Parameters
    ----------
    spec : str or int, optional
        A number of processes on this machine; None and 1 are this process, for which None is given.

    Raises
    ------
    InputError
        No executor has that name.
    """
    if spec is None or isinstance(spec, int) or spec.isdigit():
        workers = int(spec or 1)
        if workers < 1:
            raise InputError("executor", spec, "a number of processes from 1 on")
        if workers == 1:
            yield None
            return
        with ProcessExecutor(workers) as executor:
            yield executor
        return
    raise InputError("executor", repr(spec), "a number of processes")
