"""Numbers, lengths and times as text."""

from __future__ import annotations

import math
from typing import Any


def number(value: Any, digits: int = 3) -> str:
    """A number with about `digits` digits; a dash for a missing value.

    Parameters
    ----------
    value : Any
        The number.
    digits : int
        Number of significant digits.

    Returns
    -------
    str
        Text, with thin spaces between thousands.

    Examples
    --------
    >>> [number(v) for v in (146.04, 0.01234, 3.2e-9, 0.0, 48123, None, float("nan"))]
    ['146', '0.0123', '3.2e-09', '0', '48 123', '–', '–']
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return "–"
    if isinstance(value, int) or value == 0:
        return f"{value:,.0f}".replace(",", " ").replace("-", "−")
    if 1e-3 <= abs(value) < 1e6:
        places = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
        text = f"{value:,.{places}f}".replace(",", " ")
        return text.replace("-", "−")
    return f"{value:.2g}"


def size(metres: float) -> str:
    """A length (m) in mm, without insignificant zeros.

    >>> size(0.04), size(0.0299790)
    ('40 mm', '30 mm')
    """
    return f"{round(1e3 * metres, 1):g} mm"


def duration(seconds: float) -> str:
    """A duration (s) in words.

    >>> duration(0), duration(47.6), duration(865)
    ('0 s', '48 s', '14 min 25 s')
    """
    whole = round(seconds)
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60} s" if whole % 60 else f"{whole // 60} min"


def moment(seconds: float) -> str:
    """A time (s) in words, short ones with three digits.

    >>> moment(0.0), moment(0.26667), moment(12.5), moment(865.2)
    ('0 s', '0.267 s', '12.5 s', '14 min 25 s')
    """
    return f"{seconds:.3g} s" if seconds < 60 else duration(seconds)


SHOWN = {"m": ("mm", 1e3), "": ("%", 100.0)}
"""Unit → display unit and factor; other units are shown as they are."""


def display_unit(unit: str) -> tuple[str, float]:
    """Display unit of a quantity, and the factor to it.

    >>> display_unit("m"), display_unit("N")
    (('mm', 1000.0), ('N', 1.0))
    """
    return SHOWN.get(unit, (unit, 1.0))
