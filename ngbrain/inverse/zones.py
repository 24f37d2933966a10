"""Zones: overlapping boxes that wave data are cut into, and how maps of zones are joined.

Boxes come from cuts in two, each between points and across the longest side, so that zones have about as many points as their
neighbours. They reach half an overlap beyond their cuts. There a zone's share of the joined map falls from 1 smoothly to 0 at
its face, where its answer is worst: all shares at a point sum up to 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ngbrain.io.waves import WaveData

Array = np.ndarray
FEWEST = 216
"""A zone, or a piece of one that touches none of its others, has more points than this: the smallest spline's coefficients."""
WIDE = 8
"""Points along each side of a zone's grid at least, those outside of the zone too: splines want as many."""
TOUCHING = 1.8
"""Spacings between points that touch, those across the diagonal of a voxel too."""


@dataclass(frozen=True, eq=False)
class Zone:
    """One of them.

    points  (k,) which points of the data, growing
    share   (k,) of the joined map
    low, high  (dim,) m, the box that it reaches to
    """

    points: Array
    share: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class PartOfWaves(WaveData):
    """Wave data of a zone, whose noise is relative to the rms of all data: (loads, 1, dim) m."""

    of_all: Array = None  # type: ignore[assignment]

    @property
    def rms(self) -> Array:
        """That of all data."""
        return self.of_all


def cut(data: WaveData, size: float, overlap: float) -> list[Zone]:
    """Zones of the points of the mask.

    size     m, longest side of a zone, its overlaps with neighbours included
    overlap  m, how deep neighbours reach into each other; 0: not at all

    Points in pieces of no more than `FEWEST` are in no zone; the list is empty where all are.

    >>> line = np.arange(20) * 2e-3
    >>> grid = np.array([[x, y, z] for z in line[:8] for y in line[:8] for x in line])
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 1280, 3)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> [len(zone.points) for zone in cut(data, size=0.024, overlap=0.008)]
    [768, 768]
    """
    points = data.points[data.mask]
    low, high = np.full(data.dim, -np.inf), np.full(data.dim, np.inf)
    touching = TOUCHING * spacing(data)
    zones, numbers = [], np.flatnonzero(data.mask)
    for a, b in _boxes(points, low, high, size, overlap):
        near = _within(points, a, b, overlap)
        near[near] = _in_large_pieces(points[near], touching)
        if near.any():
            reach = [
                np.where(np.isinf(end), points[near].min(axis=0) if sign < 0 else points[near].max(axis=0), end + grown)
                for sign, end, grown in ((-1, a, -overlap / 2), (1, b, overlap / 2))
            ]
            zones.append(Zone(numbers[near], _ramps(points[near], a, b, overlap), *reach))
    return _normed(zones, len(data.points))


def spacing(data: WaveData) -> float:
    """Median distance (m) of points of the mask from the nearest other one."""
    points = data.points[data.mask]
    return float(np.median(KDTree(points).query(points, k=2)[0][:, 1]))


def part(data: WaveData, zone: Zone) -> tuple[PartOfWaves, Array]:
    """The zone's data, on the grid's box around them where there is one, and the points of all data that these are.

    Truths are left out: what is compared with them is the joined map.
    """
    chosen = zone.points
    if data.structured:
        shape = data.structured.shape
        places = np.array(np.unravel_index(chosen, shape, order="F"))
        sides = [
            np.arange(max(0, min(a, n - WIDE)), min(n, max(b + 1, a + WIDE)))
            for a, b, n in zip(places.min(axis=1), places.max(axis=1), shape, strict=True)
        ]
        chosen = np.ravel_multi_index(np.meshgrid(*sides, indexing="ij"), shape, order="F").ravel(order="F")
    given = {each.name: getattr(data, each.name) for each in fields(WaveData)}
    fibre, labels = (None if given[name] is None else given[name][chosen] for name in ("fibre", "labels"))
    given |= {"points": data.points[chosen], "displacement": data.displacement[:, chosen], "fibre": fibre}
    given |= {"labels": labels, "mask": np.isin(chosen, zone.points), "dirichlet": None, "truth": {}, "affine": None}
    return PartOfWaves(**given, of_all=data.rms), chosen


def joined(zones: Sequence[Zone], values: Sequence[Array], n: int) -> Array:
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

    >>> zones = [Zone(np.array([0, 1]), np.array([1, 0.5]), *np.eye(2)), Zone(np.array([1, 2]), np.array([0.5, 1]), *np.eye(2))]
    >>> disagreement(zones, [np.array([1.0, 1.0]), np.array([1.5, 1.0])], 3)
    0.5
    """
    mean = joined(zones, values, n)
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


def _boxes(points: Array, low: Array, high: Array, size: float, overlap: float) -> list[tuple[Array, Array]]:
    """Cuts in two until no box is longer than `size` with what it gains at its cut faces."""
    inside = points[np.all((points > low) & (points < high), axis=1)]
    if not len(inside):
        return []
    length = np.ptp(points[_within(points, low, high, overlap)], axis=0)
    axis = int(np.argmax(length))
    if length[axis] <= size * (1 + 1e-9):
        return [(low, high)]
    number = max(2, int(np.ceil((length[axis] - overlap) / (size - overlap) - 1e-9)))
    values, counts = np.unique(inside[:, axis], return_counts=True)
    if len(values) < 2:
        return [(low, high)]
    before = np.cumsum(counts)[:-1] / len(inside)
    i = int(np.argmin(np.abs(before - (number // 2) / number)))
    plane = (values[i] + values[i + 1]) / 2
    upper, lower = high.copy(), low.copy()
    upper[axis] = lower[axis] = plane
    return _boxes(points, low, upper, size, overlap) + _boxes(points, lower, high, size, overlap)


def _within(points: Array, low: Array, high: Array, overlap: float) -> Array:
    return np.all((points > low - overlap / 2) & (points < high + overlap / 2), axis=1)


def _in_large_pieces(points: Array, reach: float) -> Array:
    """Which points are in a piece of more than `FEWEST`."""
    i, j = KDTree(points).query_pairs(reach, output_type="ndarray").T
    touch = sp.coo_array((np.ones(len(i)), (i, j)), shape=(len(points), len(points)))
    piece = connected_components(touch, directed=False)[1]
    return np.bincount(piece)[piece] > FEWEST


def _ramps(points: Array, low: Array, high: Array, overlap: float) -> Array:
    if not overlap:
        return np.ones(len(points))
    depth = np.minimum(points - (low - overlap / 2), (high + overlap / 2) - points) / overlap
    t = np.clip(depth, 0, 1)
    return np.prod(t**2 * (3 - 2 * t), axis=1)


def _normed(zones: list[Zone], n: int) -> list[Zone]:
    total = np.zeros(n)
    for zone in zones:
        total[zone.points] += zone.share
    return [Zone(z.points, z.share / total[z.points], z.low, z.high) for z in zones]
