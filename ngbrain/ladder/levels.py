"""How richly a body is modelled along each axis: the levels, from the cheapest on, which read as their names do."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

Model = Mapping[str, str]
"""Axis → level."""


class AxisLevel(StrEnum):
    """One way to model."""

    def __repr__(self) -> str:
        return repr(self.value)

    @property
    def is_partial(self) -> bool:
        """Whether it is a part of the step to the next one."""
        return False

    @property
    def number(self) -> int:
        """Its place among the levels of its axis, from 0."""
        return list(type(self)).index(self)


class TissueLevel(AxisLevel):
    """One for all regions, each its own, or a map within each."""

    ONE = "one"
    EACH = "each"
    MAP = "map"


class PresenceLevel(AxisLevel):
    """Left out, or there."""

    NONE = "none"
    ALL = "all"


class StrainLevel(AxisLevel):
    """Small or not."""

    LINEAR = "linear"
    FINITE = "finite"


class TimeLevel(AxisLevel):
    """What tissue remembers: nothing, as at first or as it is then; its branches, linear or strained far."""

    INSTANTANEOUS = "instantaneous"
    RELAXED = "relaxed"
    PRONY = "prony"
    FLOWING = "flowing"

    @property
    def has_memory(self) -> bool:
        """Whether it has a memory."""
        return self in (TimeLevel.PRONY, TimeLevel.FLOWING)


class PressureLevel(AxisLevel):
    """Of the displacements alone, or an unknown."""

    NONE = "none"
    UNKNOWN = "unknown"


class ExtentLevel(AxisLevel):
    """The region of interest, or all."""

    NEAR = "near"
    WHOLE = "whole"


class SpaceLevel(AxisLevel):
    """A section, or the body."""

    PLANE = "plane"
    SOLID = "solid"


class OrderLevel(AxisLevel):
    """Of the elements."""

    FIRST = "1"
    SECOND = "2"
    THIRD = "3"
    FOURTH = "4"

    @property
    def degree(self) -> int:
        """Of polynomials.

        >>> OrderLevel("3").degree
        3
        """
        return self.number + 1


class MeshLevel(AxisLevel):
    """How often elements are halved; of a part only those where it matters to what is asked are halved once more."""

    COARSEST = "0"
    COARSEST_PART = "0+"
    HALVED = "1"
    HALVED_PART = "1+"
    QUARTERED = "2"

    @property
    def is_partial(self) -> bool:
        """Whether some elements are half as large.

        >>> [level.halvings for level in MeshLevel if level.part]
        [0, 1]
        """
        return self.number % 2 == 1

    @property
    def halvings(self) -> int:
        """Of all elements."""
        return self.number // 2


HALVINGS = tuple(level for level in MeshLevel if not level.is_partial)
"""Levels of a mesh whose elements are all halved or none."""
