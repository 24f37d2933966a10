"""Levels of the axes of a model, from the cheapest on."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

Model = Mapping[str, str]
"""Axis → level."""


class AxisLevel(StrEnum):
    """A level of an axis."""

    def __repr__(self) -> str:
        return repr(self.value)

    @property
    def is_partial(self) -> bool:
        """Whether it is only a part of the step to the next level."""
        return False

    @property
    def number(self) -> int:
        """Its index among the levels of its axis, from 0."""
        return list(type(self)).index(self)


class TissueLevel(AxisLevel):
    """One tissue for all regions, one for each region, or a map within each."""

    ONE = "one"
    EACH = "each"
    MAP = "map"


class PresenceLevel(AxisLevel):
    """An effect that is left out or included."""

    NONE = "none"
    ALL = "all"


class StrainLevel(AxisLevel):
    """Small or finite strain."""

    LINEAR = "linear"
    FINITE = "finite"


class TimeLevel(AxisLevel):
    """Time dependence: elastic with instantaneous or relaxed moduli, linear viscoelastic (Prony), or finite viscoelastic."""

    INSTANTANEOUS = "instantaneous"
    RELAXED = "relaxed"
    PRONY = "prony"
    FLOWING = "flowing"

    @property
    def has_memory(self) -> bool:
        """Whether it is viscoelastic."""
        return self in (TimeLevel.PRONY, TimeLevel.FLOWING)


class PressureLevel(AxisLevel):
    """Displacement elements, or mixed elements with a pressure unknown."""

    NONE = "none"
    UNKNOWN = "unknown"


class ExtentLevel(AxisLevel):
    """The region of interest, or the whole body."""

    NEAR = "near"
    WHOLE = "whole"


class SpaceLevel(AxisLevel):
    """A plane section, or the body in space."""

    PLANE = "plane"
    SOLID = "solid"


class OrderLevel(AxisLevel):
    """Order of the elements."""

    FIRST = "1"
    SECOND = "2"
    THIRD = "3"
    FOURTH = "4"

    @property
    def degree(self) -> int:
        """Polynomial degree.

        Examples
        --------
        >>> OrderLevel("3").degree
        3
        """
        return self.number + 1


class MeshLevel(AxisLevel):
    """Number of uniform refinements; at a partial level only the elements that matter to the quantities are refined once more."""

    COARSEST = "0"
    COARSEST_PART = "0+"
    HALVED = "1"
    HALVED_PART = "1+"
    QUARTERED = "2"

    @property
    def is_partial(self) -> bool:
        """Whether only some elements are refined once more.

        Examples
        --------
        >>> [level.halvings for level in MeshLevel if level.is_partial]
        [0, 1]
        """
        return self.number % 2 == 1

    @property
    def halvings(self) -> int:
        """Number of uniform refinements."""
        return self.number // 2


HALVINGS = tuple(level for level in MeshLevel if not level.is_partial)
"""Levels of uniformly refined meshes."""
