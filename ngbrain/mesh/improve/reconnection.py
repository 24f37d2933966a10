"""Edge and face swaps that replace a mesh's worst tetrahedra by better ones on the same vertices."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ngbrain.mesh.improve.vertex_relocation import FLATTEST, Stars, shape_quality

LARGEST = 7
"""Largest number of tetrahedra around an edge that is removed; with more, the new ones are worse."""

Found = tuple[float, set[int], list[tuple[list[int], int]]]
"""The worst shape quality of the new tetrahedra, the tetrahedra they replace, and their corners and regions."""


@dataclass(frozen=True, eq=False)
class _Pair:
    """A 2-3 swap: corners (3, 4) of the tetrahedra that would replace the two tetrahedra `old`, and their region."""

    corners: np.ndarray
    old: set[int]
    region: int


@dataclass(frozen=True, eq=False)
class _Ring:
    """The neighbourhood of an edge.

    Parameters
    ----------
    corners : ndarray, shape (2 n, 4)
        Tetrahedra at its second end, then at its first, over the n triangles `triples` of ring corners.
    old : set of int
        The tetrahedra around the edge.
    edge : tuple of int
        Its ends.
    ring : list of int
        Corners around it, in order.
    regions : list of int
        Region between each ring corner and the next.
    changes : list of int
        Ring positions at which the region changes.
    triples : list of tuple of int
        Triangles of ring corners.
    """

    corners: np.ndarray
    old: set[int]
    edge: tuple[int, int]
    ring: list[int]
    regions: list[int]
    changes: list[int]
    triples: list[tuple[int, int, int]]


class Reconnection:
    """Local reconnection (topological swaps) of tetrahedra on fixed vertices.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra in Netgen's orientation.
    region : ndarray of int, shape (m,)
        Region of each; 0 is outside.
    """

    def __init__(self, points: np.ndarray, tets: np.ndarray, region: np.ndarray) -> None:
        self.points, self.tets, self.region = points, tets.tolist(), region.tolist()
        self.quality = shape_quality(points[tets]).tolist()
        self.dead: set[int] = set()
        self.goal = 0.0
        self._stars = Stars.of(tets, len(points))
        self._around: dict[int, set[int]] = {}

    def improve(self, goal: float) -> int:
        """Try to replace every tetrahedron with a shape quality below `goal`, the worst first; returns the number replaced."""
        self.goal = goal
        quality, region = np.array(self.quality), np.array(self.region)
        bad = np.flatnonzero((quality < goal) & (region > 0))
        changed = 0
        for t in bad[np.argsort(quality[bad], kind="stable")].tolist():
            if t not in self.dead:
                changed += self._replace(t)
        return changed

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """The current tetrahedra and regions."""
        alive = np.ones(len(self.tets), bool)
        alive[list(self.dead)] = False
        return np.array(self.tets)[alive], np.array(self.region)[alive]

    def tets_of_vertex(self, vertex: int) -> set[int]:
        """Numbers of the tetrahedra that share a vertex."""
        if vertex not in self._around:
            first, last = self._stars.start[vertex : vertex + 2]
            self._around[vertex] = {t for t in self._stars.tets[first:last].tolist() if t not in self.dead}
        return self._around[vertex]

    def _replace(self, t: int) -> bool:
        best: Found | None = None
        edges = [self._ring(a, b) for a, b in combinations(self.tets[t], 2)]
        faces = [self._pair(t, apex) for apex in self.tets[t]]
        offers: list[_Ring | _Pair] = [offer for offer in (*edges, *faces) if offer is not None]
        if offers:  # all qualities in one call: one call for each takes several times as long
            shape = shape_quality(self.points[np.concatenate([offer.corners for offer in offers])])
            ends = np.cumsum([len(offer.corners) for offer in offers])
            for offer, mine in zip(offers, np.split(shape, ends[:-1]), strict=True):
                found = self._remove_edge(offer, mine) if isinstance(offer, _Ring) else self._swap_face(offer, mine)
                if found and (best is None or found[0] > best[0]):
                    best = found
        found = self._remove_surface_tet(t)
        if found and (best is None or found[0] > best[0]):
            best = found
        if best is None:
            return False
        _, old, new = best
        for k in old:
            for v in self.tets[k]:
                self.tets_of_vertex(v).discard(k)
        self.dead |= old
        for corners, region in new:
            for v in corners:
                self.tets_of_vertex(v).add(len(self.tets))
            self.tets.append(corners)
            self.region.append(region)
        self.quality += shape_quality(self.points[np.array([corners for corners, _ in new])]).tolist()
        return True

    def _remove_surface_tet(self, t: int) -> Found | None:
        """Remove a flat tetrahedron at the surface: it becomes part of the outside.

        Not where parts of the surface would then touch.
        """
        tet = self.tets[t]
        within: list[int] = []
        beyond: list[int] = []  # corners opposite to a face on the surface; and the others
        for apex in tet:
            p, q, r = (v for v in tet if v != apex)
            sharing = (self.tets_of_vertex(p) & self.tets_of_vertex(q) & self.tets_of_vertex(r)) - {t}
            (beyond if sharing and not any(self.region[k] for k in sharing) else within).append(apex)
        if not beyond:
            return None
        # New part of the surface: the corner or edge common to all inner faces, which must not be on the surface yet.
        shared = set.intersection(*(self.tets_of_vertex(v) for v in beyond))
        if len(within) > 1 and not all(self.region[k] for k in shared):
            return None
        return self.goal, {t}, [(tet, 0)]

    def _worst(self, old: set[int]) -> float:
        """Shape quality that the replacement has to exceed."""
        return min(self.quality[t] for t in old if self.region[t])

    def _pair(self, t: int, apex: int) -> _Pair | None:
        """Two tetrahedra of one region that share a face, and the three around the line between their apices."""
        p, q, r = (v for v in self.tets[t] if v != apex)
        sharing = (self.tets_of_vertex(p) & self.tets_of_vertex(q) & self.tets_of_vertex(r)) - {t}
        if len(sharing) != 1:  # at the hull
            return None
        (other,) = sharing
        if self.region[other] != self.region[t]:
            return None
        (far,) = set(self.tets[other]) - {p, q, r}
        return _Pair(
            np.array([self._replace_corner(t, corner, far) for corner in (p, q, r)]), {t, other}, self.region[t]
        )

    def _swap_face(self, pair: _Pair, shape: np.ndarray) -> Found | None:
        """2-3 swap: the two tetrahedra become the three."""
        worst = float(shape.min())
        if worst <= self._worst(pair.old):
            return None
        return worst, pair.old, [(corners, pair.region) for corners in pair.corners.tolist()]

    def _replace_corner(self, t: int, corner: int, by: int) -> list[int]:
        """The tetrahedron with one corner replaced, in the same orientation."""
        return [by if v == corner else v for v in self.tets[t]]

    def _ring(self, a: int, b: int) -> _Ring | None:
        """The tetrahedra around an edge, and those between its ends and the triangles of the ring around it."""
        old = self.tets_of_vertex(a) & self.tets_of_vertex(b)
        if not 3 <= len(old) <= LARGEST:
            return None
        follows = {}
        for t in old:
            p, q = _opposite_corners(self.tets[t], a, b)
            follows[p] = (q, self.region[t])
        ring, regions = [next(iter(sorted(follows)))], []
        while len(ring) <= len(old):
            after = follows.get(ring[-1])
            if after is None:
                return None  # at the hull
            regions.append(after[1])
            if after[0] == ring[0]:
                break
            ring.append(after[0])
        n = len(ring)
        if n != len(old) or len(regions) != n:
            return None
        changes = [k for k in range(n) if regions[k] != regions[k - 1]]  # ring corners in an interface
        if len(changes) not in (0, 2):
            return None
        triples = list(combinations(range(n), 3))
        corners = np.array(ring)[np.array(triples)]
        up = np.column_stack([np.full(len(corners), b), corners[:, [0, 2, 1]]])
        down = np.column_stack([np.full(len(corners), a), corners])
        return _Ring(np.concatenate([up, down]), old, (a, b), ring, regions, changes, triples)

    def _remove_edge(self, around: _Ring, shape: np.ndarray) -> Found | None:
        """Edge removal: the tetrahedra around an edge are replaced by those on both sides of a triangulation of its ring.

        An edge in an interface is replaced by the chord between the interface's two other corners. On the side that the
        chord leaves empty, the tetrahedra join the other region.
        """
        (a, b), ring, regions, n = around.edge, around.ring, around.regions, len(around.ring)
        value = dict(zip(around.triples, shape.reshape(2, -1).min(axis=0).tolist(), strict=True))
        parts = []
        if around.changes:
            i, j = around.changes
            parts = [(list(range(i, j + 1)), regions[i]), ([*range(j, n), *range(i + 1)], regions[j])]
            parts = [(part, region) for part, region in parts if len(part) > 2]
        else:
            parts = [(list(range(n)), regions[0])]
        worst, new = np.inf, []
        for part, region in parts:
            quality, chosen = _triangulation(part, value)
            if region == 0:
                quality = np.inf if quality > FLATTEST else -np.inf
            worst = min(worst, quality)
            for x, y, z in chosen:
                new += [([b, ring[x], ring[z], ring[y]], region), ([a, ring[x], ring[y], ring[z]], region)]
        return (worst, around.old, new) if worst > self._worst(around.old) else None


def _opposite_corners(tet: list[int], a: int, b: int) -> tuple[int, int]:
    """The two other corners of a tetrahedron, in the order of rotation about the edge from a to b."""
    i, j = tet.index(a), tet.index(b)
    k, m = (x for x in range(4) if x not in (i, j))
    even = (i, j, k, m) in _EVEN
    return (tet[k], tet[m]) if even else (tet[m], tet[k])


_EVEN = {
    (0, 1, 2, 3), (0, 2, 3, 1), (0, 3, 1, 2), (1, 0, 3, 2), (1, 2, 0, 3), (1, 3, 2, 0),
    (2, 0, 1, 3), (2, 1, 3, 0), (2, 3, 0, 1), (3, 0, 2, 1), (3, 1, 0, 2), (3, 2, 1, 0),
}  # fmt: skip


def _triangulation(
    part: list[int], value: dict[tuple[int, int, int], float]
) -> tuple[float, list[tuple[int, int, int]]]:
    """The triangulation of a polygon whose worst triangle is best, and that triangle's value (Klincsek's recursion)."""
    n = len(part)
    best: dict[tuple[int, int], tuple[float, int]] = {}
    for width in range(2, n):
        for i in range(n - width):
            j = i + width
            options = []
            for k in range(i + 1, j):
                x, y, z = sorted((part[i], part[k], part[j]))
                sides = [best[side][0] for side in ((i, k), (k, j)) if side in best]
                options.append((min([value[x, y, z], *sides]), k))
            best[i, j] = max(options)
    chosen, todo = [], [(0, n - 1)]
    while todo:
        i, j = todo.pop()
        if (i, j) in best:
            k = best[i, j][1]
            x, y, z = sorted((part[i], part[k], part[j]))
            chosen.append((x, y, z))
            todo += [(i, k), (k, j)]
    return best[0, n - 1][0], chosen
