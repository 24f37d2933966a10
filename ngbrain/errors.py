"""Every way a call can fail, by name.

The command line turns `InputError` and `MissingExtra` into exit status 2 and `SolverError` into exit status 3.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import Any

from ngbrain.result import Result, Status


class NgbrainError(Exception):
    """Base of every exception that ngbrain raises on purpose; its message is one line."""

    def __init__(self, message: str = "") -> None:
        super().__init__(" ".join(str(message).split()))


class InputError(NgbrainError, ValueError):
    """Something the user gave cannot be used.

    One line that names the file (where there is one), the field, the value found and what is wanted.

    >>> print(InputError("blade.width_mm", 14.0, "at most 12, the width of the cleft", file="case.toml"))
    case.toml: blade.width_mm is 14.0; wanted: at most 12, the width of the cleft
    """

    def __init__(self, field: str, value: Any, wanted: str, file: str | Path | None = None) -> None:
        self.field, self.value, self.wanted, self.file = field, value, wanted, file
        where = f"{file}: " if file else ""
        super().__init__(f"{where}{field} is {value}; wanted: {wanted}")

    def __reduce__(self) -> tuple[Any, ...]:  # how it comes back from another process
        return type(self), (self.field, self.value, self.wanted, self.file)


@contextmanager
def file_context(file: str | Path) -> Iterator[None]:
    """What is refused in here names the file, also by what does not know it: values are passed about without their source.

    >>> with file_context("t1.nii"):
    ...     raise InputError("image", "empty", "a T1")
    Traceback (most recent call last):
    ngbrain.errors.InputError: t1.nii: image is empty; wanted: a T1
    """
    try:
        yield
    except InputError as error:
        raise InputError(error.field, error.value, error.wanted, error.file or file) from None


def check_shape(name: str, found: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    """`InputError` where an array has another shape than is wanted.

    >>> check_shape("w", (3,), (4, 1))
    Traceback (most recent call last):
    ngbrain.errors.InputError: w is of shape (3,); wanted: (4, 1)
    """
    if tuple(found) != tuple(wanted):
        raise InputError(name, f"of shape {tuple(found)}", str(tuple(wanted)))


class SolverError(NgbrainError, RuntimeError):
    """A computation gave up: the message says what happened and what to try, `status` in which way, `result` what was done.

    `result` is that of the load path, or of Newton's method in the last time step; None where there is none.
    """

    status: Status | None = None
    result: Result | None = None


class Breakdown(SolverError, FloatingPointError):
    """A step of a computation cannot be taken; whoever tries others catches it."""

    status: Status

    def __init__(self, message: str = "", status: Status = Status.STALLED) -> None:
        super().__init__(message)
        self.status = status


class ConvergenceError(SolverError):
    """Newton's method did not reach its tolerance."""


class InvertedElementError(SolverError):
    """A state with det F <= 0 at some quadrature point was met and could not be avoided."""


def solver_error(message: str, status: Status, result: Result | None = None) -> SolverError:
    """The error to raise for how a computation ended, with what was done.

    >>> solver_error("it folds", Status.INVERTED)
    InvertedElementError('it folds')
    """
    types = {Status.INVERTED: InvertedElementError, Status.PENETRATION: ContactError}
    error = types.get(status, ConvergenceError)(message)
    error.status, error.result = status, result
    return error


class ContactError(SolverError):
    """The tissue went into a blade further than the contact law allows."""


class MissingExtra(NgbrainError, ImportError):
    """An optional package is needed.

    >>> print(MissingExtra("matplotlib", "report"))
    matplotlib is not installed; get it with: pip install "ngbrain[report]"
    """

    def __init__(self, package: str, extra: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(f'{package} is not installed; get it with: pip install "ngbrain[{extra}]"')

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.package, self.extra)


class RangeWarning(UserWarning):
    """Published constants are used beyond the data that they come from."""


class ImplausibleWarning(UserWarning):
    """Something in a scene is far from anything that has been published for it, so that it may not be what was meant."""


class CollapseWarning(UserWarning):
    """Single points of a body collapse, or would without a guard that its materials did not have: the mesh is too coarse."""


class StabilityWarning(UserWarning):
    """A body is compressed so far that equilibria need not be stable, nor the same on another mesh."""


def require(package: str, extra: str) -> ModuleType:
    """Import an optional package, or raise `MissingExtra` naming the extra that brings it.

    >>> require("json", "report").dumps([1])
    '[1]'
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise MissingExtra(package.partition(".")[0], extra) from error


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint for a misspelt name: the nearest known one, or all of them.

    >>> nearest("widht_mm", ["width_mm", "length_mm"])
    "did you mean 'width_mm'?"
    """
    known = list(known)
    close = get_close_matches(name, known, n=1)
    return f"did you mean {close[0]!r}?" if close else "one of " + ", ".join(sorted(known))
