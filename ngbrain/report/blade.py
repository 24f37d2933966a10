"""Blades as they are drawn: cut through the middle, and as solids."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ngbrain.mesh import Cleft
from ngbrain.report.surface import Floats, Ints

ABOVE = 25e-3
"""How far (m) a blade is drawn beyond the surface."""
TOOLS = {"spatula": "blade", "two spatulas": "blades", "tube": "tube"}
"""Kind of blade → its name in pictures."""
ARC = 7
"""Points of a rounded corner,"""
ROUND = 48
"""and of a circle."""


class Drawn(Protocol):
    """A blade where it stands at some time."""

    def across(self, height: float) -> float:
        """Where its middle is between the walls (m), at a height (m) above the cleft's floor."""

    def profile(self) -> Floats:
        """Cut through its middle: (across, height) in m, (k, 2)."""

    def solid(self) -> tuple[Floats, Ints]:
        """Points (m) and triangles."""


def drawn(blade: Mapping[str, Any], cleft: Cleft, advance: float) -> tuple[Drawn, ...]:
    """The blades that `geometry.blade` of a result tells of, when they have gone `advance` (m) together."""
    kind = blade.get("kind", "spatula")
    if kind == "tube":
        return (Tube(cleft, cleft.opening / 2 + advance / 2, blade["tip_clearance_m"]),)
    sides = (1, -1) if kind == "two spatulas" else (1,)
    return tuple(Spatula(cleft, blade, advance / len(sides), side) for side in sides)


@dataclass(frozen=True)
class Spatula:
    """A plate whose front edges and tip are rounded, on the side of the cleft's `across` (1) or the other (-1)."""

    cleft: Cleft
    blade: Mapping[str, Any]
    advance: float
    side: int

    def across(self, height: float) -> float:
        """Where its middle is between the walls (m), at a height (m) above the cleft's floor."""
        middle = np.array([[self._face - self.blade["thickness_m"] / 2, height]])
        return self.side * float(self._bent(middle, 1)[0, 0])

    def profile(self) -> Floats:
        """Cut through its middle: (across, height) in m, (k, 2)."""
        r, face, tip = self._edge, self._face, self.blade["tip_clearance_m"]
        height = np.linspace(tip + r, self._top, ARC)
        angle = np.linspace(-np.pi / 2, 0, ARC)
        rounded = np.column_stack([face - r + r * np.cos(angle), tip + r + r * np.sin(angle)])
        front = np.column_stack([np.full(ARC, face), height])
        back = np.column_stack([np.full(ARC, face - self.blade["thickness_m"]), np.linspace(self._top, tip, ARC)])
        return self._bent(np.vstack([rounded, front, back]), 1) * [self.side, 1]

    def solid(self) -> tuple[Floats, Ints]:
        """Points (m) and triangles."""
        r, angle = self._edge, np.linspace(0, np.pi / 2, ARC)
        slices = [(0.0, -self.blade["thickness_m"])]
        slices += [(r * (1 - np.sin(q)), -r * (1 - np.cos(q))) for q in angle[::-1]]  # from the face backwards
        rings = [self._outline(inset, self._face + behind) for inset, behind in sorted(slices, key=lambda one: -one[1])]
        points = self._bent(np.concatenate(rings), 2) * [self.side, 1, 1]
        return _placed(self.cleft, points), _skin(len(rings[0]), len(rings))

    def _outline(self, inset: float, across: float) -> Floats:
        """A section of the blade at `across`: its outline, drawn in by `inset`, rounded at the tip."""
        tip, top = self.blade["tip_clearance_m"] + inset, self._top
        wide = self.blade["width_m"] / 2 - inset
        narrow = (self.blade.get("tip_width_m") or self.blade["width_m"]) / 2 - inset
        r = max(2 * self._edge - inset, 0.0)
        angle = np.linspace(-np.pi / 2, 0, ARC)
        right = np.column_stack([narrow - r + r * np.cos(angle), tip + r + r * np.sin(angle)])
        height = np.linspace(tip + r, top, 3 * ARC)[1:]
        above = np.column_stack(
            [np.interp(height, [self.blade["tip_clearance_m"], self.cleft.depth], [narrow, wide]), height]
        )
        ring = np.vstack([right[::-1] * [-1, 1], right, above, above[::-1] * [-1, 1]])
        return np.column_stack([np.full(len(ring), across), ring])

    def _bent(self, points: Floats, height: int) -> Floats:
        """Points bent back as the face is; `height` is the column that holds it."""
        bend = self.blade.get("face_radius_m")
        if not bend:
            return points
        off = np.clip(
            points[:, height] - (self.blade["tip_clearance_m"] + self.cleft.depth) / 2, -0.99 * bend, 0.99 * bend
        )
        back = np.column_stack([bend - np.sqrt(bend**2 - off**2), *[np.zeros(len(points))] * (points.shape[1] - 1)])
        return points - back

    @property
    def _edge(self) -> float:
        return min(self.blade["edge_radius_m"], self.blade["thickness_m"])

    @property
    def _face(self) -> float:
        return self.cleft.opening / 2 + self.advance

    @property
    def _top(self) -> float:
        return self.cleft.depth + ABOVE


@dataclass(frozen=True)
class Tube:
    """A cylinder around the cleft's axis."""

    cleft: Cleft
    radius: float
    tip: float

    def across(self, height: float) -> float:
        """Around the cleft's axis."""
        return 0.0

    def profile(self) -> Floats:
        """Cut through its middle: (across, height) in m, (k, 2)."""
        r, top = self.radius, self.cleft.depth + ABOVE
        return np.array([[-r, self.tip], [r, self.tip], [r, top], [-r, top]])

    def solid(self) -> tuple[Floats, Ints]:
        """Points (m) and triangles."""
        angle = np.linspace(0, 2 * np.pi, ROUND, endpoint=False)
        ring = self.radius * np.column_stack([np.cos(angle), np.sin(angle)])
        ends = [np.column_stack([ring, np.full(ROUND, z)]) for z in (self.tip, self.cleft.depth + ABOVE)]
        return _placed(self.cleft, np.concatenate(ends)), _skin(ROUND, 2)


def _placed(cleft: Cleft, points: Floats) -> Floats:
    """From (across, along, height) to the head's coordinates (m)."""
    return cleft.target + points @ np.stack([cleft.across, cleft.along, cleft.out])


def _skin(n: int, rings: int) -> Ints:
    """Triangles between rings of n points each, and over the first and the last."""
    i, j = np.arange(n), (np.arange(n) + 1) % n
    tris = []
    for k in range(rings - 1):
        a, b = k * n, (k + 1) * n
        tris += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    for start in (0, (rings - 1) * n):
        tris.append(start + np.column_stack([0 * i[2:], i[1:-1], i[2:]]))
    return np.concatenate(tris)
