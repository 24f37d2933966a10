"""Tools as pictures show them, from the distance functions of contact: sections and surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ngbrain.errors import require
from ngbrain.mesh import Cleft
from ngbrain.report.render.surface import Floats, Ints, cut_tets
from ngbrain.scene import Tool
from ngbrain.surgery.tools import HANDLE, RigidTool, make_tools

TOOLS = {
    "spatula": "blade",
    "two spatulas": "blades",
    "plate": "plate",
    "tube": "tube",
    "ball": "ball",
    "surface": "tool",
}
"""Kind of tool → its name in pictures."""
FINE, COARSE = 0.2e-3, 0.5e-3
"""Grid steps (m) for the section and the surface of a tool."""
BESIDE = 1.5
"""Margin of a grid around a tool, in steps."""
_SIX = np.array([[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]])
"""Tetrahedra of a cube; its corner 4i + 2j + k is at (i, j, k)."""


def tool_drawings(blade: Mapping[str, Any], cleft: Cleft, advance: float) -> tuple[ToolDrawing, ...]:
    """The tools of a result after a common advance.

    Parameters
    ----------
    blade : mapping of str to Any
        `geometry.blade` of the result.
    cleft : Cleft
        The cleft.
    advance : float
        Total advance of the tools (m).

    Returns
    -------
    tuple of ToolDrawing
        The tools.
    """
    given = {key.removesuffix("_m"): value for key, value in blade.items() if value is not None}
    tools = list(make_tools(Tool(**given), cleft).values())
    shown = tools[:1] if tools[0].single else tools
    return tuple(ToolDrawing(each, cleft, advance / len(tools)) for each in shown)


@dataclass(frozen=True)
class ToolDrawing:
    """A tool at one time.

    Parameters
    ----------
    tool : RigidTool
        The tool.
    cleft : Cleft
        The cleft, whose frame the pictures use.
    advance : float
        Advance from first contact (m).
    """

    tool: RigidTool
    cleft: Cleft
    advance: float

    def across(self, height: float) -> float:
        """Position of its middle between the walls (m), at a height (m) above the cleft's floor."""
        at = self.profile()
        near = at[np.abs(at[:, 1] - height) <= max(4 * FINE, np.abs(at[:, 1] - height).min())]
        return float((near[:, 0].min() + near[:, 0].max()) / 2)

    @property
    def handle(self) -> Floats:
        """A point (m) near its upper end."""
        return self.cleft.target + self.top * self.cleft.out + self.across(self.top) * self.cleft.across

    @property
    def top(self) -> float:
        """Height of its upper end above the cleft's floor (m)."""
        low, high = (float(end[2]) for end in self.tool.bounds(self.advance))
        return high - 0.1 * min(HANDLE, high - low)

    def profile(self) -> Floats:
        """Section through its middle: (across, height) in m, (k, 2)."""
        return self._profile

    @cached_property
    def _profile(self) -> Floats:
        a, c = self._axes(FINE, (0, 2))
        at = np.stack([each.ravel() for each in np.meshgrid(a, [0.0], c, indexing="ij")], axis=1)
        grid = self.tool.signed_distance(self.advance, at).reshape(len(a), len(c))
        axes = require("matplotlib.figure", "report").Figure().subplots()
        (lines,) = axes.contour(a, c, grid.T, [0.0]).allsegs
        return np.asarray(max(lines, key=len)) * [self._side, 1]

    def solid(self) -> tuple[Floats, Ints]:
        """Surface: vertices (m) and triangles."""
        axes = self._axes(COARSE, (0, 1, 2))
        at = np.stack([each.ravel() for each in np.meshgrid(*axes, indexing="ij")], axis=1)
        number = np.arange(len(at)).reshape([len(axis) for axis in axes])
        corners = [number[i : i - 1 or None, j : j - 1 or None, k : k - 1 or None] for i, j, k in np.ndindex(2, 2, 2)]
        cubes = np.stack([each.ravel() for each in corners], axis=1)
        tets = cubes[:, _SIX].reshape(-1, 4)
        cut = cut_tets(tets, -self.tool.signed_distance(self.advance, at), np.arange(len(tets)))
        frame = self.tool.cleft
        return frame.target + cut.interpolate(at) @ np.stack([frame.across, frame.along, frame.out]), cut.simplices

    def _axes(self, step: float, which: tuple[int, ...]) -> list[Floats]:
        """Axes of a grid around it."""
        low, high = self.tool.bounds(self.advance)
        return [np.arange(low[i] - BESIDE * step, high[i] + (BESIDE + 1) * step, step) for i in which]

    @property
    def _side(self) -> float:
        """1, or -1 for a tool that pushes the other wall."""
        return float(np.sign(self.tool.cleft.across @ self.cleft.across))
