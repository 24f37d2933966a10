"""Values at data points as pictures: images of grids, triangulations of scattered points, and middle planes of 3-D data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import Delaunay, KDTree

from ngbrain.io.waves import Grid, WaveData
from ngbrain.report.pictures.panel import ColourScale, Panel, SurfaceLayer, VolumeLayer
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


RELIEF = 0.12
"""Largest height of a wave drawn as relief, relative to the longer side of the data."""


def panel(data: WaveData, maps: Mapping[str, tuple[Floats, Floats]], cmap: str) -> Panel | None:
    """Maps to be turned: on movable planes of a grid in space, or on plane data raised by its wave.

    Parameters
    ----------
    data : WaveData
        The wave data.
    maps : mapping
        Label → values at all points of the data, and the two ends of their colours.
    cmap : str
        Colour map of matplotlib.

    Returns
    -------
    Panel or None
        None for scattered points in space, or a grid along other axes.
    """
    grid = data.grid
    scales = {
        label: ColourScale.of_map(label, float(ends[0]), float(ends[1]), cmap) for label, (_, ends) in maps.items()
    }
    layers: list[SurfaceLayer | VolumeLayer] = []
    if data.dim == 3:
        if grid is None or not grid.is_axis_aligned:
            return None
        for label, (values, _) in maps.items():
            box = np.asarray(grid.box(values), float)
            layers.append(VolumeLayer(label, box, grid.origin, grid.spacing, scales[label], shown=not layers))
        filled = np.argwhere(grid.box(data.mask))
        middle = grid.origin + grid.spacing * ((filled.min(axis=0) + filled.max(axis=0)) // 2)
        points, tris = _voxel_surface(grid.box(data.mask), grid)
        layers.append(SurfaceLayer("mask", points, tris, "#c8c8c8", opacity=0.12))
        caption = "Maps lie over each other on three planes: hide the first to see the next."
        return Panel(layers, "Maps in three dimensions", caption, toward=(0.7, -0.9, 0.6), focus=middle, head=False)
    wave = np.real(np.where(data.mask[:, None], data.displacement[0], np.nan))
    component = int(np.nanargmax([np.nanstd(each) if np.isfinite(each).any() else 0.0 for each in wave.T]))
    height = np.nan_to_num(wave[:, component])
    long = float(np.ptp(data.points, axis=0).max())
    raised = np.column_stack([data.points, RELIEF * long * height / max(float(np.abs(height).max()), 1e-300)])
    tris = _cells(grid, data.mask) if grid else _triangles(1e3 * data.points, data.mask)
    for label, (values, _) in maps.items():
        known = tris[np.isfinite(values)[tris].all(axis=1)]
        layers.append(SurfaceLayer(label, raised, known, values=values, scale=scales[label], shown=not layers))
    name = f"u{'xyz'[component]}" if len(data.components) > 1 else f"u{data.components[0]}"
    caption = f"The sheet is raised by the real part of {name} of the first load, not to scale; colours show the map."
    return Panel(layers, "Maps on the wave", caption, toward=(0.25, -0.8, 0.6), head=False)


def _cells(grid: Grid, mask: Bools) -> Ints:
    """Two triangles for each cell of a plane grid, where all its points are in the mask."""
    number = grid.box(np.arange(mask.size))
    a, b, c, d = (each.ravel() for each in (number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]))
    tris = np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c])])
    return np.asarray(tris[mask[tris].all(axis=1)])


def _voxel_surface(box: Bools, grid: Grid) -> tuple[Floats, Ints]:
    """Outer faces of the voxels of a mask: corners (m), triangles."""
    filled = np.pad(box, 1)
    quads = []
    for axis in range(3):
        ahead = np.diff(filled.astype(np.int8), axis=axis)
        at = np.argwhere(ahead != 0)  # between padded voxels i and i + 1: corner plane i of the unpadded ones
        at[:, [k for k in range(3) if k != axis]] -= 1
        u, v = (np.eye(3, dtype=int)[k] for k in range(3) if k != axis)
        quads.append(np.stack([at, at + u, at + v, at + u + v], axis=1))
    corners, number = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    a, b, c, d = number.reshape(-1, 4).T
    return grid.origin + (corners - 0.5) * grid.spacing, np.concatenate(
        [np.column_stack([a, b, c]), np.column_stack([b, d, c])]
    )


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
