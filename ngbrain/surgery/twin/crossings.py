"""What the corridor of a plan crosses: the mid plane, named structures of a label map; how near fluid-filled spaces are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from ngbrain.image.read.label_map import LabelMap
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.surgery.corridor import corridor_findings
from ngbrain.surgery.model import RetractionModel
from ngbrain.units import to_ml

Array = np.ndarray
STEP = 1e-3
"""Spacing (m) of the points of a corridor,"""
NEAR = 3e-3
"""and distance (m) around it in which structures count as touched."""


def corridor_points(cleft: Cleft, margin: float = 0.0) -> Array:
    """Points on a grid of 1 mm in a cleft, from its floor to the surface.

    Parameters
    ----------
    cleft : Cleft
    margin : float
        By how much (m) it is widened at its sides.

    Returns
    -------
    (n, 3) array
        m.

    Examples
    --------
    >>> corridor_points(Cleft(np.zeros(3), np.eye(3)[2], np.eye(3)[0], 30e-3, 4e-3, 12e-3)).shape
    (1440, 3)
    """
    heights = np.arange(STEP / 2, cleft.depth, STEP)
    sides = [_between(size + 2 * margin) for size in (cleft.opening, cleft.width)]
    grid = np.array(np.meshgrid(*sides, heights, indexing="ij")).reshape(3, -1)
    axes = np.array([cleft.across, cleft.along, cleft.out])
    return np.asarray(cleft.target + grid.T @ axes)


def _between(size: float) -> Array:
    count = max(1, round(size / STEP))
    return (np.arange(count) + 0.5) * size / count - size / 2


def corridor_crossings(
    model: RetractionModel, fluids: Sequence[str] = (), structures: LabelMap | None = None
) -> dict[str, Any]:
    """What a plan's corridor crosses.

    Parameters
    ----------
    model : RetractionModel
    fluids : sequence of str
        Patterns of the regions that are filled with fluid.
    structures : LabelMap, optional
        Named structures in the head's own axes.

    Returns
    -------
    dict
        `depth_mm`, `entry_mm`, `target_mm`; `fluid_mm`, the distance to the nearest fluid-filled space; `findings`, of the mid
        plane, in words; `structures_ml` (structure → volume of the corridor in it) and `touched` (structures within 3 mm of it),
        None without a label map.
    """
    cleft = model.cleft
    found: dict[str, Any] = {
        "depth_mm": 1e3 * cleft.depth,
        "entry_mm": (1e3 * cleft.entry).tolist(),
        "target_mm": (1e3 * cleft.target).tolist(),
        "findings": corridor_findings(model),
        "structures_ml": None,
        "touched": None,
    }
    found["fluid_mm"] = fluid_distance(model, fluids)
    if structures is not None:
        inside = _volumes(structures, corridor_points(cleft))
        around = _volumes(structures, corridor_points(cleft, NEAR))
        found["structures_ml"] = inside
        found["touched"] = sorted(set(around) - set(inside))
    return found


def _volumes(structures: LabelMap, points: Array) -> dict[str, float]:
    """Structure → volume (ml) of the points in it."""
    numbers = structures.volume.interpolate(points, order=0).astype(int)
    each = STEP**3
    found = dict[str, float]()
    for number, count in zip(*np.unique(numbers, return_counts=True), strict=True):
        if number:
            name = structures.names[int(number)]
            found[name] = found.get(name, 0.0) + to_ml(each * count)
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def fluid_distance(model: RetractionModel, fluids: Sequence[str]) -> float | None:
    """Distance (mm) from the walls of a cleft to the nearest fluid-filled space.

    Parameters
    ----------
    model : RetractionModel
    fluids : sequence of str
        Patterns of the regions that are filled with fluid.

    Returns
    -------
    float or None
        None without such a region.
    """
    mesh = model.mesh
    names = [name for name in set(mesh.GetMaterials()) if any(re.fullmatch(each, name) for each in fluids)]
    corners = {v.nr for name in names for element in mesh.Materials(name).Elements() for v in element.vertices}
    if not corners:
        return None
    points = np.array([vertex.point for vertex in mesh.vertices])[sorted(corners)]
    return float(1e3 * model.cleft.distance_to_walls(points).min())
