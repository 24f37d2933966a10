"""Where several starts of one inversion ended, compared at equal weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ngbrain.errors import InputError
from ngbrain.inverse.found import Found

LOWER = 1e-6
"""Of J, by which another end has to be lower to be kept."""


@dataclass
class Compared:
    """The end that is kept and its name, the best that uniform fields came to, and what to say."""

    best: Found
    chosen: str = "both"
    uniform: Found | None = None
    notes: list[str] = field(default_factory=list)


def multiples_of(levels: Sequence[float]) -> tuple[float, ...]:
    """Levels of uniform fields, as multiples of the modulus that the waves suggest; `InputError` unless positive and finite."""
    if not all(0 < each < np.inf for each in levels):
        raise InputError("levels", list(levels), "positive multiples of the modulus that the waves suggest")
    return tuple(dict.fromkeys(float(each) for each in levels))


def compared(both: Found, ends: Mapping[float, Found | None]) -> Compared:
    """What measured waves led to against the ends of uniform fields by their level, None where no step was lower; J decides."""
    kept = Compared(both)
    arrived = {level: end for level, end in ends.items() if end is not None}
    if ends and not arrived:
        kept.notes.append("from uniform fields no step lowered the objective")
    if arrived:
        kept.uniform = min(arrived.values(), key=lambda end: end.value)
        if len(ends) > 1:
            values = ", ".join(f"{end.value:.5g} from {level:g}" for level, end in arrived.items())
            words = f"uniform fields ended at an objective of {values} times the suggested modulus: the least is shown"
            kept.notes.append(words)
        if kept.uniform.value < both.value * (1 - LOWER):
            kept.best, kept.chosen = kept.uniform, "uniform"
            kept.notes.append("uniform fields led to a lower objective than measured waves did")
    return kept
