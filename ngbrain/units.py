"""SI inside; the field's units at the edge.

`kPa(1.2)` reads "1.2 kPa in SI", that is 1200 Pa; `to_kPa` goes back. Arrays and CoefficientFunctions pass through.

>>> mm(5), kPa(2), round(mmHg(20), 1), ml(3)
(0.005, 2000.0, 2666.4, 3e-06)
>>> round(to_mmHg(kPa(4)), 6), to_minutes(90)
(30.00255, 1.5)
"""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")

PA_PER_MMHG = 133.322
MINUTE = 60.0
N_PER_GF = 9.80665e-3
UNITS_OF_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}


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
    """Grams-force, the weight of a gram, to newtons (1 gf = 9.80665 mN)."""
    return value * N_PER_GF  # type: ignore


def to_gf(value: T) -> T:
    """Newtons to grams-force."""
    return value / N_PER_GF  # type: ignore


def to_minutes(value: T) -> T:
    """Seconds to minutes."""
    return value / MINUTE  # type: ignore
