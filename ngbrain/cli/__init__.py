"""The command line. Exit status 0 for success, 2 for bad input, 3 for a solver failure or an unreliable answer.

- `simulate` (also `demo`), `mesh`, `invert`, `predict`, `calibrate`, `twin`, `cohort`, `materials`, `data`, `doctor`: The verbs.
- `options`: Their options.
- `places`: Output folders; `streams`: standard output and error; `interrupts`: Ctrl-C; `words`: the final summary.
"""

from __future__ import annotations

import argparse
import logging
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from importlib import import_module
from typing import Any

from ngbrain.cli.interrupts import EXIT_INTERRUPTED, interruptible
from ngbrain.cli.options.common import parser
from ngbrain.cli.places import mesh_file, reserve_output
from ngbrain.cli.streams import guard_stdout, secure_streams
from ngbrain.errors import InputError, MissingExtra, SolverError
from ngbrain.progress import LOG, terminal

__all__ = ["ERRORS", "EXIT_INPUT", "EXIT_SOLVER", "exit_status", "main", "module_of", "perform"]

LEFTWARD = re.compile(r"-[\d.][^,]*(,[^,]+){2}")
"""Three comma-separated numbers, the first of them negative."""
EXIT_INPUT, EXIT_SOLVER = 2, 3
ERRORS = (InputError, MissingExtra, SolverError, OSError, MemoryError)
"""Errors that end a command with a one-line message."""
WRITING = ("demo", "simulate", "mesh", "invert", "predict", "calibrate", "twin")
"""Verbs that write results to a folder."""
MODULES = {"demo": "simulate"}
"""Verbs whose module has another name; a module's `run` takes the parsed arguments and may return a status."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a verb and return the exit status."""
    secure_streams()
    command = parser()
    arguments = command.parse_args(_join_negative_values(sys.argv[1:] if argv is None else argv))
    if arguments.verb is None:
        command.print_help()
        return 0
    resumed = f"; continue with --resume -o {arguments.output}" if hasattr(arguments, "resume") else ""
    resumed = "; the same command continues it" if arguments.verb == "cohort" else resumed
    stopped = f"ngbrain: stopped{resumed}"
    try:
        with guard_stdout(), interruptible(stopped):
            return perform(arguments)
    except ERRORS as error:
        status, line = exit_status(error, arguments)
        print(f"ngbrain: {line}", file=sys.stderr)
        return status
    except KeyboardInterrupt:
        print(stopped, file=sys.stderr)
        return EXIT_INTERRUPTED


def perform(arguments: argparse.Namespace) -> int:
    """Run parsed arguments and return the exit status; raises `ERRORS` and any unexpected error."""
    with _logging(arguments.quiet):
        for file in getattr(arguments, "own_laws", None) or ():
            import_module("ngbrain.materials.registry").register(file)
        module = import_module(module_of(arguments.verb))  # a second or two
        if arguments.verb == "mesh":
            arguments.output = mesh_file(arguments.output)
        with reserve_output(arguments) if arguments.verb in WRITING else nullcontext():
            return int(module.run(arguments) or 0)


def module_of(verb: str) -> str:
    """The module of a verb."""
    return f"ngbrain.cli.{MODULES.get(verb, verb)}"


def exit_status(error: BaseException, arguments: argparse.Namespace) -> tuple[int, str]:
    """Exit status and message of a command that ended with one of `ERRORS`.

    Parameters
    ----------
    error : BaseException
    arguments : argparse.Namespace

    Returns
    -------
    status : int
    line : str
    """
    if isinstance(error, InputError | MissingExtra):
        return EXIT_INPUT, str(error)
    if isinstance(error, SolverError):
        written = arguments.verb != "mesh" and arguments.output.is_dir() and any(arguments.output.iterdir())
        return EXIT_SOLVER, f"{error}; the steps so far are in {arguments.output}" if written else str(error)
    if isinstance(error, OSError):
        return EXIT_INPUT, f"{error.filename or arguments.output}: {error.strerror or error}"
    return EXIT_SOLVER, "out of memory; larger elements or fewer --threads take less"


@contextmanager
def _logging(quiet: bool) -> Iterator[None]:
    """Write log messages and warnings of the library to stderr, a line each, and progress unless a terminal shows it."""

    def warn(message: Warning | str, *_: Any, **__: Any) -> None:
        LOG.warning("warning: %s", message)  # without the place in the source that it came from

    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("ngbrain: %(message)s"))
    handler.addFilter(lambda record: record.name == LOG.name or record.levelno > logging.INFO)  # no line a step
    before = LOG.level
    LOG.addHandler(handler)
    LOG.setLevel(logging.WARNING if quiet or terminal() else logging.INFO)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = warn
            yield
    finally:
        LOG.setLevel(before)
        LOG.removeHandler(handler)


def _join_negative_values(argv: Sequence[str]) -> list[str]:
    """Join options and values such as `--site -20,0,30` to `--site=-20,0,30`, since a negative coordinate is not an option.

    Examples
    --------
    >>> _join_negative_values(["mesh", "--site", "-20,0,30", "-q"])
    ['mesh', '--site=-20,0,30', '-q']
    """
    joined: list[str] = []
    for text in argv:
        if LEFTWARD.fullmatch(text) and joined and joined[-1].startswith("--") and "=" not in joined[-1]:
            joined[-1] += f"={text}"
        else:
            joined.append(text)
    return joined
