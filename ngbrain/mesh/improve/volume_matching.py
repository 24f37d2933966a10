"""Moves of a mesh's interfaces that give its regions the volumes that they should have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.mesh.improve.smoothing import FLATTEST, shape_quality
from ngbrain.mesh.labels.volume_zones import Zones

FURTHEST = 0.2
"""Part of the element size that a vertex is moved at most."""
HELD = 0.03
"""Part by which each region is held back: in a zone that hardly reaches the outside nobody can give all of them room."""
ROUNDS = 6
INSIDE = np.concatenate([np.full((1, 4), 0.25), np.full((4, 4), 0.1) + 0.6 * np.eye(4)])
"""Barycentric coordinates at which a tetrahedron asks where it is."""
_FACES = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))
"""Opposite to each corner of a tetrahedron in Netgen's orientation, turning such that normals point to the corner."""


def match_volumes(
    points: np.ndarray, tets: np.ndarray, region: np.ndarray, zones: Zones, size: np.ndarray, sound: float
) -> np.ndarray:
    """Points (n, 3) with interfaces moved along their normals, by the same part of the element size all over each in a zone.

    Facets cut corners, so that regions bounded by convex interfaces are too small, and films too thin for the mesh are
    counted to what is around them. A region whose volume cannot be matched within `FURTHEST` leaves the rest to the one
    that it shares the largest interface with. No tetrahedron gets a shape (see `relocation.shapes`) worse than `sound`,
    unless it has it.

    region   (m,), 0 for outside; size (n,) m
    """
    count, kept = zones.wanted.shape[1], region > 0
    start, points, limit, wanted = points, points.copy(), FURTHEST * size, zones.wanted.copy()
    fractions = np.mean([zones.share(np.einsum("k,nkd->nd", where, points[tets])) for where in INSIDE], axis=0)
    vertices = zones.share(points).argmax(axis=1)
    floor = np.minimum(shape_quality(points[tets]), np.where(kept, sound, FLATTEST))
    free = np.ones(len(points), bool)
    for k in range(ROUNDS):
        each, slopes = _volumes(points[tets], tets, region, len(points), count)
        slopes[~free] = 0
        weight = size / np.maximum(np.linalg.norm(slopes, axis=(1, 2)), 1e-30)
        off = points - start
        for zone, share in enumerate(fractions.T):
            mine = vertices == zone
            volumes, steep = np.bincount(region, share * each, count + 1)[1:], slopes[mine]
            if k == 0:
                wanted[zone] = _attainable(wanted[zone], volumes, steep, limit[mine])
            matrix = np.einsum("v,vdr,vds->rs", weight[mine], steep, steep)
            matrix[np.diag_indices(count)] *= 1 + HELD
            factors = np.linalg.lstsq(matrix, wanted[zone] - volumes, rcond=1e-9)[0]
            off[mine] += weight[mine, None] * (steep @ factors)
        new = start + off * np.minimum(1, limit / np.maximum(np.linalg.norm(off, axis=1), 1e-12))[:, None]
        while len(stuck := np.unique(tets[shape_quality(new[tets]) < floor])):
            stuck = stuck[(new[stuck] != points[stuck]).any(axis=1)]
            if not len(stuck):
                break
            new[stuck] = points[stuck]
            free[stuck] = False
        points = new
    return points


