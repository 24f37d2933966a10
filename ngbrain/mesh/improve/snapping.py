"""Snapping of vertices to interfaces, and cuts of the edges that still cross one."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ngbrain.mesh.improve.guarded_moves import good
from ngbrain.mesh.labels.volume_fractions import VolumeFractions

Points = np.ndarray
_EDGES = np.array(list(combinations(range(4), 2)))
_HALVINGS = 4  # halvings of an edge before the Newton step
_FARTHEST = 0.3  # largest Newton step as a part of the edge
_STEEP = 0.1  # part of the usual slope above which a gradient direction is reliable
_CLEAR = 0.15  # smallest part of an edge on either side of a cut


def snap_targets(points: Points, tets: np.ndarray, fractions: VolumeFractions, slope: float) -> Points:
    """Target positions of vertices: on the interface that crosses one of their edges in the half nearer to them.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra.
    fractions : VolumeFractions
        Volume fractions of the regions.
    slope : float
        Usual slope of s_a - s_b across an interface (1/m).

    Returns
    -------
    ndarray, shape (n, 3)
        Targets (m); other vertices keep their position.
    """
    number = fractions(points).argmax(axis=1)
    p, q = _edges_between_regions(tets, number)
    a, b = number[p], number[q]
    place = _crossing_point(fractions, points[p], points[q], a, b)
    s = fractions(place)
    c, i = s.argmax(axis=1), np.arange(len(s))
    c = np.where(s[i, c] > np.maximum(s[i, a], s[i, b]) + 0.1, c, -1)
    third = np.flatnonzero(c >= 0)
    node, own, other, place = np.r_[p, q], np.r_[a, b], np.r_[b, a], np.r_[place, place]
    between = np.r_[third, third + len(p)]  # a third region crosses the edge and is met first
    other[between] = np.r_[c[third], c[third]]
    place[between] = _crossing_point(fractions, points[node[between]], place[between], own[between], other[between])
    distance = np.linalg.norm(place - points[node], axis=1)
    whole = np.linalg.norm(points[p] - points[q], axis=1)
    order = np.lexsort([distance, node])
    order = order[(distance <= 0.5 * np.r_[whole, whole])[order]]
    node, first = np.unique(node[order], return_index=True)
    chosen = order[first]
    target = points.copy()
    target[node] = _nearest_on_plane(fractions, slope, points[node], place[chosen], own[chosen], other[chosen])
    return target


def _crossing_point(fractions: VolumeFractions, p: Points, q: Points, a: np.ndarray, b: np.ndarray) -> Points:
    """Point (n, 3) with about equal fractions, between p with s_a > s_b and q without."""
    i, low, high = np.arange(len(p)), np.zeros(len(p)), np.ones(len(p))
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        s = fractions(p + middle[:, None] * (q - p))
        before = s[i, a] > s[i, b]
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return np.asarray(p + ((low + high) / 2)[:, None] * (q - p))


def _nearest_on_plane(
    fractions: VolumeFractions, usual: float, start: Points, place: Points, a: np.ndarray, b: np.ndarray
) -> Points:
    """Point nearest to `start` on the interface's tangent plane at `place`, and a Newton step; `place` where that is doubtful."""
    reach = np.linalg.norm(place - start, axis=1)
    value, slope, steep = _difference(fractions, place, a, b)
    normal = slope / steep[:, None]
    foot = start - ((start - place) * normal).sum(axis=1)[:, None] * normal
    value, slope, steep = _difference(fractions, foot, a, b)
    foot -= (np.clip(value / steep, -_FARTHEST * reach, _FARTHEST * reach) / steep)[:, None] * slope
    good = (steep > _STEEP * usual) & (np.linalg.norm(foot - start, axis=1) < reach)
    return np.where(good[:, None], foot, place)


