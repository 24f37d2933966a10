"""Labels to tetrahedra by a lattice that is snapped onto the interfaces: no surface is made, any labels will do."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.labelmap import LabelMap
from ngbrain.mesh.elements import Elements
from ngbrain.mesh.indicators import SMOOTHING, Indicators
from ngbrain.mesh.octree import PER_CUBE, body_centred
from ngbrain.mesh.surfaces import Sizes
from ngbrain.mesh.guard import guarded
from ngbrain.mesh.shares import Shares
import time

Points = np.ndarray
MOST = 5e6
NEAR = 0.5
ROUNDS = 4
_EDGES = np.array(list(combinations(range(4), 2)))
_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])

@dataclass(frozen=True, eq=False)
class Lattice:
    elements: Elements
    snapped: int
    rejected: int


def lattice(labels: LabelMap, size: Sizes, smoothing: float = SMOOTHING, rounds=ROUNDS, log=lambda *a: None) -> Lattice:
    t0=time.time()
    low, high, finest = _box(labels, size)
    shares = Shares.of(Indicators.of(labels, smoothing))
    log('shares', time.time()-t0)
    points, tets = body_centred(low, high, size, finest)
    at = shares(points)
    number = at.argmax(axis=1)
    tets = tets[(number[tets] > 0).any(axis=1) ]
    points, tets = _used(points, tets)
    log('tets', len(tets), time.time()-t0)
    edges = _edges(tets)
    target, wanted = _crossings(shares, points, edges)
    log('crossings', wanted.sum(), time.time()-t0)
    points, done = guarded(points, tets, target)
    log('snapped', (done&wanted).sum(), time.time()-t0)
    region = _regions(shares, points, tets)
    log('regions', time.time()-t0)
    for i in range(rounds):
        step, on = _steps(shares, points, tets, region)
        points, done = guarded(points, tets, step)
        region = _regions(shares, points, tets)
        log('round', i, on.sum(), (done&on).sum(), time.time()-t0)
    el = _elements(points, tets, region, labels.regions)
    log('elements', time.time()-t0)
    return Lattice(el, int((done&on).sum()), int((on&~done).sum()))


def _box(labels: LabelMap, size: Sizes):
    inside = np.argwhere(labels.volume.data != 0)
    if not len(inside):
        raise InputError("labels", "0 in every voxel", "a region, at least")
    first, last = inside.min(axis=0) - 0.5, inside.max(axis=0) + 0.5
    corners = labels.volume.to_world(first + (last - first) * np.array(list(np.ndindex(2, 2, 2))))
    some = inside[:: max(1, len(inside) // 100_000)]
    asked = np.asarray(size(labels.volume.to_world(some)), float)
    if asked.shape != (len(some),) or not (np.isfinite(asked) & (asked > 0)).all():
        raise InputError("size", f"{asked.min():g} m somewhere" if asked.size else "empty", "a positive size for every point")
    count = PER_CUBE * labels.volume.voxel_volume * len(inside) * (asked**-3.0).mean()
    if count > MOST:
        raise InputError("size", f"so small that {count:.2g} tetrahedra would result", f"at most {MOST:.0g} of them")
    return corners.min(axis=0), corners.max(axis=0), float(asked.min())


def _used(points, tets):
    used, numbers = np.unique(tets, return_inverse=True)
    return points[used], numbers.reshape(-1, 4).astype(np.int32)


def _edges(tets):
    pairs = np.sort(tets[:, _EDGES].reshape(-1, 2), axis=1).astype(np.int64)
    keys = np.unique(pairs[:, 0] << 32 | pairs[:, 1])
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1)


def _root(shares, p, q, a, b):
    """Share t of the way from p to q at which s_a = s_b; s_a is larger at p, s_b at q."""
    i = np.arange(len(p))
    low, high = np.zeros(len(p)), np.ones(len(p))
    for _ in range(7):
        t = (low + high) / 2
        s = shares(p + t[:, None] * (q - p))
        first = s[i, a] > s[i, b]
        low, high = np.where(first, t, low), np.where(first, high, t)
    return (low + high) / 2


def _crossings(shares, points, edges):
    """Where each point close to an interface is to go, and which are."""
    number = shares(points).argmax(axis=1)
    p, q = edges[number[edges[:, 0]] != number[edges[:, 1]]].T
    a, b = number[p], number[q]
    t = _root(shares, points[p], points[q], a, b)
    place = points[p] + t[:, None] * (points[q] - points[p])
    s = shares(place)
    c = s.argmax(axis=1)
    third = (c != a) & (c != b) & (s.max(axis=1) > s[np.arange(len(s)), a] + 1e-3)
    # node, other region, place
    entries = [(p[~third], b[~third], place[~third], t[~third]), (q[~third], a[~third], place[~third], 1 - t[~third])]
    for n, own, tt in ((p, a, t), (q, b, 1 - t)):
        n, own, other, end, tt = n[third], own[third], c[third], place[third], tt[third]
        u = _root(shares, points[n], end, own, other)
        entries.append((n, other, points[n] + u[:, None] * (end - points[n]), u * tt))
    node, other, place, share = (np.concatenate(e) for e in zip(*entries))
    distance = np.linalg.norm(place - points[node], axis=1)
    order = np.lexsort([distance, node])
    order = order[share[order] <= NEAR]
    node, at = np.unique(node[order], return_index=True)
    chosen = order[at]
    start, place, other = points[node], place[chosen], other[chosen]
    found = _foot(shares, start, place, number[node], other)
    target = points.copy()
    target[node] = found
    wanted = np.zeros(len(points), bool)
    wanted[node] = True
    return target, wanted


def _foot(shares, start, place, a, b):
    """The point of the interface nearest to `start`, by a step from `place` on the interface."""
    value, slope = shares.difference(place, a, b)
    n = slope / np.maximum(np.linalg.norm(slope, axis=1), 1e-9)[:, None]
    foot = place + (start - place) - n * ((start - place) * n).sum(axis=1)[:, None]
    reach = np.linalg.norm(place - start, axis=1)
    for _ in range(2):
        value, slope = shares.difference(foot, a, b)
        steep = np.linalg.norm(slope, axis=1)
        step = value / np.maximum(steep, 1e-9)
        foot = foot - (np.clip(step, -0.3*reach, 0.3*reach) / np.maximum(steep, 1e-9))[:, None] * slope
    value, slope = shares.difference(foot, a, b)
    good = (np.abs(value) < 0.05) & (np.linalg.norm(slope, axis=1) > 30) & (np.linalg.norm(foot - start, axis=1) < reach)
    return np.where(good[:, None], foot, place)


_GAUSS = np.full((4, 4), 0.1381966011250105) + np.eye(4) * (0.5854101966249685 - 0.1381966011250105)

def _regions(shares, points, tets):
    total = np.zeros((len(tets), shares.count), np.float32)
    x = points[tets]
    for w in _GAUSS:
        total += shares(np.einsum("i,nij->nj", w, x))
    return total.argmax(axis=1)


def _steps(shares, points, tets, region):
    n, R = len(points), shares.count
    has = np.zeros((n, R), bool)
    for k in range(4):
        has[tets[:, k], region] = True
    on = np.flatnonzero(has.sum(axis=1) > 1)
    has = has[on]
    target = points.copy()
    edge = np.full(n, np.inf)
    e = _edges(tets)
    length = np.linalg.norm(points[e[:, 0]] - points[e[:, 1]], axis=1)
    for k in (0, 1):
        np.minimum.at(edge, e[:, k], length)
    x = points[on].copy()
    for _ in range(2):
        s, g = shares.slopes(x)
        best, move = np.full(len(on), -1.0), np.zeros((len(on), 3))
        for a, b in combinations(range(R), 2):
            i = np.flatnonzero(has[:, a] & has[:, b])
            value, slope = s[i, a] - s[i, b], g[i, a] - g[i, b]
            steep = np.linalg.norm(slope, axis=1)
            d = np.abs(value) / np.maximum(steep, 1e-9)
            better = d > best[i]
            i, d = i[better], d[better]
            best[i] = d
            move[i] = -(value[better] / np.maximum(steep[better], 1e-9)**2)[:, None] * slope[better]
        far = np.linalg.norm(move, axis=1)
        limit = 0.3 * edge[on]
        x += move * np.minimum(1, limit / np.maximum(far, 1e-12))[:, None]
    target[on] = x
    # others: to the middle of their neighbours
    free = np.ones(n, bool); free[on] = False
    near = np.zeros(n, bool); near[tets[(~free)[tets].any(axis=1)]] = True
    free &= near
    total, count = np.zeros((n, 3)), np.zeros(n)
    for k in (0, 1):
        count += np.bincount(e[:, k], minlength=n)
        for j in range(3):
            total[:, j] += np.bincount(e[:, k], points[e[:, 1 - k], j], n)
    # the lattice's own border stays
    target[free] = (0.5*points + 0.5*total / count[:, None])[free]
    mask = np.zeros(n, bool); mask[on] = True
    return target, mask


def _elements(points, tets, region, names):
    inside = region > 0
    points, tets = _used(points, tets[inside])
    region = region[inside].astype(np.int32)
    corners = tets[:, _FACES].reshape(-1, 3)
    owner = np.repeat(region, 4)
    srt = np.sort(corners, axis=1).astype(np.int64)
    order = np.lexsort(srt.T)
    corners, owner, srt = corners[order], owner[order], srt[order]
    same = (srt[1:] == srt[:-1]).all(axis=1)
    second = np.r_[False, same]
    twice = np.r_[same, False]
    other = np.where(twice, np.r_[owner[1:], 0], 0)
    # of two sides, the one of the earlier region
    first = np.flatnonzero(~second)
    a, b = owner[first], other[first]
    use = np.where((b > 0) & (b < a), first + 1, first)
    keep = a != b
    lo, hi = np.where(b == 0, 0, np.minimum(a, b))[keep], np.maximum(a, b)[keep]
    triangles = corners[use][keep]
    pairs, boundary = np.unique(np.stack([lo, hi], axis=1), axis=0, return_inverse=True)
    boundaries = tuple(("outer" if i == 0 else names[i - 1]) + "_" + names[j - 1] for i, j in pairs.tolist())
    return Elements(points, tets, region - 1, triangles.astype(np.int32), boundary.ravel().astype(np.int32), names, boundaries)
