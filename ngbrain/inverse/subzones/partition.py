"""Zones: overlapping boxes that wave data are cut into, and how maps of zones are joined.

Boxes are of whole cells of the body's lattice, so that a zone's elements are those that one inversion of the body has there: in
others the same data give maps that are as far apart as zones are. They come from cuts in two, each across the longest side, so
that zones have about as many points as their neighbours, and share the cells around a cut. There a zone's share of the joined map
falls from 1 smoothly to 0 at its face, where its answer is worst: all shares at a point sum up to 1.
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

Array = np.ndarray
FEWEST = 216
"""A zone, or a piece of one that touches none of its others, has more points than this: the smallest spline's coefficients."""
WIDE = 8
"""Points along each side of a zone's grid at least, those outside of the zone too: splines want as many."""
ON = 1e-6
"""Cells that a point may be off a face that it is on."""
TOUCHING = 1.8
"""Spacings between points that touch, those across the diagonal of a voxel too."""


@dataclass(frozen=True, eq=False)
class Zone:
    """One of them.

    points  (k,) which points of the data, growing
    share   (k,) of the joined map
    cells   its part of the body's lattice
    """

    points: Array
    share: Array
    cells: VoxelLattice


def cut_zones(
    data: WaveData, cells: VoxelLattice, size: Sequence[int] | Array, overlap: Sequence[int] | Array
) -> list[Zone]:
    """Zones of the points of the mask.

    size     (dim,) cells of a zone along each coordinate at most, its overlaps with neighbours included: more than `overlap`
    overlap  (dim,) cells that neighbours share; 0: none

    Points in pieces of no more than `FEWEST` are in no zone; the list is empty where all are.

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
            zones.append(Zone(numbers[near], box.shares(at[near], np.asarray(overlap)), _seen(cells, box, at[near])))
    return _normed(zones, len(data.points))


def zone_data(data: WaveData, zone: Zone, noise: RelativeNoise | None = None) -> tuple[WaveSubset, Array]:
    """The zone's data, on the grid's box around them where there is one, and the points of all data that these are.

    Its noise is that of all data, unless another one (of all points) is given.
    Cut faces are driven, the body's own border where the data say so. Truths are left out: what is compared with them is the
    joined map.
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
    """Σ share · value at each of n points (…, n), from values (…, k) of each zone; NaN where no zone has one.

    A zone without a value at a point (NaN) leaves it to the others.
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
    """Rms difference of two zones' values (k,) where they overlap, pairs weighted by their shares; 0 without an overlap.

    √(Σ s_a s_b (v_a - v_b)² / Σ s_a s_b) over points and pairs a, b there.

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


@dataclass(frozen=True, eq=False)
class ZoneBox:
    """Cells `first` to `end` along each coordinate, the last ones left out, and the cuts that it is between, in cells."""

    first: Array
    end: Array
    low: Array
    high: Array

    def contains(self, at: Array) -> Array:
        """Which points (n, dim), in cells, are in these cells or on their faces."""
        return np.all((at > self.first - ON) & (at < self.end + ON), axis=1)

    def shares(self, at: Array, overlap: Array) -> Array:
        """Shares of the points before all add up to 1; where other zones leave a point out, the least is all of it."""
        below = np.where(np.isinf(self.low), np.inf, at - self.first)
        above = np.where(np.isinf(self.high), np.inf, self.end - at)
        t = np.clip(np.minimum(below, above) / np.maximum(overlap, ON) + (overlap == 0), ON, 1)
        return np.prod(t**2 * (3 - 2 * t), axis=1)

    def crop(self, axis: int, first: int, end: int, low: float, high: float) -> ZoneBox:
        """The part along an axis."""
        parts = [each.copy() for each in (self.first, self.end, self.low, self.high)]
        for part, value in zip(parts, (first, end, low, high), strict=True):
            part[axis] = value
        return ZoneBox(*parts)


def _boxes(at: Array, box: ZoneBox, size: Array, overlap: Array) -> list[ZoneBox]:
    """Cuts in two until no box has more cells along a side than `size`; `at` (n, dim) are points, in cells."""
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


def _seen(cells: VoxelLattice, box: ZoneBox, at: Array) -> VoxelLattice:
    """The box's part of a lattice, without cells that no point `at` (n, dim) is in."""
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


def _normed(zones: list[Zone], n: int) -> list[Zone]:
    total = np.zeros(n)
    for zone in zones:
        total[zone.points] += zone.share
    return [Zone(z.points, z.share / total[z.points], z.cells) for z in zones]
