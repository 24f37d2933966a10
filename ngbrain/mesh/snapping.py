"""Tetrahedra whose points go to where regions meet: the part of the `lattice` mesh that knows shares but no names."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from ngbrain.mesh.shares import Shares

Points = np.ndarray
FACES = np.array([[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]])
"""Corners of a tetrahedron's faces: outwards in Netgen's orientation."""
_EDGES = np.array(list(combinations(range(4), 2)))
_HALVINGS = 4  # of an edge until a Newton step is good enough
_BALANCINGS = 3
_FARTHEST = 0.3  # part of an element's size that a point may go in one step
_RELAXED = 0.5  # part of the way to the middle of the tetrahedra around
TANG = True
_STEEP = 0.1  # part of an interface's usual slope above which a direction is to be trusted
_DEEP = 0.999  # share at all corners with which a small tetrahedron is taken for inside a region
_LARGE = 4.0  # widths of an interface above which a tetrahedron is sampled at 20 points instead of 4
_STILL = 0.02  # part of an element's size below which its shares are not sampled again
_GAUSS = np.full((4, 4), (5 - 5**0.5) / 20) + np.eye(4) / 5**0.5
_MANY = (np.array([(i, j, k, 3 - i - j - k) for i, j, k in np.ndindex(4, 4, 4) if i + j + k <= 3]) + 0.25) / 4


@dataclass(eq=False)
class Net:
    """Points and tetrahedra among regions.

    points   (n, 3) m; tets (m, 4) in Netgen's orientation; `shares` of the regions, 0 is outside
    width    standard deviation (m) of an interface's blur
    bias     (regions + 1,), added to the shares times `weight` (n,) of the points, (size / largest size)²
    beside   (m, 4) tetrahedra across the FACES, -1 for none; scale (n,) edge (m) of the smallest cube at a point
    means    (m, regions + 1) mean shares in the tetrahedra, when their points were as `sampled` (n, 3)
    """

    points: Points
    tets: np.ndarray
    shares: Shares
    width: float
    bias: np.ndarray = field(init=False)
    beside: np.ndarray = field(init=False)
    scale: np.ndarray = field(init=False)
    weight: np.ndarray = field(init=False)
    means: np.ndarray = field(init=False)
    sampled: Points = field(init=False)

    def __post_init__(self) -> None:
        self.bias = np.zeros(self.shares.count)
        self.beside = _beside(self.tets)
        cubes = np.cbrt(12 * self.volumes())
        self.scale = np.full(len(self.points), np.inf)
        for k in range(4):
            np.minimum.at(self.scale, self.tets[:, k], cubes)
        self.weight = (self.scale / self.scale.max()) ** 2
        shares = self.shares(self.points)
        number, deep = shares.argmax(axis=1)[self.tets], (shares.max(axis=1) > _DEEP)[self.tets].all(axis=1)
        deep &= (number == number[:, :1]).all(axis=1) & (cubes < _LARGE * self.width)
        self.means = np.zeros((len(self.tets), self.shares.count), np.float32)
        self.means[np.arange(len(self.tets)), number[:, 0]] = 1
        self.sampled = np.where(np.isin(np.arange(len(self.points)), self.tets[~deep])[:, None], np.inf, self.points)

    @property
    def slope(self) -> float:
        """Of s_a - s_b across an interface (1/m)."""
        return float(2 / (np.sqrt(2 * np.pi) * self.width))

    def volumes(self) -> np.ndarray:
        """Of the tetrahedra (m,) in m³."""
        x = self.points.T[:, self.tets.T]
        a, b, c = (x[:, k] - x[:, 0] for k in (1, 2, 3))
        return np.asarray(np.abs((a * np.cross(b, c, axis=0)).sum(axis=0)) / 6)

    def _sample(self) -> None:
        """Mean shares in each tetrahedron, anew where points have moved."""
        moved = np.abs(self.points - self.sampled).max(axis=1) > _STILL * self.scale
        stale = moved[self.tets].any(axis=1)
        self.sampled = np.where(moved[:, None], self.points, self.sampled)
        large = self.scale[self.tets].min(axis=1) > _LARGE * self.width
        for which, weights in ((stale & ~large, _GAUSS), (stale & large, _MANY)):
            for at in np.array_split(np.flatnonzero(which), 1 + which.sum() // (1 << 15)):
                x = self.points[self.tets[at]]
                total = sum(self.shares(np.einsum("i,nij->nj", w, x)) for w in weights)
                self.means[at] = total / np.float32(len(weights))

    def _regions(self) -> np.ndarray:
        """Number (m,) of the region with the largest mean share in each tetrahedron.

        One that none of its neighbours agrees with takes the region of that neighbour which has the largest share in it.
        """
        score = self.means + self.weight[self.tets].mean(axis=1, dtype=np.float32)[:, None] * self.bias.astype(
            np.float32
        )
        region = score.argmax(axis=1)
        around = np.where(self.beside >= 0, region[self.beside], -1)
        lonely = np.flatnonzero((around != region[:, None]).all(axis=1) & (around >= 0).any(axis=1))
        offered = np.where(
            around[lonely] >= 0, np.take_along_axis(score[lonely], np.maximum(around[lonely], 0), 1), -np.inf
        )
        region[lonely] = around[lonely, offered.argmax(axis=1)]
        return np.asarray(region)

    def balance(self, wanted: np.ndarray, most: float) -> np.ndarray:
        """Bring the regions' volumes (regions + 1,) to those wanted (m³), that of outside apart, by `bias`; their `regions`.

        Newton's method: an interface moves by the difference of the biases over the slope, and takes its area times that
        from one region to the other. Shares are not linear, so steps are damped; `most` bounds the biases.
        """
        self._sample()
        volumes, n = self.volumes(), self.shares.count
        region = self._regions()
        for _ in range(_BALANCINGS):
            t, k, other = self.facing(region)
            x = self.points[self.tets[t[:, None], FACES[k]]]
            area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 2
            area *= self.weight[self.tets[t]].mean(axis=1)
            pair = region[t] * n + other
            flow = np.bincount(pair, area, n * n).reshape(n, n) / self.slope
            flow += flow.T
            gain = np.diag(flow.sum(axis=1) + 1e-6 * flow.sum()) - flow  # regions that have vanished among them
            missing = wanted - np.bincount(region, volumes, n)
            self.bias[1:] += 0.6 * np.linalg.solve(gain[1:, 1:], missing[1:])
            self.bias = self.bias.clip(-most, most)
            region = self._regions()
        return region

    def facing(self, region: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tetrahedra, their faces (numbers in FACES) between regions, and the other region there: each face once.

        From the region of the smaller number, but from inside where nothing lies beyond.
        """
        across = np.where(self.beside >= 0, region[self.beside], 0)
        t, k = np.nonzero((across > region[:, None]) | ((self.beside < 0) & (region > 0)[:, None]))
        return t, k, across[t, k]

    def crossings(self, near=0.5) -> Points:
        """Where the points (n, 3) are to go: onto the interface, if one cuts an edge of theirs in the half nearer to them."""
        number = self.shares(self.points).argmax(axis=1)
        p, q = _parted(self.tets, number)
        a, b = number[p], number[q]
        place = self._where(self.points[p], self.points[q], a, b)
        s = self.shares(place)
        c, i = s.argmax(axis=1), np.arange(len(s))
        c = np.where(s[i, c] > np.maximum(s[i, a], s[i, b]) + 0.1, c, -1)
        third = np.flatnonzero(c >= 0)
        node, own, other, place = np.r_[p, q], np.r_[a, b], np.r_[b, a], np.r_[place, place]
        between = np.r_[third, third + len(p)]  # a third region lies across the edge, and is met first
        other[between] = np.r_[c[third], c[third]]
        place[between] = self._where(self.points[node[between]], place[between], own[between], other[between])
        distance = np.linalg.norm(place - self.points[node], axis=1)
        whole = np.linalg.norm(self.points[p] - self.points[q], axis=1)
        order = np.lexsort([distance, node])
        order = order[(distance <= near*np.r_[whole, whole])[order]]
        node, first = np.unique(node[order], return_index=True)
        chosen = order[first]
        target = self.points.copy()
        target[node] = self._foot(self.points[node], place[chosen], own[chosen], other[chosen])
        return target

    def _where(self, p: Points, q: Points, a: np.ndarray, b: np.ndarray) -> Points:
        """Between p, where s_a > s_b, and q, where it is not: where they are about the same (n, 3)."""
        i, low, high = np.arange(len(p)), np.zeros(len(p)), np.ones(len(p))
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            s = self.shares(p + middle[:, None] * (q - p))
            before = s[i, a] > s[i, b]
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return np.asarray(p + ((low + high) / 2)[:, None] * (q - p))

    def _foot(self, start: Points, place: Points, a: np.ndarray, b: np.ndarray) -> Points:
        """What is nearest to `start` on the interface's tangent plane at `place`, and a Newton step; `place` where in doubt."""
        reach = np.linalg.norm(place - start, axis=1)
        value, slope, steep = self._difference(place, a, b)
        normal = slope / steep[:, None]
        foot = start - ((start - place) * normal).sum(axis=1)[:, None] * normal
        value, slope, steep = self._difference(foot, a, b)
        foot -= (np.clip(value / steep, -_FARTHEST * reach, _FARTHEST * reach) / steep)[:, None] * slope
        good = (steep > _STEEP * self.slope) & (np.linalg.norm(foot - start, axis=1) < reach)
        return np.where(good[:, None], foot, place)

    def _difference(self, points: Points, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """φ = s_a - s_b (n,), its gradient (n, 3) and the gradient's length (n,), in 1/m."""
        values, gradients = self.shares.slopes(points)
        i = np.arange(len(points))
        slope = gradients[i, a] - gradients[i, b]
        return values[i, a] - values[i, b], slope, np.maximum(np.linalg.norm(slope, axis=1), 1e-9)

    def steps(self, region: np.ndarray) -> tuple[Points, np.ndarray]:
        """Where the points (n, 3) are to go: those of interfaces, a mask (n,), onto these, their neighbours to the middle.

        Where more than two regions meet, to the interface that is farthest off.
        """
        has = np.zeros((len(self.points), self.shares.count), bool)
        for k in range(4):
            has[self.tets[:, k], region] = True
        border = has.sum(axis=1) > 1
        near = self.tets[border[self.tets].any(axis=1)]
        count = np.bincount(near.ravel(), minlength=len(self.points))
        middle = np.repeat(self.points[near].mean(axis=1), 4, axis=0)
        total = np.stack([np.bincount(near.ravel(), middle[:, j], len(count)) for j in range(3)], axis=1)
        relaxed = self.points + _RELAXED * (total / np.maximum(count, 1)[:, None] - self.points)
        target = np.where(count[:, None] > 0, relaxed, self.points)
        on, has = np.flatnonzero(border), has[border]
        x = target[on] if TANG else self.points[on]
        for _ in range(2):
            values, gradients = self.shares.slopes(x)
            values = values + self.weight[on, None] * self.bias
            farthest, move = np.full(len(on), -1.0), np.zeros((len(on), 3))
            for a, b in combinations(range(self.shares.count), 2):
                i = np.flatnonzero(has[:, a] & has[:, b])
                value, slope = values[i, a] - values[i, b], gradients[i, a] - gradients[i, b]
                steep = np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
                far = np.abs(value) / steep
                further = far > farthest[i]
                farthest[i[further]] = far[further]
                move[i[further]] = (-value / steep**2)[further, None] * slope[further]
            x += move * np.minimum(1, _FARTHEST * self.scale[on] / np.maximum(farthest, 1e-12))[:, None]
        target[on] = x
        return target, border


def _parted(tets: np.ndarray, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends (n,), (n,) of the edges whose ends have different numbers."""
    p, q = tets[:, _EDGES].reshape(-1, 2).T.astype(np.int64)
    differ = number[p] != number[q]
    keys = np.unique(np.minimum(p, q)[differ] << 32 | np.maximum(p, q)[differ])
    return keys >> 32, keys & 0xFFFFFFFF


def _beside(tets: np.ndarray) -> np.ndarray:
    faces = np.sort(tets[:, FACES].reshape(-1, 3), axis=1).astype(np.int64)
    keys = (faces[:, 0] << 42) | (faces[:, 1] << 21) | faces[:, 2]  # fewer than 2²¹ points: see octree.MOST
    order = np.argsort(keys)
    same = keys[order[1:]] == keys[order[:-1]]
    p, q = order[:-1][same], order[1:][same]
    beside = np.full(len(faces), -1)
    beside[p], beside[q] = q // 4, p // 4
    return beside.reshape(-1, 4)
