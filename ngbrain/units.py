"""Conversion between SI, used inside the package, and the units of the field.

`kPa(1.2)` is 1.2 kPa in SI, that is 1200 Pa; `to_kPa` converts back. Arrays and CoefficientFunctions are accepted too.

>>> mm(5), kPa(2), round(mmHg(20), 1), ml(3)
(0.005, 2000.0, 2666.4, 3e-06)
>>> round(to_mmHg(kPa(4)), 6), to_minutes(90)
(30.00255, 1.5)
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from ngbrain.arguments import numbers
from ngbrain.errors import InputError

T = TypeVar("T")

PA_PER_MMHG = 133.322
MINUTE = 60.0
N_PER_GF = 9.80665e-3
UNITS_OF_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}

LARGEST_LENGTH = 1000.0
"""Maximum length (m) of a body."""
MOST_ELEMENTS = 20_000_000
"""Maximum number of elements of a mesh."""
LARGEST_BODY = 2.0
"""Maximum size (m) of a mesh from a file; a larger one is in other units."""


def mm(value: T) -> T:
    """Millimetres to metres."""
    return value * 1e-3  # type: ignore


def to_mm(value: T) -> T:
    """Metres to millimetres."""
    return value * 1e3  # type: ignore


def kPa(value: T) -> T:
    """Kilopascals to pascals."""
    return value * 1e3  # type: ignore


def to_kPa(value: T) -> T:
    """Pascals to kilopascals."""
    return value * 1e-3  # type: ignore


def mmHg(value: T) -> T:
    """Millimetres of mercury to pascals (1 mmHg = 133.322 Pa)."""
    return value * PA_PER_MMHG  # type: ignore


def to_mmHg(value: T) -> T:
    """Pascals to millimetres of mercury."""
    return value / PA_PER_MMHG  # type: ignore


def ml(value: T) -> T:
    """Millilitres to cubic metres."""
    return value * 1e-6  # type: ignore


def to_ml(value: T) -> T:
    """Cubic metres to millilitres."""
    return value * 1e6  # type: ignore


def gf(value: T) -> T:
    """Grams-force to newtons (1 gf = 9.80665 mN)."""
    return value * N_PER_GF  # type: ignore


def to_minutes(value: T) -> T:
    """Seconds to minutes."""
    return value / MINUTE  # type: ignore


def check_lengths(name: str, values: object, count: int | None = None, most: float = LARGEST_LENGTH) -> None:
    """Check lengths: positive, and not longer than a body can be.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    values : float or array_like
        Lengths (m).
    count : int, optional
        Number of values; None for a single number.
    most : float, optional
        Maximum length (m).

    Raises
    ------
    InputError
        The number of values differs, or a value is not finite, not positive, complex or too long.

    Examples
    --------
    >>> check_lengths("maxh", -0.1)
    Traceback (most recent call last):
    ngbrain.errors.InputError: maxh is -0.1; wanted: metres, more than 0 and at most 1000
    """
    lengths = numbers(name, values, () if count is None else (count,), f"metres, more than 0 and at most {most:g}")
    if not np.all((lengths > 0) & (lengths <= most)):
        raise InputError(name, values, f"metres, more than 0 and at most {most:g}")


def check_count(name: str, value: float, volume: float) -> None:
    """Check that an element size does not need too many elements.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    value : float
        Element size (m).
    volume : float
        Volume (m³) of the body.

    Raises
    ------
    InputError
        The body would need more than `MOST_ELEMENTS` elements.

    Examples
    --------
    >>> check_count("maxh", 1e-9, 1e-3)
    Traceback (most recent call last):
    ngbrain.errors.InputError: maxh is 1e-09; wanted: larger elements: a body of 0.001 m³ would take more than 20,000,000
    """
    if not volume / MOST_ELEMENTS <= value**3:
        raise InputError(
            name, value, f"larger elements: a body of {volume:.3g} m³ would take more than {MOST_ELEMENTS:,}"
        )
