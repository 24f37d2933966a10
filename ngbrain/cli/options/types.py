"""Argument types; each raises `argparse.ArgumentTypeError` for an invalid text."""

from __future__ import annotations

import argparse
import math

MOST_THREADS = 1024


def threads(text: str) -> int:
    """A number of threads or processes."""
    try:
        number = int(text)
    except ValueError:
        number = 0
    if not 1 <= number <= MOST_THREADS:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of threads, from 1 to {MOST_THREADS}")
    return number


def length(text: str) -> float:
    """A length in mm, converted to m."""
    try:
        return 1e-3 * float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not a length in mm") from error


def direction(text: str) -> tuple[float, float, float]:
    """Three finite numbers."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not three numbers with commas") from error
    if not all(map(math.isfinite, (x, y, z))):
        raise argparse.ArgumentTypeError(f"{text!r} is not three finite numbers")
    return x, y, z


def names(text: str) -> tuple[str | dict[int, str] | None, dict[int, str]]:
    """A label scheme or label names, and further names."""
    first, *rest = text.split(",")
    given = rest if "=" not in first else [first, *rest]
    try:
        named = {int(number): name.strip() for number, name in (part.split("=") for part in given)}
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not number=name,number=name,…") from error
    if "" in named.values():
        raise argparse.ArgumentTypeError(f"{text!r} has an empty name")
    return (named, {}) if "=" in first else (first, named)
