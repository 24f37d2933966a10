"""Swaps of edges and faces that replace a mesh's worst tetrahedra by better ones on the same vertices."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ngbrain.mesh.improve.smoothing import FLATTEST, Stars, shape_quality

LARGEST = 7
"""Most tetrahedra around an edge that is removed: of more, the others get worse."""

Found = tuple[float, set[int], list[tuple[list[int], int]]]
"""The worst shape of what is new, the tetrahedra that it replaces, and the new ones' corners and regions."""


@dataclass(frozen=True, eq=False)
class _Pair:
    """Corners (3, 4) of what would replace the two tetrahedra `old`, and their region."""

    corners: np.ndarray
    old: set[int]
    region: int


@dataclass(frozen=True, eq=False)
class _Ring:
    """What is around an edge.

    corners   (2 n, 4) of tetrahedra at its second end, then at its first, over the n triangles of `triples` of ring corners
    old       the tetrahedra around it
    ring      corners around it, in order; regions of what is between each and the next
    changes   at which of them the region changes
    """

    corners: np.ndarray
    old: set[int]
    edge: tuple[int, int]
    ring: list[int]
    regions: list[int]
    changes: list[int]
    triples: list[tuple[int, int, int]]


class Reconnection:
    """Tetrahedra (m, 4) in regions (m,), 0 for outside, on fixed vertices, changed by `improve`."""

    def __init__(self, points: np.ndarray, tets: np.ndarray, region: np.ndarray) -> None:
        self.points, self.tets, self.region = points, tets.tolist(), region.tolist()
        self.quality = shape_quality(points[tets]).tolist()
        self.dead: set[int] = set()
        self.goal = 0.0
        self._stars = Stars.of(tets, len(points))
        self._around: dict[int, set[int]] = {}

    def improve(self, goal: float) -> int:
        """Try every tetrahedron with a shape below the goal, the worst ones first; returns how many were replaced."""
        self.goal = goal
        quality, region = np.array(self.quality), np.array(self.region)
        bad = np.flatnonzero((quality < goal) & (region > 0))
        changed = 0
        for t in bad[np.argsort(quality[bad], kind="stable")].tolist():
            if t not in self.dead:
                changed += self._replace(t)
        return changed

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Tetrahedra and regions as they are now."""
        alive = np.ones(len(self.tets), bool)
        alive[list(self.dead)] = False
        return np.array(self.tets)[alive], np.array(self.region)[alive]

    def tets_of_vertex(self, vertex: int) -> set[int]:
        """Numbers of the tetrahedra around a vertex."""
        if vertex not in self._around:
            first, last = self._stars.start[vertex : vertex + 2]
            self._around[vertex] = {t for t in self._stars.tets[first:last].tolist() if t not in self.dead}
        return self._around[vertex]

    def _replace(self, t: int) -> bool:
        best: Found | None = None
        edges = [self._ring(a, b) for a, b in combinations(self.tets[t], 2)]
        faces = [self._pair(t, apex) for apex in self.tets[t]]
        offers: list[_Ring | _Pair] = [offer for offer in (*edges, *faces) if offer is not None]
        if offers:  # their shapes at once: a call for each takes several times as long
            shape = shape_quality(self.points[np.concatenate([offer.corners for offer in offers])])
            ends = np.cumsum([len(offer.corners) for offer in offers])
            for offer, mine in zip(offers, np.split(shape, ends[:-1]), strict=True):
                found = self._without_edge(offer, mine) if isinstance(offer, _Ring) else self._without_face(offer, mine)
                if found and (best is None or found[0] > best[0]):
                    best = found
        found = self._outside(t)
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

    def _outside(self, t: int) -> Found | None:
        """A tetrahedron at the surface, as there are flat ones where that is a plane, becomes part of the outside.

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
        # What the surface gets to: the corner or the edge that all faces within share, which no surface may have yet.
        shared = set.intersection(*(self.tets_of_vertex(v) for v in beyond))
        if len(within) > 1 and not all(self.region[k] for k in shared):
            return None
        return self.goal, {t}, [(tet, 0)]

    def _worst(self, old: set[int]) -> float:
        """Shape that the replacement has to beat."""
        return min(self.quality[t] for t in old if self.region[t])

    def _pair(self, t: int, apex: int) -> _Pair | None:
        """Two tetrahedra of a region, the first without one apex, and the three around the line between their apices."""
        p, q, r = (v for v in self.tets[t] if v != apex)
        sharing = (self.tets_of_vertex(p) & self.tets_of_vertex(q) & self.tets_of_vertex(r)) - {t}
        if len(sharing) != 1:  # at the hull
            return None
        (other,) = sharing
        if self.region[other] != self.region[t]:
            return None
        (far,) = set(self.tets[other]) - {p, q, r}
        return _Pair(np.array([self._like(t, corner, far) for corner in (p, q, r)]), {t, other}, self.region[t])

    def _without_face(self, pair: _Pair, shape: np.ndarray) -> Found | None:
        """The two become the three."""
        worst = float(shape.min())
        if worst <= self._worst(pair.old):
            return None
        return worst, pair.old, [(corners, pair.region) for corners in pair.corners.tolist()]

    def _like(self, t: int, corner: int, by: int) -> list[int]:
        """A tetrahedron with a corner replaced, in the same orientation."""
        return [by if v == corner else v for v in self.tets[t]]

    def _ring(self, a: int, b: int) -> _Ring | None:
        """The tetrahedra around an edge, and those that triangles of the ring around it make with its ends."""
        old = self.tets_of_vertex(a) & self.tets_of_vertex(b)
        if not 3 <= len(old) <= LARGEST:
            return None
        follows = {}
        for t in old:
            p, q = _beyond(self.tets[t], a, b)
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

    def _without_edge(self, around: _Ring, shape: np.ndarray) -> Found | None:
        """The tetrahedra around an edge become those on both sides of a triangulation of the ring around it.

        An edge in an interface takes the chord between the interface's two other corners into its place; on the side
        that the chord leaves empty, what there was joins the other side.
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


def _beyond(tet: list[int], a: int, b: int) -> tuple[int, int]:
    """The two other corners of a tetrahedron, in the order in which one turns around the edge from a to b."""
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
    """Of a polygon, the triangulation whose worst triangle is best, and that triangle's value (Klincsek's recursion)."""
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
