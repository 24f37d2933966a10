"""Triangulation of a smooth level set, graded by a size field: evenly spaced samples and their Delaunay facets."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from ngbrain.errors import InputError
from ngbrain.look import BriefText
from ngbrain.mesh.geometry.level_set import LevelSet, Points
from ngbrain.mesh.geometry.sizing import SizeField
from ngbrain.mesh.surface.manifold import boundary, faults, pieces, repair_manifold

CLOSE = 0.72
"""Initial distance of samples as a part of the element size; after relaxation they are one size apart."""
ROUNDS = 12
"""Relaxation rounds."""
PIECES = 2
"""Factor by which the pieces that represent the surface are smaller than the element size."""
FINER = 0.7
"""Factor on the sample distance where the triangles do not form a closed surface."""
FINEST = 0.75
"""Lower bound of the sample distance in voxels; thinner parts are closed or cut (`ngbrain.mesh.surface.manifold`)."""
NEAR, APART = 2, 4
"""Distance from such a place, in element sizes, within which samples are refined and within which they are relaxed again."""
SPECK = 1e-8
"""Volume (m³) of a component or hole below which it gets no surface: a ball of 2.7 mm."""


@dataclass(frozen=True, eq=False, repr=False)
class RemeshedSurface(BriefText):
    """A closed surface without self-intersections.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    triangles : ndarray of int, shape (m, 3)
        Triangles with outward normals.
    changed : ndarray, shape (k, 4)
        Centre (m) and volume (m³) of each repair: positive if closed, negative if cut or left out.
    """

    points: Points
    triangles: np.ndarray
    changed: np.ndarray


def remesh_surface(surface: LevelSet, size: SizeField, fixed: Points, seed: int = 0) -> RemeshedSurface:
    """Triangulate the surface φ = 0 by a restricted Delaunay triangulation.

    The triangles are the facets of the samples' Delaunay tetrahedra that separate those with a circumcentre inside from the
    others. They bound a union of tetrahedra, so that they cannot intersect, and approximate the surface where samples are dense.
    Where they are not a surface, samples are refined. What is still not a surface below a voxel, for example where the level
    passes through a saddle, is closed or cut. Neighbours among `fixed` (along a curve, say) stay connected by an edge if
    nothing else lies within their smallest ball.

    Parameters
    ----------
    surface : LevelSet
        Signed distance φ.
    size : SizeField
        Element size (m).
    fixed : ndarray, shape (k, 3)
        Points on the surface (m) that become the first vertices.
    seed : int
        Seed of the random samples.

    Returns
    -------
    RemeshedSurface
        The triangles.

    Raises
    ------
    InputError
        Sizes are so large that nothing is left.

    References
    ----------
    Boissonnat & Oudot (2005), doi:10.1016/j.gmod.2005.01.004.
    """
    dense, area = _dense_points(surface, size)
    h = size(dense)
    finest = np.minimum(FINEST * surface.spacing, h)
    points = _spaced_samples(surface, dense, area, h, fixed, np.random.default_rng(seed))
    while True:
        cells = _Cells.of(surface, points)
        bad = faults(boundary(cells.tets, cells.neighbours, cells.inside)[0], len(points))
        if not len(bad):
            return RemeshedSurface(points, cells.outwards(), np.zeros((0, 4)))
        reach, _ = cKDTree(points[bad]).query(dense)
        finer = np.where(reach < NEAR * h, np.maximum(FINER * h, finest), h)
        if (finer == h).all():
            return cells.closed(len(fixed))
        anew = reach < APART * h
        kept = ~anew[cKDTree(dense).query(points)[1]]
        kept[: len(fixed)] = True
        h = finer
        points = _spaced_samples(surface, dense[anew], area[anew], h[anew], points[kept], np.random.default_rng(seed))


def _dense_points(surface: LevelSet, size: SizeField) -> tuple[Points, np.ndarray]:
    """Points (n, 3) that represent the whole surface, and the area (m²) of each: pieces well below the element size there."""
    pieces = surface.outline()
    kept = []
    while len(pieces):
        edge = np.linalg.norm(pieces - pieces[:, [1, 2, 0]], axis=2).max(axis=1)
        large = PIECES * edge > size(pieces.mean(axis=1))
        kept.append(pieces[~large])
        a, b, c = np.moveaxis(pieces[large], 1, 0)
        p, q, r = (a + b) / 2, (b + c) / 2, (c + a) / 2
        pieces = np.stack([np.stack(t, axis=1) for t in ((a, p, r), (p, b, q), (r, q, c), (p, q, r))]).reshape(-1, 3, 3)
    pieces = np.concatenate(kept)
    normal = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    return pieces.mean(axis=1), np.linalg.norm(normal, axis=1) / 2


def _spaced_samples(
    surface: LevelSet, dense: Points, area: np.ndarray, h: np.ndarray, fixed: Points, rng: np.random.Generator
) -> Points:
    """Samples one element size apart: random, then moved to the weighted centroids of their Voronoi cells."""
    tree = cKDTree(dense)
    taken = np.zeros(len(dense), bool)
    chosen: list[int] = []
    if len(fixed):
        reach = h[tree.query(fixed)[1]]
        for near in tree.query_ball_point(fixed, CLOSE * reach):
            taken[near] = True
    for i in rng.permutation(len(dense)):
        if not taken[i]:
            chosen.append(i)
            taken[tree.query_ball_point(dense[i], CLOSE * h[i])] = True
    free = dense[chosen]
    weight = area * h**-4.0  # so that the spacing of the samples is proportional to h
    for _ in range(ROUNDS):
        owner = cKDTree(np.concatenate([fixed, free])).query(dense)[1] - len(fixed)
        mine = owner >= 0
        total = np.bincount(owner[mine], weight[mine], len(free))
        centres = [np.bincount(owner[mine], (weight * dense[:, k])[mine], len(free)) for k in range(3)]
        free = free[total > 0]
        free = surface.project((np.stack(centres, axis=1)[total > 0]) / total[total > 0, None])
    return np.concatenate([fixed, free])


@dataclass(frozen=True, eq=False)
class _Cells:
    """Delaunay tetrahedra of surface points and of corners around them.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        All points (m).
    count : int
        Number of surface points, the first ones.
    tets, neighbours : ndarray of int, shape (m, 4)
        Tetrahedra, and those across their faces.
    inside : ndarray of bool, shape (m,)
        Tetrahedra inside.
    """

    points: Points
    count: int
    tets: np.ndarray
    neighbours: np.ndarray
    inside: np.ndarray

    @classmethod
    def of(cls, surface: LevelSet, points: Points) -> _Cells:
        low, high = points.min(axis=0), points.max(axis=0)
        corners = np.array(np.meshgrid(*np.stack([low, high], axis=1) * 1.0)).reshape(3, -1).T
        around = (low + high) / 2 + 3 * (corners - (low + high) / 2)  # so that every facet of the surface has two sides
        every = np.concatenate([points, around])
        try:
            delaunay = Delaunay(every)
        except QhullError as error:
            raise InputError("mesh sizes", "such that the surface has too few points", "smaller elements") from error
        tets = delaunay.simplices
        inside = surface(_circumcentres(every[tets])) < 0
        inside &= (tets < len(points)).all(axis=1)
        return cls(every, len(points), tets, delaunay.neighbors, inside)

    def outwards(self) -> np.ndarray:
        """The triangles (k, 3) around the tetrahedra inside, with outward normals."""
        three, opposite = boundary(self.tets, self.neighbours, self.inside)
        a, b, c = (self.points[three[:, i]] for i in range(3))
        turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), self.points[opposite] - a) > 0
        three[turned] = three[turned][:, [0, 2, 1]]
        return three

    def closed(self, fixed: int) -> RemeshedSurface:
        """The surface, repaired where it is not a manifold, without small components and unused points."""
        volumes = np.abs(np.linalg.det(self.points[self.tets[:, 1:]] - self.points[self.tets[:, :1]])) / 6
        inside = repair_manifold(self.tets, self.neighbours, self.inside, volumes, self.count)
        for side in (True, False):
            piece = pieces(self.neighbours, inside == side)
            small = np.bincount(piece, volumes) < SPECK
            small[0] = False
            inside ^= small[piece]
        triangles = replace(self, inside=inside).outwards()
        used = np.union1d(np.arange(fixed), triangles)
        return RemeshedSurface(self.points[used], np.searchsorted(used, triangles), self._changed(inside, volumes))

    def _changed(self, inside: np.ndarray, volumes: np.ndarray) -> np.ndarray:
        """Centre and signed volume (k, 4) of each component that changed sides."""
        middles, found = self.points[self.tets].mean(axis=1), []
        for side in (True, False):
            piece = pieces(self.neighbours, (inside == side) & (self.inside != side))
            total = np.bincount(piece, volumes)
            some = np.flatnonzero(total[1:] > 0) + 1  # flat tetrahedra have no volume
            where = np.stack([np.bincount(piece, volumes * x)[some] for x in middles.T], axis=1) / total[some, None]
            found.append(np.column_stack([where, total[some] if side else -total[some]]))
        return np.concatenate(found)


def _circumcentres(tets: np.ndarray) -> Points:
    edges = tets[:, 1:] - tets[:, :1]
    volume = np.linalg.det(edges)
    flat = np.abs(volume) < 1e-30
    edges[flat] = np.eye(3)
    half = np.linalg.solve(edges, (edges**2).sum(axis=2, keepdims=True) / 2)[..., 0]
    half[flat] = 0
    return np.asarray(tets[:, 0] + half)
