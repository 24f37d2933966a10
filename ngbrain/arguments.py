"""Checks of numeric arguments: type, shape and range, before anything is computed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ngbrain.errors import InputError


def number(name: str, value: Any, fits: Callable[[float], bool], wanted: str) -> float:
    """Check a real number and return it.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    value : object
        Its value.
    fits : callable
        Whether a finite number is accepted.
    wanted : str
        What is accepted, in words.

    Returns
    -------
    float

    Raises
    ------
    InputError
        The value is not a finite real number, or does not fit.

    Examples
    --------
    >>> number("grading", None, lambda g: 0 < g <= 1, "more than 0 and at most 1")
    Traceback (most recent call last):
    ngbrain.errors.InputError: grading is None; wanted: more than 0 and at most 1
    """
    found = numbers(name, value, (), wanted)
    if not fits(float(found)):
        raise InputError(name, value, wanted)
    return float(found)


def numbers(name: str, values: Any, shape: tuple[int | None, ...], wanted: str = "") -> np.ndarray:
    """Convert finite real numbers to an array of float.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    values : array_like
        A number, or nested sequences of numbers.
    shape : tuple of int or None
        Shape of the array; None accepts any length along an axis.
    wanted : str, optional
        What is accepted, in words.

    Returns
    -------
    numpy.ndarray
        float, of this shape.

    Raises
    ------
    InputError
        The values have another type or shape, or are not finite.

    Examples
    --------
    >>> numbers("x", [1, 2], (None,))
    array([1., 2.])
    >>> numbers("x", "abc", (None,))
    Traceback (most recent call last):
    ngbrain.errors.InputError: x is 'abc'; wanted: finite numbers of shape (any,)
    """
    wanted = wanted or f"finite numbers of shape ({''.join(f'{n},' if n else 'any,' for n in shape)})"
    try:
        found = np.asarray(values)
    except ValueError as error:  # ragged sequences
        raise InputError(name, "of uneven lengths", wanted) from error
    fitting = found.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, found.shape, strict=True))
    if found.dtype.kind not in "iuf" or not fitting:
        shown = repr(values) if found.size < 8 else f"{found.dtype} of shape {found.shape}"
        raise InputError(name, shown[:200], wanted)
    if not np.isfinite(found).all():
        raise InputError(name, repr(values) if found.size < 8 else "not finite", wanted)
    return found.astype(float)


def check_sequence(name: str, values: Any, least: int = 1) -> Sequence[Any]:
    """Check that a value is a sequence of a minimum length and return it.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    values : object
        Its value; text and mappings are refused.
    least : int, optional
        Minimum length.

    Returns
    -------
    sequence

    Raises
    ------
    InputError
        The value is no sequence, or too short.

    Examples
    --------
    >>> check_sequence("tau", None)
    Traceback (most recent call last):
    ngbrain.errors.InputError: tau is None; wanted: a list of one value or more
    """
    if isinstance(values, str | bytes) or not hasattr(values, "__len__") or not hasattr(values, "__getitem__"):
        raise InputError(name, repr(values)[:200], "a list of one value or more")
    if getattr(values, "ndim", 1) == 0 or len(values) < least or isinstance(values, dict):
        raise InputError(name, repr(values)[:200], "a list of one value or more")
    found: Sequence[Any] = values
    return found


def check_type(name: str, value: Any, kind: type) -> None:
    """Check that a value is an instance of a class.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    value : object
        Its value.
    kind : type
        The class.

    Raises
    ------
    InputError
        The value has another type.

    Examples
    --------
    >>> check_type("mesh", None, dict)
    Traceback (most recent call last):
    ngbrain.errors.InputError: mesh is None; wanted: a dict
    """
    if not isinstance(value, kind):
        raise InputError(name, repr(value)[:200], f"a {kind.__name__}")
