"""Surfaces of a quadratic tetrahedral mesh, and its cuts with a plane, as plain triangles and lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# VTK_QUADRATIC_TETRA: corners 0123, then the middles of 01 12 20 03 13 23. Faces outwards: corners, then their middles.
_FACES = np.array([[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]])
_FACE_PARTS = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
_TET_PARTS = np.array(
    [[0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3], [4, 6, 7, 8], [4, 5, 6, 8], [6, 9, 7, 8], [5, 9, 6, 8]]
)


def faces(connectivity: Ints, group: npt.NDArray[Any] | None = None) -> Ints:
    """Six-node faces (m, 6), outwards, that belong to one tetrahedron only, or that part two groups (then once).

    Args:
        connectivity: (ntets, 10) as VTK has it.
        group: (ntets,) label; None: only the outer surface.
    """
    every = connectivity[:, _FACES].reshape(-1, 6)
    corners = np.sort(every[:, :3], axis=1)
    _, first, number, count = np.unique(corners, axis=0, return_index=True, return_inverse=True, return_counts=True)
    kept = count == 1
    if group is not None:
        label = np.repeat(np.unique(group, return_inverse=True)[1].ravel(), 4)
        low, high = np.full(len(first), label.max() + 1), np.full(len(first), -1)
        np.minimum.at(low, number.ravel(), label)
        np.maximum.at(high, number.ravel(), label)
        kept |= low != high
    return np.asarray(every[first[kept]])


def triangles(quadratic: Ints) -> Ints:
    """Each six-node face as four plain triangles, (4 m, 3), in the order of the faces."""
    return np.asarray(quadratic[:, _FACE_PARTS].reshape(-1, 3))


def area(points: Floats, tris: Ints) -> float:
    """Sum of the triangles' areas."""
    a, b, c = np.moveaxis(points[tris], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2)


@dataclass(frozen=True)
class Cut:
    """Where a level set passes through a mesh: vertices on edges, and the simplices between them.

    edges      (k, 2) nodes; the vertex is at share `weight` (k,) of the way
    simplices  (m, 3) triangles through tetrahedra or (m, 2) lines through triangles, indices into the vertices
    parent     (m,) the tetrahedron or triangle each comes from
    """

    edges: Ints
    weight: Floats
    simplices: Ints
    parent: Ints

    def interpolate(self, nodal: npt.NDArray[Any]) -> Floats:
        """Nodal values (n,) or (n, k) at the vertices."""
        values = np.asarray(nodal, float)
        w = self.weight.reshape((-1,) + (1,) * (values.ndim - 1))
        return np.asarray((1 - w) * values[self.edges[:, 0]] + w * values[self.edges[:, 1]])


def cut_volume(connectivity: Ints, level: Floats) -> Cut:
    """The tetrahedra where a nodal level set is zero; each quadratic one taken as eight plain ones."""
    tets = connectivity[:, _TET_PARTS].reshape(-1, 4)
    return cut_tets(tets, level, np.arange(len(tets)) // len(_TET_PARTS))


def cut_tets(tets: Ints, level: Floats, owner: Ints) -> Cut:
    """The plain tetrahedra (m, 4) where a nodal level set is zero; `owner` (m,) becomes the parent of what is cut out."""
    side = level[tets] >= 0
    number = side.sum(axis=1)
    pieces: list[tuple[Ints, Ints]] = []  # edges (m, 3, 2) of a triangle's vertices, and whose they are
    for alone in (True, False):
        rows = np.flatnonzero(number == (1 if alone else 3))
        tip = np.argmax(side[rows] == alone, axis=1)
        others = (tip[:, None] + np.arange(1, 4)) % 4
        cell = tets[rows]
        top = np.take_along_axis(cell, tip[:, None], 1).repeat(3, axis=1)
        pieces.append((np.stack([top, np.take_along_axis(cell, others, 1)], axis=-1), owner[rows]))
    rows = np.flatnonzero(number == 2)
    order = np.argsort(~side[rows], axis=1, kind="stable")  # the two above first
    p, q, r, s = np.take_along_axis(tets[rows], order, 1).T
    for ring in (((p, r), (p, s), (q, s)), ((p, r), (q, s), (q, r))):
        pieces.append((np.stack([np.stack(edge, axis=-1) for edge in ring], axis=1), owner[rows]))
    return _cut(level, *(np.concatenate(parts) for parts in zip(*pieces, strict=True)))


def cut_surface(tris: Ints, level: Floats) -> Cut:
    """The lines in which triangles meet the zero of a nodal level set."""
    side = level[tris] >= 0
    number = side.sum(axis=1)
    rows = np.flatnonzero((number == 1) | (number == 2))
    tip = np.argmax(side[rows] == (number[rows] == 1)[:, None], axis=1)
    others = (tip[:, None] + np.arange(1, 3)) % 3
    top = np.take_along_axis(tris[rows], tip[:, None], 1).repeat(2, axis=1)
    return _cut(level, np.stack([top, np.take_along_axis(tris[rows], others, 1)], axis=-1), rows)


def _cut(level: Floats, ends: Ints, parent: Ints) -> Cut:
    flat = np.sort(ends.reshape(-1, 2), axis=1)
    edges, number = np.unique(flat, axis=0, return_inverse=True)
    a, b = level[edges[:, 0]], level[edges[:, 1]]
    return Cut(edges, a / (a - b), number.reshape(ends.shape[:2]), parent)


def vertex_normals(points: Floats, tris: Ints) -> Floats:
    """Unit normals at the nodes, the mean over the triangles that meet there by area; 0 at nodes of none."""
    a, b, c = np.moveaxis(points[tris], 1, 0)
    flat = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normals, tris[:, corner], flat)
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(size > 0, size, 1.0))
