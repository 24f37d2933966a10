"""Which unknowns a problem has, and where they are in its space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs


@dataclass(frozen=True)
class SolutionFields:
    """Functions of a problem's space by what they are: displacement, pressure or None, offset of contacts, cavity pressures."""

    u: Any
    p: Any
    offset: Any
    cavities: Sequence[Any]


@dataclass(frozen=True)
class Layout:
    """Which spaces a compound has: displacements, then pressures, offsets and a number for each cavity, as far as there are any."""

    pressure: bool
    offset: bool
    cavities: int

    @property
    def single(self) -> bool:
        """Whether displacements are all that there is."""
        return not (self.pressure or self.offset or self.cavities)

    def fields(self, of: Any) -> SolutionFields:
        """The parts of a GridFunction, or of trial or test functions, of the space."""
        if self.single:
            return SolutionFields(of[0] if isinstance(of, (list, tuple)) else of, None, ngs.CF(0.0), [])
        parts = list(of.components if isinstance(of, ngs.GridFunction) else of)
        u = parts.pop(0)
        p = parts.pop(0) if self.pressure else None
        offset = parts.pop(0) if self.offset else ngs.CF(0.0)
        return SolutionFields(u, p, offset, parts)

    @property
    def count(self) -> int:
        """How many spaces."""
        return 1 + self.pressure + self.offset + self.cavities
