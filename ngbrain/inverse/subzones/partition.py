"""Overlapping boxes of lattice cells for wave data, and weighted means of their maps.

Boxes consist of whole cells of the body's lattice. So the elements of a zone are those of an inversion of the whole body. In
other elements the same data give maps that differ as much as zones do.

The boxes come from recursive bisection across the longest side, so that neighbours have similar numbers of points. They share
the cells around a cut. There a zone's weight in the joined map falls smoothly from 1 to 0 at its face, where its result is
least accurate. The weights at a point sum to 1 (a partition of unity).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ngbrain.inverse.data.quality import RelativeNoise
from ngbrain.inverse.data.subset import WaveSubset
from ngbrain.inverse.problem.voxel_lattice import VoxelLattice
from ngbrain.io.waves import WaveData
from ngbrain.look import BriefText

Array = np.ndarray
FEWEST = 216
"""A zone, or a separate piece of one, has more points than this: the coefficients of the smallest spline."""
WIDE = 8
"""Fewest points along each side of a zone's grid, points outside the zone included: splines need as many."""
ON = 1e-6
"""Tolerance (cells) for points on a face."""
TOUCHING = 1.8
"""Distance (spacings) of points that touch, across a voxel's diagonal too."""


@dataclass(frozen=True, eq=False, repr=False)
class Zone(BriefText):
    """A zone.

    Parameters
    ----------
    points : numpy.ndarray
        (k,) increasing indices of its points in the data.
    share : numpy.ndarray
        (k,) its weight in the joined map.
    cells : VoxelLattice
        Its part of the body's lattice.
    """

    points: Array
    share: Array
    cells: VoxelLattice


def cut_zones(
    data: WaveData, cells: VoxelLattice, size: Sequence[int] | Array, overlap: Sequence[int] | Array
) -> list[Zone]:
    """Cut the points of the mask into overlapping zones.

    Points in pieces of no more than `FEWEST` are in no zone. The list is empty where all are.

    Parameters
    ----------
    data : WaveData
        The data.
    cells : VoxelLattice
        The body's lattice.
    size : sequence of int
        (dim,) most cells of a zone along each axis, overlaps included; more than `overlap`.
    overlap : sequence of int
        (dim,) cells that neighbours share; 0 for none.

    Returns
    -------
    list of Zone
        The zones.

    Examples
    --------
    >>> line = np.arange(19) * 2e-3
    >>> grid = np.array([[x, y, z] for z in line[:7] for y in line[:7] for x in line])
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 931, 3)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> cells = VoxelLattice((np.linspace(0, 0.036, 7), *[np.linspace(0, 0.012, 3)] * 2), np.ones((6, 2, 2), bool), "P3")
    >>> [(zone.cells.cells.shape, len(zone.points)) for zone in cut_zones(data, cells, [4] * 3, [2] * 3)]
    [((4, 2, 2), 637), ((4, 2, 2), 637)]
    """
    points = data.points[data.mask]
    at = np.stack(
        [np.interp(x, plane, np.arange(len(plane))) for x, plane in zip(points.T, cells.planes, strict=True)], 1
    )
    shape, far = np.array(cells.cells.shape), np.full(data.dim, np.inf)
    touching = TOUCHING * data.point_spacing
    zones, numbers = [], np.flatnonzero(data.mask)
    for box in _boxes(at, ZoneBox(0 * shape, shape, -far, far), np.asarray(size), np.asarray(overlap)):
        near = box.contains(at)
        near[near] = _in_large_pieces(points[near], touching)
        if near.any():
            zones.append(
                Zone(numbers[near], box.shares(at[near], np.asarray(overlap)), _crop_lattice(cells, box, at[near]))
            )
    return _normalise_shares(zones, len(data.points))


