"""Exceptions and warnings of the package.

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
    """An input of the user cannot be used.

    The message is one line that names the file (if any), the field, its value and what is wanted.

    Parameters
    ----------
    field : str
        Name of the field or argument.
    value : object
        The value found.
    wanted : str
        What is accepted, in words.
    file : str or Path, optional
        File that the value comes from.

    Examples
    --------
    >>> print(InputError("blade.width_mm", 14.0, "at most 12, the width of the cleft", file="case.toml"))
    case.toml: blade.width_mm is 14.0; wanted: at most 12, the width of the cleft
    """

    def __init__(self, field: str, value: Any, wanted: str, file: str | Path | None = None) -> None:
        self.field, self.value, self.wanted, self.file = field, value, wanted, file
        where = f"{file}: " if file else ""
        super().__init__(f"{where}{field} is {value}; wanted: {wanted}")

    def __reduce__(self) -> tuple[Any, ...]:  # for pickling between processes
        return type(self), (self.field, self.value, self.wanted, self.file)


@contextmanager
def file_context(file: str | Path) -> Iterator[None]:
    """Add a file name to every `InputError` raised in the block, unless the error names a file already.

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
    """Check the shape of an array.

    Parameters
    ----------
    name : str
        Name of the array, for messages.
    found : tuple of int
        Its shape.
    wanted : tuple of int
        The required shape.

    Raises
    ------
    InputError
        The shapes differ.

    Examples
    --------
    >>> check_shape("w", (3,), (4, 1))
    Traceback (most recent call last):
    ngbrain.errors.InputError: w is of shape (3,); wanted: (4, 1)
    """
    if tuple(found) != tuple(wanted):
        raise InputError(name, f"of shape {tuple(found)}", str(tuple(wanted)))


class SolverError(NgbrainError, RuntimeError):
    """A computation failed. The message says what happened and what to try; `status` is the kind of failure, `result` what was
    computed.

    `result` is that of the load path, or of Newton's method in the last time step; None where there is none.
    """

    status: Status | None = None
    result: Result | None = None


class Breakdown(SolverError, FloatingPointError):
    """One step of a computation failed; callers that can try another step catch it.

    Parameters
    ----------
    message : str, optional
        What happened.
    status : Status, optional
        Kind of failure.
    """

    status: Status

    def __init__(self, message: str = "", status: Status = Status.STALLED) -> None:
        super().__init__(message)
        self.status = status


class ConvergenceError(SolverError):
    """Newton's method did not reach its tolerance."""


class InvertedElementError(SolverError):
    """An inverted element (det F <= 0 at a quadrature point) could not be avoided."""


def solver_error(message: str, status: Status, result: Result | None = None) -> SolverError:
    """Build the exception that belongs to the final status of a computation.

    Parameters
    ----------
    message : str
        What happened.
    status : Status
        Final status.
    result : Result, optional
        What was computed.

    Returns
    -------
    SolverError
        An `InvertedElementError`, `ContactError` or `ConvergenceError`.

    Examples
    --------
    >>> solver_error("it folds", Status.INVERTED)
    InvertedElementError('it folds')
    """
    types = {Status.INVERTED: InvertedElementError, Status.PENETRATION: ContactError}
    error = types.get(status, ConvergenceError)(message)
    error.status, error.result = status, result
    return error


class ContactError(SolverError):
    """The penetration of tissue and tool exceeds the limit of the contact law."""


class MissingExtra(NgbrainError, ImportError):
    """An optional dependency is not installed.

    Parameters
    ----------
    package : str
        Name of the package.
    extra : str
        The extra of ngbrain that installs it.

    Examples
    --------
    >>> print(MissingExtra("matplotlib", "report"))
    matplotlib is not installed; get it with: pip install "ngbrain[report]"
    """

    def __init__(self, package: str, extra: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(f'{package} is not installed; get it with: pip install "ngbrain[{extra}]"')

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.package, self.extra)


class RangeWarning(UserWarning):
    """Published constants are used outside the range of the data that they were fitted to."""


class ImplausibleWarning(UserWarning):
    """A value of a scene is far from all published values and may be a mistake."""


class CollapseWarning(UserWarning):
    """Single points of a body collapse, or would without a volumetric guard that was added to its materials: the mesh is too
    coarse.
    """


class StabilityWarning(UserWarning):
    """A body is so strongly compressed that equilibria may be unstable or depend on the mesh."""


def require(package: str, extra: str) -> ModuleType:
    """Import an optional package.

    Parameters
    ----------
    package : str
        Name of the module.
    extra : str
        The extra of ngbrain that installs it.

    Returns
    -------
    module

    Raises
    ------
    MissingExtra
        The package is not installed.

    Examples
    --------
    >>> require("json", "report").dumps([1])
    '[1]'
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise MissingExtra(package.partition(".")[0], extra) from error


def nearest(name: str, known: Iterable[str]) -> str:
    """Hint for a misspelt name: the nearest known name, or all of them.

    Parameters
    ----------
    name : str
        The misspelt name.
    known : iterable of str
        Names that exist.

    Returns
    -------
    str

    Examples
    --------
    >>> nearest("widht_mm", ["width_mm", "length_mm"])
    "did you mean 'width_mm'?"
    """
    known = list(known)
    close = get_close_matches(name, known, n=1)
    return f"did you mean {close[0]!r}?" if close else "one of " + ", ".join(sorted(known))