def _volumes(x: np.ndarray, tets: np.ndarray, region: np.ndarray, n: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Volume of each tetrahedron (m,), and how those of regions change with the place of each vertex (n, 3, count)."""
    slopes = np.zeros((n * (count + 1), 3))
    for corner, (i, j, k) in enumerate(_FACES):
        area = np.cross(x[:, j] - x[:, i], x[:, k] - x[:, i]) / 6
        at = tets[:, corner] * (count + 1) + region
        slopes += np.stack([np.bincount(at, area[:, d], len(slopes)) for d in range(3)], axis=1)
    volume = -np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    every = slopes.reshape(n, count + 1, 3)[:, 1:]
    every[np.abs(every).max(axis=(1, 2)) < 1e-9 * np.abs(every).max()] = 0  # inside a region the sum cancels
    return volume, every.transpose(0, 2, 1).copy()


def _attainable(wanted: np.ndarray, volumes: np.ndarray, slopes: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """The volumes wanted, as far as moves within half the limit give them; what is left goes to the largest neighbour."""
    wanted = wanted.copy()
    reach = 0.5 * np.einsum("v,vr->r", limit, np.linalg.norm(slopes, axis=1))
    shared = -np.einsum("vdr,vds->rs", slopes, slopes)
    for r in np.argsort(wanted):
        missing = wanted[r] - volumes[r]
        rest = missing - np.clip(missing, -reach[r], reach[r])
        neighbour = np.where(np.arange(len(wanted)) == r, -np.inf, shared[r]).argmax()
        wanted[r] -= rest
        wanted[neighbour] += rest
    return wanted


_POINTS = np.array(
    [[1 - 2 * a, a, a][k:] + [1 - 2 * a, a, a][:k] for a in (0.445948490915965, 0.091576213509771) for k in range(3)]
)
_WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3) / 2
"""Of fourth order on a triangle (Dunavant 1985, 10.1002/nme.1620210612), barycentric."""


def _six() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The functions of a triangle's corners and of the middles of its edges 01, 02, 12, and their two slopes, at `_POINTS`."""
    p, i, j = _POINTS, [0, 0, 1], [1, 2, 2]
    along = np.array([[-1, 1, 0], [-1, 0, 1]])  # of the barycentric coordinates
    slopes = [
        np.concatenate([(4 * p - 1) * d, 4 * (p[:, i] * d[j] + p[:, j] * d[i])], axis=1) for d in along.astype(float)
    ]
    return np.concatenate([p * (2 * p - 1), 4 * p[:, i] * p[:, j]], axis=1), slopes[0], slopes[1]


_VALUES, _ALONG, _ACROSS = _six()


@dataclass(frozen=True, eq=False)
class QuadraticInterfaces:
    """Interfaces of second order, and the volumes that they enclose: V = ⅓ ∮ x·n, ∂V/∂x_i = ∮ N_i n.

    six     (k, 6) nodes of triangles: corners, then middles of the edges 01, 02, 12; outwards of the first region
    pairs   (k, 2) the region on the inner side and that on the outer one, 0 for outside
    count   of regions
    """

    six: np.ndarray
    pairs: np.ndarray
    count: int

    def volumes(self, places: np.ndarray) -> np.ndarray:
        """Of each region (count,) in m³, nodes being at `places` (n, 3) m."""
        normals, at = self._normals(places), _VALUES @ places[self.six]
        each = np.einsum("q,tqd,tqd->t", _WEIGHTS, at, normals) / 3
        inner, outer = (np.bincount(side, each, self.count + 1) for side in self.pairs.T)
        return np.asarray((inner - outer)[1:])

    def slopes(self, places: np.ndarray) -> np.ndarray:
        """Of the volumes with the places of the nodes (n, 3, count) m²."""
        each = np.einsum("q,qi,tqd->tid", _WEIGHTS, _VALUES, self._normals(places))
        found = np.zeros((len(places) * (self.count + 1), 3))
        for side, sign in zip(self.pairs.T, (1, -1), strict=True):
            at = (self.six * (self.count + 1) + side[:, None]).ravel()
            for d in range(3):
                found[:, d] += sign * np.bincount(at, each[:, :, d].ravel(), len(found))
        return found.reshape(len(places), self.count + 1, 3)[:, 1:].transpose(0, 2, 1).copy()

    def _normals(self, places: np.ndarray) -> np.ndarray:
        x = places[self.six]
        return np.cross(_ALONG @ x, _ACROSS @ x)

    def match_volumes(self, places: np.ndarray, wanted: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Places (n, 3) moved along normals, all by about the same part of `reach` (n,) m, until volumes are those wanted.

        Not where `reach` is 0, and never farther than it.
        """
        start = places
        for _ in range(ROUNDS):
            slopes = self.slopes(places)
            weight = reach / np.maximum(np.linalg.norm(slopes, axis=(1, 2)), 1e-30)
            matrix = np.einsum("v,vdr,vds->rs", weight, slopes, slopes)
            factors = np.linalg.lstsq(matrix, wanted - self.volumes(places), rcond=1e-9)[0]
            off = places + weight[:, None] * (slopes @ factors) - start
            far = np.linalg.norm(off, axis=1)
            places = start + off * np.minimum(1, reach / np.maximum(far, 1e-12))[:, None]
        return places
