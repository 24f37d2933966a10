"""Standard output and error of a command: closed, full, of another encoding, or a closed pipe."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from ngbrain.parallel.kernel import open_standard_streams


def secure_streams() -> None:
    """Open each standard stream that the caller has closed; otherwise the next opened file would take its descriptor."""
    open_standard_streams()
    for name, number in (("stdout", 1), ("stderr", 2)):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w", encoding="utf-8", closefd=False))
        stream = getattr(sys, name)
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # names of files need not be text


@contextmanager
def guard_stdout() -> Iterator[None]:
    """Flush standard output at the end; a closed pipe (`| head -1`) is ignored, since the work continues.

    Raises
    ------
    OSError
        Standard output cannot be written for another reason.
    """
    stream = sys.stdout
    write, flush = stream.write, stream.flush

    def ignoring_closed_pipe(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            try:
                return function(*args)
            except OSError as error:
                _discard_output()
                if isinstance(error, BrokenPipeError):
                    return 0
                raise OSError(error.errno, error.strerror, "standard output") from error

        return call

    try:
        stream.write, stream.flush = ignoring_closed_pipe(write), ignoring_closed_pipe(flush)  # type: ignore[method-assign]
    except AttributeError:  # a stream of another kind, set by the caller
        yield
        return
    try:
        yield
        stream.flush()
    finally:
        del stream.write, stream.flush


def _discard_output() -> None:
    """Discard buffered output, so that Python reports no error at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    with suppress(OSError):
        sys.stdout.flush()
