"""Unknown fields of a problem, and their place in its space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs


@dataclass(frozen=True)
class SolutionFields:
    """Components of a function of a problem's space.

    Parameters
    ----------
    u : GridFunction, trial or test function
        Displacement (m).
    p : the same, optional
        Pressure (Pa) of mixed elements.
    offset : the same
        Offset of contacts (m).
    cavities : sequence of the same
        Cavity pressures (Pa).
    """

    u: Any
    p: Any
    offset: Any
    cavities: Sequence[Any]


@dataclass(frozen=True)
class Layout:
    """Spaces of a compound space: displacements, then pressures, offsets and one number for each cavity, where present.

    Parameters
    ----------
    pressure, offset : bool
        Whether there are pressures, and offsets of contacts.
    cavities : int
        Number of cavity pressures.
    """

    pressure: bool
    offset: bool
    cavities: int

    @property
    def single(self) -> bool:
        """Whether displacements are the only unknowns."""
        return not (self.pressure or self.offset or self.cavities)

    def fields(self, of: Any) -> SolutionFields:
        """Components of a GridFunction, or of trial or test functions, of the space."""
        if self.single:
            return SolutionFields(of[0] if isinstance(of, (list, tuple)) else of, None, ngs.CF(0.0), [])
        parts = list(of.components if isinstance(of, ngs.GridFunction) else of)
        u = parts.pop(0)
        p = parts.pop(0) if self.pressure else None
        offset = parts.pop(0) if self.offset else ngs.CF(0.0)
        return SolutionFields(u, p, offset, parts)

    @property
    def count(self) -> int:
        """Number of spaces."""
        return 1 + self.pressure + self.offset + self.cavities
