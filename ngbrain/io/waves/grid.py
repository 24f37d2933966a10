"""Points on a grid, and the boundary of scattered points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import Delaunay, QhullError

from ngbrain.errors import InputError
from ngbrain.look import BriefText

_OFF = 1e-3  # tolerance of a grid point, relative to the spacing: coordinates may have been float32
_WIDE = 3.0  # maximum circumradius of a simplex, relative to the median edge; larger ones bridge concave parts
_THIN = (
    0.2  # minimum height of a simplex, relative to the median edge, such as over points just behind their neighbours
)


@dataclass(frozen=True, eq=False, repr=False)
class Grid(BriefText):
    """A rectangular grid; its points are numbered along the first axis first (point i + n₀ (j + n₁ k)).

    Parameters
    ----------
    shape : tuple of int
        Points along each axis, at least 2.
    spacing : numpy.ndarray
        (d,) m.
    origin : numpy.ndarray
        (d,) m, the first point.
    axes : numpy.ndarray
        (d, d), the unit vector of axis i in row i; the identity if the grid is aligned with the coordinates.

    Examples
    --------
    >>> grid = Grid.from_points(np.array([[x, y] for y in (0.0, 2.0) for x in (0.0, 1.0, 2.0)]))
    >>> grid.shape, grid.spacing, grid.box(np.arange(6))[2].tolist()
    ((3, 2), array([1., 2.]), [2, 5])
    """

    shape: tuple[int, ...]
    spacing: np.ndarray
    origin: np.ndarray
    axes: np.ndarray

    @property
    def is_axis_aligned(self) -> bool:
        """Whether the axes of the grid are the coordinate axes, in order and direction."""
        return bool(np.abs(self.axes - np.eye(len(self.shape))).max() < _OFF)

    def box(self, values: np.ndarray) -> np.ndarray:
        """Reshape values (n, …) at the points to (n₀, n₁, …), one axis per axis of the grid."""
        return values.reshape(*self.shape, *values.shape[1:], order="F")

    def flat(self, box: np.ndarray) -> np.ndarray:
        """Invert `box`."""
        rest = box.shape[len(self.shape) :]
        return box.reshape(-1, *rest, order="F")

    def points(self) -> np.ndarray:
        """Points (n, d) m of the grid."""
        steps = np.indices(self.shape).reshape(len(self.shape), -1, order="F").T * self.spacing
        return self.origin + steps @ self.axes

    def coordinates(self, points: np.ndarray) -> np.ndarray:
        """Coordinates (n, d) m of points (n, d) m along the axes, from the first point."""
        return (points - self.origin) @ self.axes.T

    @staticmethod
    def from_points(points: np.ndarray) -> Grid | None:
        """The grid that points (n, d) m form in this order; None if they are no rectangular grid."""
        n, d = points.shape
        shape: list[int] = []
        steps: list[np.ndarray] = []
        done = 1
        for _ in range(d):
            line = points[::done]
            if n % done or len(line) < 2:
                return None
            # A line ends where the step to the next point changes.
            jumps = np.diff(line, axis=0)
            turned = np.linalg.norm(jumps - jumps[0], axis=1) > 0.1 * np.linalg.norm(jumps[0])
            count = int(turned.argmax()) + 1 if turned.any() else len(line)
            if count < 2:
                return None
            shape.append(count)
            steps.append((line[count - 1] - line[0]) / (count - 1))
            done *= count
        spacing = np.linalg.norm(steps, axis=1)
        if done != n or not spacing.all():
            return None
        axes = np.array(steps) / spacing[:, None]
        grid = Grid(tuple(shape), spacing, points[0], axes)
        off = np.abs(grid.points() - points).max() / spacing.min()
        square = np.abs(axes @ axes.T - np.eye(d)).max()
        return grid if off < _OFF and square < _OFF else None


def hull(points: np.ndarray, grid: Grid | None, mask: np.ndarray) -> np.ndarray:
    """Boundary points of a mask.

    On a grid: points with a neighbour along an axis that is outside the grid or the mask. Scattered points: the corners of the
    boundary of their Delaunay triangulation, after removing from outside the simplices whose circumradius exceeds three times
    the median edge, so that concave parts are found (holes are not), and flat simplices.

    Parameters
    ----------
    points : numpy.ndarray
        (n, d) m.
    grid : Grid or None
        Grid of the points; None if they are scattered.
    mask : numpy.ndarray
        (n,) bool.

    Returns
    -------
    numpy.ndarray
        (n,) bool.

    Raises
    ------
    InputError
        Scattered points lie on a line or a plane.

    Examples
    --------
    >>> grid = Grid.from_points(np.array([[x, y] for y in range(3) for x in range(4)], float))
    >>> grid.box(hull(grid.points(), grid, np.ones(12, bool)))[:, 1].tolist()
    [True, False, False, True]
    """
    if grid:
        inside = ndimage.binary_erosion(grid.box(mask))
        return mask & ~grid.flat(inside)
    border = np.zeros(len(points), bool)
    border[np.flatnonzero(mask)[_outside(points[mask])]] = True
    return border


def _outside(points: np.ndarray) -> np.ndarray:
    """Indices of the boundary points."""
    d = points.shape[1]
    try:
        mesh = Delaunay(points)
    except (QhullError, ValueError) as error:
        wanted = f"points that span a {'plane' if d == 2 else 'volume'}, or `dirichlet`"
        raise InputError("points", f"{len(points)}, on a line or plane", wanted) from error
    corners = points[mesh.simplices]
    edges = corners[:, 1:] - corners[:, :1]
    # The circumcentre c (from the first corner) has 2 eᵢ·c = |eᵢ|²; flat simplices have it far away.
    size = np.abs(np.linalg.det(edges))
    flat = size <= 1e-9 * np.linalg.norm(edges, axis=2).prod(axis=1)
    radius = np.full(len(edges), np.inf)
    squares = (edges[~flat] ** 2).sum(axis=2)
    radius[~flat] = np.linalg.norm(np.linalg.solve(2 * edges[~flat], squares[:, :, None])[:, :, 0], axis=1)
    length = np.linalg.norm(edges, axis=2)
    median = np.median(length)
    wide, thin = radius > _WIDE * median, size < _THIN * median * length.max(axis=1) ** (d - 1)
    gone = np.zeros(len(edges) + 1, bool)
    gone[-1] = True  # neighbour -1: outside
    while (peel := wide & ~gone[:-1] & gone[mesh.neighbors].any(axis=1)).any():
        gone[:-1] |= peel
    gone[:-1] |= thin & gone[mesh.neighbors].any(axis=1)  # once: further in, flat ones may lie beside each other
    simplex, facet = np.nonzero(gone[mesh.neighbors] & ~gone[:-1, None])
    opposite = np.arange(d + 1) != facet[:, None]
    return np.unique(mesh.simplices[simplex][opposite])
