"""Plane data on a raster of square cells, and the squares of it that an operator evaluates."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.io.waves import Grid, WaveData
from ngbrain.look import BriefText

Array = np.ndarray
LEAST = 26
"""Smallest number of points along an edge that an operator accepts."""
SQUARE = 1e-3
"""Relative difference of the sides of a cell up to which it counts as square."""
UPRIGHT = 1e-3
"""Components of a unit vector below this size are set to 0, so that an unmeasured component does not invalidate the other."""
GAIN = 0.1
"""Smallest fraction of a square that must be new."""
SMALLER = 0.7
"""Ratio of one square size to the next, where larger squares leave gaps."""
SPLINE = 4
"""Points around unmeasured ones that resampling invalidates."""


@dataclass(frozen=True, eq=False, repr=False)
class Raster(BriefText):
    """Displacements along the axes of a raster; arrays have y as first space axis.

    Parameters
    ----------
    spacing : float
        Distance of points (m).
    displacement : numpy.ndarray of shape (loads, ny, nx, 2)
        Displacement (m).
    counts : numpy.ndarray of shape (loads, ny, nx, 2)
        Mask of the measured components at valid points.
    places : numpy.ndarray of shape (n, 2)
        Row and column, not always integers, of the points of the data.
    axes : numpy.ndarray of shape (2, 2)
        Unit vectors of x and y in the coordinates of the data.
    notes : list of str, optional
        Remarks on resampling.
    """

    spacing: float
    displacement: Array
    counts: Array
    places: Array
    axes: Array
    notes: list[str] = field(default_factory=list)

    @staticmethod
    def from_data(data: WaveData) -> Raster:
        """Raster of data on a plane grid, or on one layer in space.

        Cells that are not square are resampled, which is noted. Raises `InputError` for points that form no plane
        grid.
        """
        points, u = data.points, data.displacement
        if data.dim == 3:
            flat = np.ptp(points, axis=0) < 1e-9
            if flat.sum() != 1:
                raise InputError(
                    "points", "in space", "a plane grid or one layer of it: the operator is trained for plane strain"
                )
            points, u = points[:, ~flat], u[..., ~flat]
        grid = Grid.from_points(points)
        if grid is None:
            raise InputError(
                "points", "no grid", "a plane grid, numbered along its first axis first: the operator accepts no other"
            )
        turn = np.where(np.abs(grid.axes) < UPRIGHT, 0, grid.axes)
        known = ~np.isnan(u)
        there = np.stack([(known | (row == 0)).all(axis=2) for row in turn], axis=2) & data.mask[:, None]
        moved = np.where(known, u, 0) @ turn.T

        def image(values: Array) -> Array:
            return np.stack([grid.box(each).swapaxes(0, 1) for each in values])

        fields, counts = image(np.where(there, moved, 0)), image(there)
        step = float(grid.spacing.min())
        shape, stretch = fields.shape[1:3], grid.spacing[::-1] / step
        places = np.indices(shape).reshape(2, -1).T * stretch  # numbered along x first
        notes = []
        if stretch.max() > 1 + SQUARE:
            cells = " × ".join(f"{1e3 * h:.4g}" for h in grid.spacing)
            fields, counts = _resampled(fields, counts, stretch)
            notes.append(
                f"cells of {cells} mm are not square: resampled by cubic splines to {1e3 * step:.4g} mm, "
                f"{counts.shape[2]} × {counts.shape[1]} points, and results are interpolated back"
            )
        return Raster(step, fields, counts, places, grid.axes, notes)

    def interpolate_to_points(self, image: Array) -> Array:
        """Linear interpolation of a map (ny, nx) to the points of the data (n,); NaN next to a NaN."""
        found = ndimage.map_coordinates(image, self.places.T, order=1, mode="nearest")
        near = np.rint(self.places).astype(int)
        whole = np.abs(self.places - near).max(axis=1) < 1e-6
        found[whole] = image[near[whole, 0], near[whole, 1]]  # zero times NaN is NaN
        return np.asarray(found)

    def transpose(self) -> Raster:
        """The raster with x and y exchanged."""
        u, counts = (each.swapaxes(1, 2)[..., ::-1] for each in (self.displacement, self.counts))
        return Raster(self.spacing, u, counts, self.places[:, ::-1], self.axes[::-1], self.notes)

    def flip(self) -> Raster:
        """The raster with y reversed; displacement components keep their directions."""
        places = np.array([self.counts.shape[1] - 1, 0]) + self.places * [-1, 1]
        return Raster(self.spacing, self.displacement[:, ::-1], self.counts[:, ::-1], places, self.axes, self.notes)


def squares(counts: Array, most: float = np.inf) -> list[tuple[int, int, int]]:
    """Squares that cover the valid points as far as possible.

    The squares are as large as fit, at most `most` points across, overlap by half, and fill gaps with smaller ones.
    There is one square where it holds all points.

    Parameters
    ----------
    counts : numpy.ndarray of shape (ny, nx)
        Mask of the valid points.
    most : float, default np.inf
        Largest number of points along an edge.

    Returns
    -------
    list of tuple of (int, int, int)
        (row, column, points along an edge) of each square.

    Raises
    ------
    InputError
        No square of `LEAST` points fits.

    Examples
    --------
    >>> squares(np.ones((51, 101), bool))
    [(0, 0, 51), (0, 25, 51), (0, 50, 51)]
    """
    size = _largest(counts)
    if size < LEAST:
        raise InputError(
            "points", f"measured in squares of at most {size} × {size}", f"{LEAST} × {LEAST} or more in one piece"
        )
    if counts.all() and counts.shape == (size, size):
        return [(0, 0, size)]
    size = int(max(LEAST, min(size, most)))
    found, left = [], counts.copy()
    low, high = np.argwhere(counts).min(axis=0), np.argwhere(counts).max(axis=0) + 1 - size
    rows, columns = (
        np.unique(np.linspace(a, b, 1 + -(-2 * (b - a) // size)).astype(int)) for a, b in zip(low, high, strict=True)
    )
    for row in rows:
        for column in columns:
            if counts[row : row + size, column : column + size].all():
                found.append((int(row), int(column), size))
                left[row : row + size, column : column + size] = False
    while size >= LEAST:
        fits = _sums(counts, size) == size**2
        gain = np.where(fits, _sums(left, size), 0)
        row, column = np.unravel_index(gain.argmax(), gain.shape)
        if gain[row, column] < GAIN * size**2:
            size = int(SMALLER * size)
            continue
        found.append((int(row), int(column), size))
        left[row : row + size, column : column + size] = False
    return found


def _largest(counts: Array) -> int:
    """Edge of the largest square of valid points."""
    best = np.zeros(np.add(counts.shape, 1), int)
    for row in range(counts.shape[0]):
        for column in range(counts.shape[1]):
            if counts[row, column]:
                around = best[row, column], best[row, column + 1], best[row + 1, column]
                best[row + 1, column + 1] = min(around) + 1
    return int(best.max())


def _sums(counts: Array, size: int) -> Array:
    """Number of valid points in each square of an edge, by its first row and column."""
    total = np.pad(counts.astype(int).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    return total[size:, size:] - total[:-size, size:] - total[size:, :-size] + total[:-size, :-size]


def _resampled(fields: Array, counts: Array, stretch: Array) -> tuple[Array, Array]:
    """Fields (loads, ny, nx, 2) and their masks at unit spacing, where neighbours are `stretch` (y, x) apart."""
    at = [np.arange(int((n - 1) * s + 1e-6) + 1) / s for n, s in zip(fields.shape[1:3], stretch, strict=True)]
    sure = np.array([[_erode(each) for each in load] for load in np.moveaxis(counts, -1, 1)], float)
    sure = np.moveaxis(sure, 1, -1)
    for axis, places in zip((1, 2), at, strict=True):
        own = np.arange(fields.shape[axis])
        fields = scipy.interpolate.CubicSpline(own, fields, axis=axis)(places)
        sure = scipy.interpolate.make_interp_spline(own, sure, k=1, axis=axis)(places)
    return fields, sure > 1 - 1e-6


def _erode(counts: Array) -> Array:
    """The mask without `SPLINE` points around invalid ones."""
    return counts if counts.all() else ~ndimage.binary_dilation(~counts, iterations=SPLINE)
