"""Values at data points as pictures: images of grids, triangulations of scattered points, and middle planes of 3-D data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import Delaunay, KDTree

from ngbrain.io.waves import Grid, WaveData
from ngbrain.report.render.surface import Floats, Ints

Bools = npt.NDArray[np.bool_]
LONGEST = 4.0
"""Longest edge of triangles between scattered points that are drawn, in median distances to a neighbour."""
SLAB = 0.8
"""Largest distance of scattered 3-D points from the plane they are drawn in, in median distances to a neighbour."""


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane part of the data.

    Parameters
    ----------
    name : str
        "x = 3.0 mm"; empty for plane data.
    chosen : ndarray of int, shape (k,)
        Numbers of the points.
    at : ndarray, shape (k, 2)
        Positions to the right and up (mm).
    shape : tuple of int or None
        Image size (right, up) if the points are a grid, numbered along its first axis first.
    triangles : ndarray of int or None
        Triangles between the points otherwise.
    axes : tuple of str
        Names of the two directions.
    """

    name: str
    chosen: Ints
    at: Floats
    shape: tuple[int, int] | None
    triangles: Ints | None
    axes: tuple[str, str]

    @property
    def extent(self) -> Floats:
        """Width and height (mm)."""
        return np.asarray(np.ptp(self.at, axis=0))

    def draw(self, axes: Any, values: Floats, look: Mapping[str, Any]) -> Any:
        """Draw values at the points; NaN stays blank.

        Parameters
        ----------
        axes : matplotlib.axes.Axes
            Axes to draw in.
        values : ndarray, shape (n,)
            Values at all points of the data.
        look : mapping of str to Any
            cmap, vmin and vmax.

        Returns
        -------
        matplotlib object
            Mappable for a colour bar.
        """
        shown = values[self.chosen]
        axes.set_aspect("equal")
        axes.tick_params(labelsize=7, length=2, pad=1.5)
        axes.set_facecolor("#e8e8e8")
        for spine in axes.spines.values():
            spine.set_visible(False)
        if self.shape:
            x, y = (_cell_corners(self.at[:, k].reshape(self.shape, order="F")) for k in (0, 1))
            return axes.pcolormesh(x, y, shown.reshape(self.shape, order="F"), rasterized=True, **look)
        assert self.triangles is not None
        known = self.triangles[np.isfinite(shown)[self.triangles].all(axis=1)]
        if not len(known):
            return axes.scatter(*self.at.T, c=shown, s=4, **look)
        return axes.tripcolor(
            *self.at.T, np.nan_to_num(shown), triangles=known, shading="gouraud", rasterized=True, **look
        )


def _cell_corners(centres: Floats) -> Floats:
    """Coordinates (m + 1, n + 1) of the corners of cells from those of their centres (m, n).

    Given centres, matplotlib requires a coordinate that increases along every line, which round-off prevents for a constant one.
    """
    wide = np.pad(centres, 1, mode="reflect", reflect_type="odd")
    return np.asarray((wide[1:, 1:] + wide[1:, :-1] + wide[:-1, 1:] + wide[:-1, :-1]) / 4)


def planes(data: WaveData) -> list[Plane]:
    """The plane of plane data; the three middle planes of the mask of 3-D data."""
    if data.dim == 2:
        return [_flat(data)]
    grid = data.grid
    return _layers(data, grid) if grid and grid.is_axis_aligned else _slabs(data)


def _flat(data: WaveData) -> Plane:
    at, n = 1e3 * data.points, np.arange(len(data.points))
    grid = data.grid
    if grid:
        return Plane("", n, at, (grid.shape[0], grid.shape[1]), None, ("x", "y"))
    return Plane("", n, at, None, _triangles(at, data.mask), ("x", "y"))


def _layers(data: WaveData, grid: Grid) -> list[Plane]:
    number = grid.box(np.arange(len(data.points)))
    filled = np.argwhere(grid.box(data.mask))
    middle = (filled.min(axis=0) + filled.max(axis=0)) // 2
    made = []
    for normal in range(3):
        right, up = (axis for axis in range(3) if axis != normal)
        chosen = np.take(number, middle[normal], axis=normal)
        where = 1e3 * (grid.origin + grid.spacing * middle)[normal]
        at = 1e3 * data.points[chosen.ravel(order="F")][:, [right, up]]
        shape = (chosen.shape[0], chosen.shape[1])
        made.append(Plane(_name(normal, where), chosen.ravel(order="F"), at, shape, None, ("xyz"[right], "xyz"[up])))
    return made


def _slabs(data: WaveData) -> list[Plane]:
    points = 1e3 * data.points
    among = points[data.mask]
    middle = (among.min(axis=0) + among.max(axis=0)) / 2
    thick = SLAB * _neighbour_distance(among)
    made = []
    for normal in range(3):
        right, up = (axis for axis in range(3) if axis != normal)
        chosen = np.flatnonzero((np.abs(points[:, normal] - middle[normal]) < thick) & data.mask)
        at, axes = points[chosen][:, [right, up]], ("xyz"[right], "xyz"[up])
        made.append(
            Plane(_name(normal, middle[normal]), chosen, at, None, _triangles(at, np.ones(len(at), bool)), axes)
        )
    return made


def _neighbour_distance(points: Floats) -> float:
    """Median distance to the nearest neighbour."""
    return float(np.median(KDTree(points).query(points, k=2)[0][:, 1]))


def _name(normal: int, where: float) -> str:
    return f"{'xyz'[normal]} = {where:.1f} mm".replace("-", "−")


def _triangles(at: Floats, mask: Bools) -> Ints:
    """Delaunay triangles between the points of a mask, without long ones across concave parts and holes."""
    chosen = np.flatnonzero(mask)
    if len(chosen) < 3:
        return np.zeros((0, 3), int)
    triangles = chosen[Delaunay(at[chosen], qhull_options="QJ").simplices]
    corners = at[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return np.asarray(triangles[longest < LONGEST * _neighbour_distance(at[chosen])])