def zone_data(data: WaveData, zone: Zone, noise: RelativeNoise | None = None) -> tuple[WaveSubset, Array]:
    """Return the data of a zone, on the bounding box of a grid where there is one.

    Cut faces are driven; the body's own border is driven where the data say so. Truths are left out, because the joined map
    is compared with them.

    Parameters
    ----------
    data : WaveData
        All data.
    zone : Zone
        The zone.
    noise : RelativeNoise, optional
        Noise of all points; by default that of the data.

    Returns
    -------
    own : WaveSubset
        The zone's data.
    chosen : numpy.ndarray
        (k,) indices of its points in all data.
    """
    chosen = zone.points
    if data.grid:
        shape = data.grid.shape
        places = np.array(np.unravel_index(chosen, shape, order="F"))
        sides = [
            np.arange(max(0, min(a, n - WIDE)), min(n, max(b + 1, a + WIDE)))
            for a, b, n in zip(places.min(axis=1), places.max(axis=1), shape, strict=True)
        ]
        chosen = np.ravel_multi_index(np.meshgrid(*sides, indexing="ij"), shape, order="F").ravel(order="F")
    given = {each.name: getattr(data, each.name) for each in fields(WaveData)}
    fibre, labels = (None if given[name] is None else given[name][chosen] for name in ("fibre", "labels"))
    given |= {"points": data.points[chosen], "displacement": data.displacement[:, chosen], "fibre": fibre}
    level = data.noise if noise is None else noise
    given["noise"] = level[chosen] if isinstance(level, np.ndarray) else level
    given |= {"labels": labels, "mask": np.isin(chosen, zone.points), "dirichlet": None, "truth": {}, "affine": None}
    own = WaveSubset(**given, of_all=data.rms)
    free = data.border & ~data.dirichlet
    return replace(own, dirichlet=own.dirichlet & ~free[chosen]) if free.any() else own, chosen


def merge_values(zones: Sequence[Zone], values: Sequence[Array], n: int) -> Array:
    """Return the weighted mean of zones' values, Σ share · value.

    A zone without a value at a point (NaN) leaves the point to the others.

    Parameters
    ----------
    zones : sequence of Zone
        The zones.
    values : sequence of numpy.ndarray
        (…, k) values of each zone.
    n : int
        Number of points.

    Returns
    -------
    numpy.ndarray
        (…, n), NaN where no zone has a value.
    """
    shape = (*values[0].shape[:-1], n)
    total, weight = np.zeros(shape, values[0].dtype), np.zeros(shape)
    for zone, each in zip(zones, values, strict=True):
        known = ~np.isnan(each)
        total[..., zone.points] += np.where(known, zone.share * np.where(known, each, 0), 0)
        weight[..., zone.points] += np.where(known, zone.share, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 0, total / weight, np.nan)


def disagreement(zones: Sequence[Zone], values: Sequence[Array], n: int) -> float:
    """Return the rms difference of two zones' values where they overlap, √(Σ s_a s_b (v_a - v_b)² / Σ s_a s_b).

    The sums go over points and pairs a, b there.

    Parameters
    ----------
    zones : sequence of Zone
        The zones.
    values : sequence of numpy.ndarray
        (k,) values of each zone.
    n : int
        Number of points.

    Returns
    -------
    float
        The difference; 0 without an overlap.

    Examples
    --------
    >>> cells = VoxelLattice((np.arange(2),) * 3, np.ones((1, 1, 1), bool), "P3")
    >>> zones = [Zone(np.array([0, 1]), np.array([1, 0.5]), cells), Zone(np.array([1, 2]), np.array([0.5, 1]), cells)]
    >>> disagreement(zones, [np.array([1.0, 1.0]), np.array([1.5, 1.0])], 3)
    0.5
    """
    mean = merge_values(zones, values, n)
    square, share = np.zeros(n), np.zeros(n)
    total = np.zeros(n)
    for zone, each in zip(zones, values, strict=True):
        known = ~np.isnan(each)
        at, s = zone.points[known], zone.share[known]
        total[at] += s
        share[at] += s**2
        square[at] += s * np.abs(each[known] - mean[at]) ** 2
    pairs = float(np.sum(total**2 - share)) / 2
    return float(np.sqrt(np.sum(square * total) / pairs)) if pairs > 1e-9 else 0.0


