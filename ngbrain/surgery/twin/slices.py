"""Plane sections of a head through the plans' targets, as small grids for figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ngbrain.forward.common.interpolation import points_in_mesh
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.twin.stiffness import RelativeStiffness

STEPS = 72
"""Points along the longer side of a section."""
PLANES = {"from the right": (0, 1, 2), "from the front": (1, 0, 2), "from above": (2, 0, 1)}
"""View → axes: normal to the plane, across, up."""


def head_slices(models: Mapping[str, RetractionModel], stiffness: RelativeStiffness) -> list[dict[str, Any]]:
    """Regions and relative stiffness on three planes through the middle of the targets.

    Parameters
    ----------
    models : mapping of RetractionModel
        By plan; the first one's mesh is cut.
    stiffness : RelativeStiffness

    Returns
    -------
    list of dict
        `view`, `axes`, `at_mm`, `extent_mm` (left, right, bottom, top), `region` (rows from the bottom: number of the region from
        0, -1 outside), `regions` (their names) and `ratio` (map over its reference, None without a map or outside).
    """
    mesh = next(iter(models.values())).mesh
    middle = np.mean(
        [model.cleft.target + model.cleft.depth / 2 * model.cleft.out for model in models.values()], axis=0
    )
    corners = np.array([vertex.point for vertex in mesh.vertices])
    low, high = corners.min(axis=0), corners.max(axis=0)
    names = list(dict.fromkeys(mesh.GetMaterials()))
    number = mesh.MaterialCF({name: float(i) for i, name in enumerate(names)}, default=-1.0)
    found = []
    for view, (normal, across, up) in PLANES.items():
        step = max(high[across] - low[across], high[up] - low[up]) / STEPS
        sides = [np.arange(low[axis] + step / 2, high[axis], step) for axis in (across, up)]
        points = np.empty((len(sides[1]), len(sides[0]), 3))
        points[..., normal] = middle[normal]
        points[..., across], points[..., up] = np.meshgrid(*sides)
        flat = points.reshape(-1, 3)
        inside = points_in_mesh(mesh, flat)
        region = np.full(len(flat), -1)
        region[inside] = np.ravel(number(mesh(*flat[inside].T))).round().astype(int)
        ratio = np.full(len(flat), np.nan)
        if stiffness.measured is not None:
            ratio[inside] = np.exp(stiffness.log_map(flat[inside]))
        shape = points.shape[:2]
        found.append(
            {
                "view": view,
                "axes": [across, up],
                "at_mm": float(1e3 * middle[normal]),
                "extent_mm": [
                    float(1e3 * each)
                    for axis, side in ((across, sides[0]), (up, sides[1]))
                    for each in (low[axis], side[-1] + step / 2)
                ],
                "region": region.reshape(shape).tolist(),
                "regions": names,
                "ratio": np.round(ratio, 3).reshape(shape).tolist() if stiffness.measured is not None else None,
            }
        )
    return found
