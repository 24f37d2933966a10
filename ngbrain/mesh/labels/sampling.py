"""Sample points on interfaces and inside regions, spaced by a size field, for Delaunay meshing."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ngbrain.mesh.geometry.sizing import SizeField
from ngbrain.mesh.labels.indicators import Indicators

Points = np.ndarray
APART = 0.8
"""Smallest distance of samples as a part of the element size; a maximal set is then one size apart on average."""
CLEAR = 0.65
"""Smallest distance of interior samples from interfaces, as a part of the element size."""
THIRD = 0.2
"""Volume fraction of a third region on an interface from which a triple line is searched for."""
AROUND = 1.5
"""Largest distance of outside samples from the surface, as a part of the element size."""
TOGETHER = 512
"""Number of candidates whose neighbours are searched at once, which takes a third of the time."""
FILM = 1e-3
"""Extra distance of the two sides of a film: √6 times this (m), so that both get samples where elements are below 3 mm."""


def interface_points(indicators: Indicators) -> tuple[Points, np.ndarray]:
    """Points all over the interfaces, one for each pair of neighbouring voxels of two regions.

    Each lies between the two voxel centres, where the volume fractions of their regions are equal. Returns the points (n, 3) in
    m and the pairs of regions (n, 2).
    """
    fractions = indicators.fractions
    numbers = fractions.argmax(axis=0)
    found, pairs = [], []
    for axis in range(3):
        first = np.moveaxis(numbers, axis, 0)[:-1]
        second = np.moveaxis(numbers, axis, 0)[1:]
        i, j, k = np.nonzero(first != second)
        one, other = first[i, j, k], second[i, j, k]
        along = np.moveaxis(fractions, axis + 1, 1)
        here = along[one, i, j, k] - along[other, i, j, k]
        there = along[other, i + 1, j, k] - along[one, i + 1, j, k]
        at = np.stack([i + here / np.maximum(here + there, 1e-12), j, k], axis=1)
        found.append(np.insert(at[:, 1:], axis, at[:, 0], axis=1))
        pairs.append(np.stack([one, other], axis=1))
    voxels = np.concatenate(found)
    return voxels @ indicators.affine[:3, :3].T + indicators.affine[:3, 3], np.concatenate(pairs)


def sample_interfaces(indicators: Indicators, size: SizeField, rng: np.random.Generator) -> Points:
    """Sample the interfaces with points `APART` element sizes apart.

    A maximal random set (dart throwing), first on the triple lines. Of two points with normals n, m between regions a→b and c→d,
    those are neighbours for which |x - y|² + FILM² |n⊗(e_b - e_a) - m⊗(e_d - e_c)|² is small. The opposite sides of a film or
    sheet are therefore not neighbours, and only there are samples closer.

    Parameters
    ----------
    indicators : Indicators
        Smoothed indicators of the labels.
    size : SizeField
        Element size (m).
    rng : numpy.random.Generator
        Random numbers.

    Returns
    -------
    ndarray, shape (n, 3)
        Samples (m).
    """
    points, pairs = interface_points(indicators)
    lines, here = _triple_points(indicators, points)
    points, pairs = np.concatenate([lines, points]), np.concatenate([pairs[here], pairs])
    normals = indicators.normals(points, pairs)
    radius = APART * size(points)
    tree = cKDTree(points)
    taken = np.zeros(len(points), bool)
    chosen = []
    for i in np.concatenate([rng.permutation(len(lines)), len(lines) + rng.permutation(len(points) - len(lines))]):
        if taken[i]:
            continue
        chosen.append(i)
        near = np.array(tree.query_ball_point(points[i], radius[i]))
        a, b = pairs[i]
        (c, d), same = pairs[near].T, normals[near] @ normals[i]
        same = same * (1.0 * (b == d) + (a == c) - (a == d) - (b == c))
        apart = ((points[near] - points[i]) ** 2).sum(axis=1) + FILM**2 * (4 - 2 * same)
        taken[near[apart < radius[i] ** 2]] = True
    return points[chosen]


def _triple_points(indicators: Indicators, points: Points) -> tuple[Points, np.ndarray]:
    """Points (n, 3) on triple lines, and the interface points they come from."""
    fractions = indicators(points)
    if fractions.shape[1] < 3:
        return np.zeros((0, 3)), np.zeros(0, int)
    lowest = np.sort(fractions, axis=1)[:, -3]
    near = np.flatnonzero(lowest > THIRD)
    three = fractions[near] >= lowest[near, None]
    lines = indicators.project_to_interface(points[near], three, 4)
    fractions = indicators(lines)
    spread = np.where(three, fractions, -np.inf).max(axis=1) - np.where(three, fractions, np.inf).min(axis=1)
    there = spread < 0.02
    return lines[there], near[there]


def sample_interior(indicators: Indicators, size: SizeField, rng: np.random.Generator) -> Points:
    """Sample the interior with points `APART` element sizes from one another and `CLEAR` from all interfaces.

    There are also samples outside, within `AROUND` sizes of the surface, so that concave parts of it are not bridged.

    Parameters
    ----------
    indicators : Indicators
        Smoothed indicators of the labels.
    size : SizeField
        Element size (m).
    rng : numpy.random.Generator
        Random numbers.

    Returns
    -------
    ndarray, shape (n, 3)
        Samples (m).
    """
    candidates = _darts(indicators, size, rng)
    h = size(candidates)
    solid, away = indicators.region(candidates) > 0, np.full(len(candidates), np.inf)
    interfaces = cKDTree(interface_points(indicators)[0])
    for part, reach in (
        (solid, CLEAR),
        (~solid, AROUND),
    ):  # larger distances are not needed, and take longest to compute
        most = 1.001 * reach * h[part].max(initial=0.0)
        away[part] = interfaces.query(candidates[part], distance_upper_bound=most)[0]
    free = (away > CLEAR * h) & ((away < AROUND * h) | solid)
    candidates, h = candidates[free], h[free]
    tree = cKDTree(candidates)
    taken = np.zeros(len(candidates), bool)
    chosen = []
    for some in np.array_split(order := rng.permutation(len(candidates)), 1 + len(order) // TOGETHER):
        some = some[~taken[some]]  # removed candidates need no neighbour search
        for i, near in zip(some.tolist(), tree.query_ball_point(candidates[some], APART * h[some]), strict=True):
            if not taken[i]:
                chosen.append(i)
                taken[near] = True
    return candidates[chosen]


def _darts(indicators: Indicators, size: SizeField, rng: np.random.Generator) -> Points:
    """One random point in each cell of an octree with cells of 0.7 element sizes."""
    inside = np.argwhere(indicators.fractions[0] < 0.5)
    low, high = (indicators.affine[:3, :3] @ inside.min(axis=0), indicators.affine[:3, :3] @ inside.max(axis=0))
    low, high = np.minimum(low, high) + indicators.affine[:3, 3], np.maximum(low, high) + indicators.affine[:3, 3]
    around = AROUND * float(size(np.stack([low, high, (low + high) / 2])).max())
    low, high = low - around, high + around
    side = float((high - low).max())
    corners, found = low[None], []
    eighths = np.stack(np.meshgrid(*[[0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    while len(corners):
        large = side > 0.7 * size(corners + side / 2)
        leaves = corners[~large]
        found.append(leaves + side * rng.random(leaves.shape))
        side /= 2
        corners = (corners[large, None] + side * eighths).reshape(-1, 3)
        corners = corners[(corners < high).all(axis=1)]
    return np.concatenate(found)