@dataclass(frozen=True, eq=False, repr=False)
class ZoneBox(BriefText):
    """A box of cells between cuts.

    Parameters
    ----------
    first, end : numpy.ndarray
        (dim,) first cell, and the cell after the last, along each axis.
    low, high : numpy.ndarray
        (dim,) the cuts that bound the box, in cells; infinite where there is none.
    """

    first: Array
    end: Array
    low: Array
    high: Array

    def contains(self, at: Array) -> Array:
        """Which points (n, dim), in cells, lie in these cells or on their faces."""
        return np.all((at > self.first - ON) & (at < self.end + ON), axis=1)

    def shares(self, at: Array, overlap: Array) -> Array:
        """Return weights of points before they are normalised to a sum of 1.

        Where other zones leave a point out, the smallest weight becomes 1.

        Parameters
        ----------
        at : numpy.ndarray
            (n, dim) points, in cells.
        overlap : numpy.ndarray
            (dim,) shared cells.

        Returns
        -------
        numpy.ndarray
            (n,)
        """
        below = np.where(np.isinf(self.low), np.inf, at - self.first)
        above = np.where(np.isinf(self.high), np.inf, self.end - at)
        t = np.clip(np.minimum(below, above) / np.maximum(overlap, ON) + (overlap == 0), ON, 1)
        return np.prod(t**2 * (3 - 2 * t), axis=1)

    def crop(self, axis: int, first: int, end: int, low: float, high: float) -> ZoneBox:
        """Return the part of the box along an axis.

        Parameters
        ----------
        axis : int
            The axis.
        first, end : int
            New first cell, and the cell after the last.
        low, high : float
            New cuts, in cells.

        Returns
        -------
        ZoneBox
            The part.
        """
        parts = [each.copy() for each in (self.first, self.end, self.low, self.high)]
        for part, value in zip(parts, (first, end, low, high), strict=True):
            part[axis] = value
        return ZoneBox(*parts)


def _boxes(at: Array, box: ZoneBox, size: Array, overlap: Array) -> list[ZoneBox]:
    """Bisect until no box has more cells along a side than `size`; `at` (n, dim) are points, in cells."""
    inside = at[np.all((at > box.low) & (at < box.high), axis=1)]
    if not len(inside):
        return []
    near = at[box.contains(at)]
    first = np.maximum(box.first, np.floor(near.min(axis=0) + ON).astype(int))
    end = np.minimum(box.end, np.ceil(near.max(axis=0) - ON).astype(int))
    axis = int(np.argmax((end - first) / size))
    length, shared = int(end[axis] - first[axis]), int(overlap[axis])
    if length <= size[axis]:
        return [box]
    number = max(2, int(np.ceil((length - shared) / (size[axis] - shared))))
    starts = np.arange(first[axis] + 1, end[axis] - shared)
    middles = starts + shared / 2
    before = np.mean(inside[:, axis, None] < middles, axis=0)
    i = int(np.argmin(np.abs(before - (number // 2) / number)))
    start, middle = int(starts[i]), float(middles[i])
    left = box.crop(axis, box.first[axis], start + shared, box.low[axis], middle)
    right = box.crop(axis, start, box.end[axis], middle, box.high[axis])
    return _boxes(at, left, size, overlap) + _boxes(at, right, size, overlap)


def _crop_lattice(cells: VoxelLattice, box: ZoneBox, at: Array) -> VoxelLattice:
    """The box's part of a lattice, without cells that contain no point of `at` (n, dim)."""
    part = cells.crop(box.first, box.end)
    edges = [np.arange(n + 1) for n in part.cells.shape]
    counts = np.histogramdd(np.clip(at - box.first, 0, np.array(part.cells.shape)), edges)[0]
    return replace(part, cells=part.cells & (counts > 0))


def _in_large_pieces(points: Array, reach: float) -> Array:
    """Which points are in a piece of more than `FEWEST`."""
    i, j = KDTree(points).query_pairs(reach, output_type="ndarray").T
    touch = sp.coo_array((np.ones(len(i)), (i, j)), shape=(len(points), len(points)))
    piece = connected_components(touch, directed=False)[1]
    return np.bincount(piece)[piece] > FEWEST


def _normalise_shares(zones: list[Zone], n: int) -> list[Zone]:
    total = np.zeros(n)
    for zone in zones:
        total[zone.points] += zone.share
    return [Zone(z.points, z.share / total[z.points], z.cells) for z in zones]