def _difference(
    fractions: VolumeFractions, points: Points, a: np.ndarray, b: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """φ = s_a - s_b (n,), its gradient (n, 3) and the gradient's norm (n,), in 1/m."""
    values, gradients = fractions.slopes(points)
    i = np.arange(len(points))
    slope = gradients[i, a] - gradients[i, b]
    return values[i, a] - values[i, b], slope, np.maximum(np.linalg.norm(slope, axis=1), 1e-9)


def cut_edges(
    points: Points, tets: np.ndarray, fractions: VolumeFractions, scale: np.ndarray, longest: float
) -> tuple[Points, np.ndarray, np.ndarray]:
    """Split the edges that cross an interface well away from their ends.

    Edges are left alone if they are longer than `longest` or if a tetrahedron around them would become bad. Every tetrahedron is
    split at one edge at a time, so that tetrahedra with a common face are split alike.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra in Netgen's orientation.
    fractions : VolumeFractions
        Volume fractions of the regions.
    scale : ndarray, shape (n,)
        Element size at the vertices (m).
    longest : float
        Length of edges above which they are not split (m).

    Returns
    -------
    points, tets, scale : ndarray
        The mesh after the splits.
    """
    number = fractions(points).argmax(axis=1)
    work, tried = tets, np.zeros(0, np.int64)
    done: list[np.ndarray] = []
    while True:
        p, q = _edges_between_regions(work, number)
        length = np.linalg.norm(points[p] - points[q], axis=1)
        fresh = (length <= longest) & ~np.isin(p << 32 | q, tried)
        p, q, length = p[fresh], q[fresh], length[fresh]
        place = _crossing_point(fractions, points[p], points[q], number[p], number[q])
        along = np.linalg.norm(place - points[p], axis=1) / length
        clear = np.abs(along - 0.5) < 0.5 - _CLEAR
        p, q, place, along = p[clear], q[clear], place[clear], along[clear]
        if not len(p):
            return points, np.concatenate([*done, work]), scale
        t, e = _tets_with_edges(work, p << 32 | q)
        every = np.concatenate([points, place])
        halves = [np.where(work[t] == end[e][:, None], len(points) + e[:, None], work[t]) for end in (p, q)]
        fine = np.bincount(e, ~(good(every, halves[0]) & good(every, halves[1])), len(p)) == 0
        tried = np.union1d(tried, (p << 32 | q)[~fine])
        # Of the edges of a tetrahedron the one that is cut nearest to its middle comes first.
        rank = np.full(len(p), np.inf)
        rank[np.argsort(np.abs(along - 0.5), kind="stable")] = np.arange(len(p))
        rank[~fine] = np.inf
        first = np.full(len(work), np.inf)
        np.minimum.at(first, t, rank[e])
        chosen = fine & (np.bincount(e, first[t] != rank[e], len(p)) == 0)
        new = len(points) + np.cumsum(chosen) - 1
        mine = chosen[e]
        one, other = (np.where(half >= len(points), new[e][:, None], half)[mine] for half in halves)
        left = np.isfinite(first)
        work = work.astype(np.int64)
        work[t[mine]] = one
        done.append(work[~left])
        work = np.concatenate([work[left], other])
        points = np.concatenate([points, place[chosen]])
        scale = np.concatenate([scale, (scale[p] + scale[q])[chosen] / 2])
        number = np.concatenate([number, np.full(int(chosen.sum()), -1)])


def _tets_with_edges(tets: np.ndarray, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tetrahedra that contain an edge, given by sorted keys, and which one."""
    pairs = np.sort(tets[:, _EDGES].astype(np.int64), axis=2)
    mine = pairs[..., 0] << 32 | pairs[..., 1]
    at = np.minimum(np.searchsorted(keys, mine), len(keys) - 1)
    t, k = np.nonzero(keys[at] == mine)
    return t, at[t, k]


def _edges_between_regions(tets: np.ndarray, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends (n,), (n,) of the edges whose ends have different numbers."""
    p, q = tets[:, _EDGES].reshape(-1, 2).T.astype(np.int64)
    differ = (number[p] != number[q]) & (number[p] >= 0) & (number[q] >= 0)
    keys = np.unique(np.minimum(p, q)[differ] << 32 | np.maximum(p, q)[differ])
    return keys >> 32, keys & 0xFFFFFFFF
