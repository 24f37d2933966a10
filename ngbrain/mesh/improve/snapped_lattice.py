"""A lattice of tetrahedra whose vertices are moved onto the interfaces of volume fractions, without names of regions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from ngbrain.look import BriefText
from ngbrain.mesh.labels.volume_fractions import VolumeFractions
from ngbrain.mesh.labels.volume_zones import everywhere

Points = np.ndarray
FACES = np.array([[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]])
"""Corners of a tetrahedron's faces, oriented outwards in Netgen's orientation."""
_DAMPED = 0.5
_OUTSIDE_AREA = 0.03  # extra area to the outside of each region, as a part of its interfaces' area
_MOST_BIAS = 0.37  # largest bias of a volume fraction: beyond it, a bias no longer measures a distance
_FARTHEST = 0.3  # part of an element's size that a vertex may move in one step
_ON = 0.05  # part of an element's size up to which a vertex is on an interface
_RELAXED = 0.3  # part of the way to the middle of the tetrahedra around
_DEEP = 0.999  # volume fraction at all corners from which a small tetrahedron is inside a region
_LARGE = 4.0  # widths of an interface above which a tetrahedron is sampled at 20 points instead of 4
_NO_MOVE = 0.02  # move, as a part of the element size, below which fractions are not sampled again
_PEELED = 3  # layers of a spike that are removed
_GAUSS = np.full((4, 4), (5 - 5**0.5) / 20) + np.eye(4) / 5**0.5
_MANY = (np.array([(i, j, k, 3 - i - j - k) for i, j, k in np.ndindex(4, 4, 4) if i + j + k <= 3]) + 0.25) / 4


@dataclass(eq=False, repr=False)
class SnappedLattice(BriefText):
    """Vertices and tetrahedra on a field of volume fractions.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra in Netgen's orientation.
    fractions : VolumeFractions
        Volume fractions of the regions; 0 is outside.
    width : float
        Standard deviation (m) of the blur of an interface.
    scale : ndarray, shape (n,)
        Edge (m) of the smallest cube at each vertex.
    zone : callable
        Points (n, 3) → weights of the zones (n, zones), which add up to 1; volumes are balanced in each zone.

    Attributes
    ----------
    bias : ndarray, shape (zones, regions + 1)
        Added to the volume fractions times `weight`.
    weight : ndarray, shape (n,)
        Size over largest size at the vertices.
    beside : ndarray of int, shape (m, 4)
        Tetrahedra across the `FACES`; -1 for none.
    means : ndarray, shape (m, regions + 1)
        Mean volume fractions in the tetrahedra, for vertices at `sampled`.
    sampled : ndarray, shape (n, 3)
        Positions at the last sampling (m).
    """

    points: Points
    tets: np.ndarray
    fractions: VolumeFractions
    width: float
    scale: np.ndarray
    zone: Callable[[Points], np.ndarray] = everywhere
    bias: np.ndarray = field(init=False)
    beside: np.ndarray = field(init=False)
    weight: np.ndarray = field(init=False)
    means: np.ndarray = field(init=False)
    sampled: Points = field(init=False)

    def __post_init__(self) -> None:
        self.bias = np.zeros((self.zone(self.points[:1]).shape[1], self.fractions.count))
        self.beside = _neighbours(self.tets)
        cubes = np.cbrt(12 * volumes(self.points, self.tets))
        self.weight = self.scale / self.scale.max()
        fractions = self.fractions(self.points)
        number, deep = fractions.argmax(axis=1)[self.tets], (fractions.max(axis=1) > _DEEP)[self.tets].all(axis=1)
        deep &= (number == number[:, :1]).all(axis=1) & (cubes < _LARGE * self.width)
        self.means = np.zeros((len(self.tets), self.fractions.count), np.float32)
        self.means[np.arange(len(self.tets)), number[:, 0]] = 1
        self.sampled = np.where(np.isin(np.arange(len(self.points)), self.tets[~deep])[:, None], np.inf, self.points)

    @property
    def slope(self) -> float:
        """Slope of the difference s_a - s_b across an interface (1/m)."""
        return slope_across(self.width)

    def bias_at_points(self) -> np.ndarray:
        """Bias of the volume fractions at the vertices (n, regions + 1)."""
        return (self.weight[:, None] * (self.zone(self.points) @ self.bias)).clip(-_MOST_BIAS, _MOST_BIAS)

    def _sample(self) -> None:
        """Update the mean volume fractions of the tetrahedra whose vertices have moved."""
        moved = np.abs(self.points - self.sampled).max(axis=1) > _NO_MOVE * self.scale
        stale = moved[self.tets].any(axis=1)
        self.sampled = np.where(moved[:, None], self.points, self.sampled)
        large = self.scale[self.tets].min(axis=1) > _LARGE * self.width
        for which, weights in ((stale & ~large, _GAUSS), (stale & large, _MANY)):
            for at in np.array_split(np.flatnonzero(which), 1 + which.sum() // (1 << 15)):
                x = self.points[self.tets[at]]
                total = sum(self.fractions(np.einsum("i,nij->nj", w, x)) for w in weights)
                self.means[at] = total / np.float32(len(weights))

    def _regions(self) -> np.ndarray:
        """Region (m,) with the largest mean volume fraction in each tetrahedron.

        A tetrahedron that agrees with none of its neighbours takes the region of the neighbour with the largest fraction in it.
        """
        lift = self.bias_at_points().astype(np.float32)
        score = self.means + sum(lift[corner] for corner in self.tets.T) / np.float32(4)
        region = score.argmax(axis=1)
        around = np.where(self.beside >= 0, region[self.beside], -1)
        lonely = np.flatnonzero((around != region[:, None]).all(axis=1) & (around >= 0).any(axis=1))
        offered = np.where(
            around[lonely] >= 0, np.take_along_axis(score[lonely], np.maximum(around[lonely], 0), 1), -np.inf
        )
        region[lonely] = around[lonely, offered.argmax(axis=1)]
        return self._remove_spikes(np.asarray(region))

    def _remove_spikes(self, region: np.ndarray) -> np.ndarray:
        """Remove spikes: tetrahedra with three or more faces to the outside."""
        for _ in range(_PEELED):
            across = np.where(self.beside >= 0, region[self.beside], 0)
            region = np.where((across == 0).sum(axis=1) >= 3, 0, region)
        return region

    def balance(self, wanted: np.ndarray, most: float) -> np.ndarray:
        """Update the bias so that the regions get their target volumes.

        A Newton step in each zone: an interface moves by the difference of the biases over the slope, and transfers its
        area times that distance from one region to the other. Volume fractions are not linear, so the step is damped. All
        regions of a zone are slightly damped together, because a zone that hardly touches the outside cannot enlarge all
        its regions.

        Parameters
        ----------
        wanted : ndarray, shape (zones, regions)
            Target volumes (m³).
        most : float
            Bound on the biases.

        Returns
        -------
        ndarray of int, shape (m,)
            Region of each tetrahedron.
        """
        self._sample()
        size, n = volumes(self.points, self.tets), self.fractions.count
        region = self._regions()
        t, k, other = self.interface_faces(region)
        x = self.points[self.tets[t[:, None], FACES[k]]]
        area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 2
        area *= self.weight[self.tets[t]].mean(axis=1)
        pair, zones = region[t] * n + other, np.mean([self.zone(w @ self.points[self.tets]) for w in _GAUSS], axis=0)
        for bias, mine, volume in zip(self.bias, zones.T, wanted, strict=True):
            flow = np.bincount(pair, area * mine[t], n * n).reshape(n, n) / self.slope
            flow += flow.T
            if not flow.any():  # a zone inside one region
                continue
            gain = (
                np.diag((1 + _OUTSIDE_AREA) * flow.sum(axis=1) + 1e-6 * flow.sum()) - flow
            )  # regions that have vanished too
            missing = volume - np.bincount(region, size * mine, n)[1:]
            bias[1:] += _DAMPED * np.linalg.solve(gain[1:, 1:], missing)
        self.bias = self.bias.clip(-most, most)
        return self._regions()

    def volume_errors(self, region: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Relative volume errors of the regions.

        Parameters
        ----------
        region : ndarray of int, shape (m,)
            Region of each tetrahedron.
        wanted : ndarray, shape (regions,)
            Target volumes (m³).

        Returns
        -------
        ndarray, shape (regions,)
            Absolute errors as parts of the targets.
        """
        found = np.bincount(region, volumes(self.points, self.tets), self.fractions.count)[1:]
        return np.asarray(abs(found / wanted - 1))

    def interface_faces(self, region: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tetrahedra, their faces (numbers in `FACES`) between regions, and the other region there, each face once.

        Seen from the region with the smaller number, and from inside where the other side is outside.
        """
        across = np.where(self.beside >= 0, region[self.beside], 0)
        t, k = np.nonzero((across > region[:, None]) | ((self.beside < 0) & (region > 0)[:, None]))
        return t, k, across[t, k]

    def adjacent_regions(self, region: np.ndarray) -> np.ndarray:
        """Regions (n, regions + 1) of the tetrahedra around each vertex, if there is more than one."""
        has = np.zeros((len(self.points), self.fractions.count), bool)
        for k in range(4):
            has[self.tets[:, k], region] = True
        return has & (has.sum(axis=1) > 1)[:, None]

    def interface_offset(self, points: Points, lift: np.ndarray, has: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First-order distance of points from the interface of their regions.

        Where more than two regions meet, it is the distance from the farthest of the interfaces.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points (m).
        lift : ndarray, shape (n, regions + 1)
            Bias of the volume fractions at the points.
        has : ndarray of bool, shape (n, regions + 1)
            Regions that meet there.

        Returns
        -------
        distance : ndarray, shape (n,)
            Distance (m).
        step : ndarray, shape (n, 3)
            Step to the interface (m).
        """
        values, gradients = self.fractions.slopes(points)
        values = values + lift
        farthest, way = np.full(len(points), -1.0), np.zeros((len(points), 3))
        for a, b in combinations(range(self.fractions.count), 2):
            i = np.flatnonzero(has[:, a] & has[:, b])
            value, slope = values[i, a] - values[i, b], gradients[i, a] - gradients[i, b]
            steep = np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
            far = np.abs(value) / steep
            further = far > farthest[i]
            farthest[i[further]] = far[further]
            way[i[further]] = (-value / steep**2)[further, None] * slope[further]
        return farthest, way

    def target_positions(self, region: np.ndarray) -> Points:
        """Target positions of the vertices (n, 3) in m: near an interface, the centre of the tetrahedra around, and for vertices of
        an interface its projection onto the interface.
        """
        has = self.adjacent_regions(region)
        border = np.asarray(has.any(axis=1))
        on = np.flatnonzero(border)
        near = self.tets[border[self.tets].any(axis=1)]
        count = np.bincount(near.ravel(), minlength=len(self.points))
        middle = np.repeat(self.points[near].mean(axis=1), 4, axis=0)
        total = np.stack([np.bincount(near.ravel(), middle[:, j], len(count)) for j in range(3)], axis=1)
        relaxed = self.points + _RELAXED * (total / np.maximum(count, 1)[:, None] - self.points)
        target = np.where(count[:, None] > 0, relaxed, self.points)
        lift = self.bias_at_points()[on]
        for _ in range(2):
            far, way = self.interface_offset(target[on], lift, has[on])
            target[on] += way * np.minimum(1, _FARTHEST * self.scale[on] / np.maximum(far, 1e-12))[:, None]
        return target

    def is_on_interface(self, region: np.ndarray) -> np.ndarray:
        """For each vertex of an interface (n,), whether it lies on it within a part of its element's size."""
        has = self.adjacent_regions(region)
        on = np.flatnonzero(has.any(axis=1))
        far, _ = self.interface_offset(self.points[on], self.bias_at_points()[on], has[on])
        return np.asarray(far < _ON * self.scale[on])


def slope_across(width: float) -> float:
    """Slope of s_a - s_b (1/m) of a step from -1 to 1 blurred by a Gaussian of standard deviation `width` (m)."""
    return float(2 / (np.sqrt(2 * np.pi) * width))


def volumes(points: Points, tets: np.ndarray) -> np.ndarray:
    """Volumes of tetrahedra.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra.

    Returns
    -------
    ndarray, shape (m,)
        Volumes (m³).
    """
    x = points.T[:, tets.T]
    a, b, c = (x[:, k] - x[:, 0] for k in (1, 2, 3))
    return np.asarray(np.abs((a * np.cross(b, c, axis=0)).sum(axis=0)) / 6)


def scales(points: Points, tets: np.ndarray) -> np.ndarray:
    """Element size at each vertex: edge of a cube as large as 12 of the smallest tetrahedron there.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra.

    Returns
    -------
    ndarray, shape (n,)
        Sizes (m).
    """
    found = np.full(len(points), np.inf)
    for k, cubes in enumerate([np.cbrt(12 * volumes(points, tets))] * 4):
        np.minimum.at(found, tets[:, k], cubes)
    return found


def _neighbours(tets: np.ndarray) -> np.ndarray:
    faces = np.sort(tets[:, FACES].reshape(-1, 3), axis=1).astype(np.int64)
    keys = (faces[:, 0] << 42) | (faces[:, 1] << 21) | faces[:, 2]  # fewer than 2²¹ points: see octree.MOST
    order = np.argsort(keys)
    same = keys[order[1:]] == keys[order[:-1]]
    p, q = order[:-1][same], order[1:][same]
    beside = np.full(len(faces), -1)
    beside[p], beside[q] = q // 4, p // 4
    return beside.reshape(-1, 4)
