"""Retractors as rigid bodies with a signed distance; `make_tools` makes those of a scene.

- `base`: The interface `RigidTool`, and functions of the signed distance.
- `blades`: `Spatula` (also a plate), `Tube`, `Ball`.
- `closed_surface`: `ClosedSurface`, a tool from a surface file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ngbrain.io.surfacefile import read_surface
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.scene import Tool
from ngbrain.surgery.tools.base import HANDLE, RigidTool, SignedDistance, coordinates, patch
from ngbrain.surgery.tools.blades import Ball, Spatula, Tube
from ngbrain.surgery.tools.closed_surface import ClosedSurface

__all__ = [
    "HANDLE",
    "WALLS",
    "Ball",
    "ClosedSurface",
    "RigidTool",
    "SignedDistance",
    "Spatula",
    "Tube",
    "coordinates",
    "make_tools",
    "patch",
]

WALLS = ("wall_plus", "wall_minus")
"""The walls of a cleft: towards its `across`, pushed by one tool, and the opposite one, pushed by a second tool or a tube."""


def make_tools(tool: Tool, cleft: Cleft) -> Mapping[str, RigidTool]:
    """The rigid bodies that push the walls of a cleft; several tools share the travel of the scene.

    Parameters
    ----------
    tool : scene.Tool
    cleft : Cleft
        The first tool moves along its `across`.

    Returns
    -------
    mapping of RigidTool
        By wall.

    Raises
    ------
    InputError
        A file of a closed surface that cannot be read, or whose body does not fit into the cleft.

    Examples
    --------
    >>> cleft = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 30e-3, 4e-3, 12e-3)
    >>> {wall: float(each.cleft.across[0]) for wall, each in make_tools(Tool(kind="two spatulas"), cleft).items()}
    {'wall_plus': 1.0, 'wall_minus': -1.0}
    """
    plus, minus = WALLS
    other = replace(cleft, across=-cleft.across)
    if tool.kind == "tube":
        return {
            wall: Tube(side, tool.width, tool.edge_radius, tool.tip_clearance)
            for wall, side in ((plus, cleft), (minus, other))
        }
    if tool.kind == "ball":
        return {plus: Ball(cleft, tool.width, tool.tip_clearance)}
    if tool.kind == "surface":
        return {plus: ClosedSurface.from_mesh(read_surface(str(tool.file)), cleft, tool.tip_clearance, str(tool.file))}
    shape = (
        tool.width,
        tool.edge_radius,
        tool.tip_clearance,
        tool.thickness,
        tool.tip_width,
        tool.face_radius or np.inf,
    )
    blade = Spatula(cleft, *shape, tool.height or np.inf)
    return {plus: blade, minus: replace(blade, cleft=other)} if tool.kind == "two spatulas" else {plus: blade}
