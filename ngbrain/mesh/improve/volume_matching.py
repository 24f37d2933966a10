"""Interface moves that give the regions of a mesh their target volumes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.look import BriefText
from ngbrain.mesh.improve.vertex_relocation import FLATTEST, shape_quality
from ngbrain.mesh.labels.volume_zones import Zones

FURTHEST = 0.2
"""Largest move of a vertex, as a part of the element size."""
HELD = 0.03
"""Relative damping of each region: a zone that hardly touches the outside cannot enlarge all its regions."""
ROUNDS = 6
INSIDE = np.concatenate([np.full((1, 4), 0.25), np.full((4, 4), 0.1) + 0.6 * np.eye(4)])
"""Barycentric coordinates at which a tetrahedron is assigned to a region."""
_FACES = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))
"""Face opposite to each corner of a tetrahedron in Netgen's orientation, with normals towards the corner."""


def match_volumes(
    points: np.ndarray, tets: np.ndarray, region: np.ndarray, zones: Zones, size: np.ndarray, sound: float
) -> np.ndarray:
    """Move interfaces along their normals so that regions get their target volumes.

    In each zone, an interface moves by the same part of the element size everywhere. This corrects two errors: plane facets cut
    corners, so that regions with convex interfaces are too small, and films too thin for the mesh are assigned to their
    neighbours. A region whose volume cannot be matched within `FURTHEST` leaves the rest to the region with the largest common
    interface. No tetrahedron gets a shape quality (`vertex_relocation.shape_quality`) below `sound`, unless it already has it.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra in Netgen's orientation.
    region : ndarray of int, shape (m,)
        Region of each; 0 is outside.
    zones : Zones
        Zones and target volumes.
    size : ndarray, shape (n,)
        Element size at the vertices (m).
    sound : float
        Smallest shape quality that a move may lead to.

    Returns
    -------
    ndarray, shape (n, 3)
        New positions (m).
    """
    count, kept = zones.target_volumes.shape[1], region > 0
    start, points, limit, wanted = points, points.copy(), FURTHEST * size, zones.target_volumes.copy()
    fractions = np.mean([zones.weights(np.einsum("k,nkd->nd", where, points[tets])) for where in INSIDE], axis=0)
    vertices = zones.weights(points).argmax(axis=1)
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
    """Volume of each tetrahedron (m,), and derivatives of the regions' volumes by the vertex positions (n, 3, count)."""
    slopes = np.zeros((n * (count + 1), 3))
    for corner, (i, j, k) in enumerate(_FACES):
        area = np.cross(x[:, j] - x[:, i], x[:, k] - x[:, i]) / 6
        at = tets[:, corner] * (count + 1) + region
        slopes += np.stack([np.bincount(at, area[:, d], len(slopes)) for d in range(3)], axis=1)
    volume = -np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    every = slopes.reshape(n, count + 1, 3)[:, 1:]
    every[np.abs(every).max(axis=(1, 2)) < 1e-9 * np.abs(every).max()] = 0  # the sum cancels inside a region
    return volume, every.transpose(0, 2, 1).copy()


def _attainable(wanted: np.ndarray, volumes: np.ndarray, slopes: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """The part of the target volumes that moves within half the limit reach; the rest goes to the largest neighbour."""
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
"""Quadrature of fourth order on a triangle in barycentric coordinates (Dunavant 1985, doi:10.1002/nme.1620210612)."""


def _quadratic_triangle() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shape functions of a triangle's corners and mid-edge nodes 01, 02, 12, and their two derivatives, at `_POINTS`."""
    p, i, j = _POINTS, [0, 0, 1], [1, 2, 2]
    along = np.array([[-1, 1, 0], [-1, 0, 1]])  # of the barycentric coordinates
    slopes = [
        np.concatenate([(4 * p - 1) * d, 4 * (p[:, i] * d[j] + p[:, j] * d[i])], axis=1) for d in along.astype(float)
    ]
    return np.concatenate([p * (2 * p - 1), 4 * p[:, i] * p[:, j]], axis=1), slopes[0], slopes[1]


_VALUES, _ALONG, _ACROSS = _quadratic_triangle()


@dataclass(frozen=True, eq=False, repr=False)
class QuadraticInterfaces(BriefText):
    """Second-order interfaces and the volumes that they enclose: V = ⅓ ∮ x·n, ∂V/∂x_i = ∮ N_i n.

    Parameters
    ----------
    six : ndarray of int, shape (k, 6)
        Nodes of the triangles: corners, then middles of the edges 01, 02, 12; normals point out of the first region.
    pairs : ndarray of int, shape (k, 2)
        Region on the inner and on the outer side; 0 is outside.
    count : int
        Number of regions.
    """

    six: np.ndarray
    pairs: np.ndarray
    count: int

    def volumes(self, places: np.ndarray) -> np.ndarray:
        """Volume of each region (count,) in m³, for nodes at `places` (n, 3) in m."""
        normals, at = self._normals(places), _VALUES @ places[self.six]
        each = np.einsum("q,tqd,tqd->t", _WEIGHTS, at, normals) / 3
        inner, outer = (np.bincount(side, each, self.count + 1) for side in self.pairs.T)
        return np.asarray((inner - outer)[1:])

    def slopes(self, places: np.ndarray) -> np.ndarray:
        """Derivatives of the volumes by the node positions (n, 3, count) in m²."""
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
        """Move nodes along their normals until the volumes match.

        Parameters
        ----------
        places : ndarray, shape (n, 3)
            Node positions (m).
        wanted : ndarray, shape (count,)
            Target volumes (m³).
        reach : ndarray, shape (n,)
            Largest move of each node (m). All move by about the same part of it; nodes with 0 stay.

        Returns
        -------
        ndarray, shape (n, 3)
            New positions (m).
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
