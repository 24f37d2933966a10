"""Surfaces and plane sections of quadratic tetrahedral meshes, as plain triangles and lines."""

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
    """Six-node faces on the outside, or on the interfaces of two groups.

    Parameters
    ----------
    connectivity : ndarray of int, shape (m, 10)
        Tetrahedra in VTK's order.
    group : ndarray, shape (m,), optional
        Label of each tetrahedron; None: only the outer surface.

    Returns
    -------
    ndarray of int, shape (k, 6)
        Faces with outward normals, each once.
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


def outer_triangles(tets: Ints) -> Ints:
    """Outer surface of plain tetrahedra.

    Parameters
    ----------
    tets : ndarray of int, shape (m, 4)
        Tetrahedra.

    Returns
    -------
    ndarray of int, shape (k, 3)
        Triangles that belong to one tetrahedron.
    """
    every = tets[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    _, first, count = np.unique(np.sort(every, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(every[first[count == 1]])


def triangles(quadratic: Ints) -> Ints:
    """Split each six-node face into four plain triangles (4 k, 3), in the order of the faces."""
    return np.asarray(quadratic[:, _FACE_PARTS].reshape(-1, 3))


def area(points: Floats, tris: Ints) -> float:
    """Total area of triangles.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tris : ndarray of int, shape (m, 3)
        Triangles.

    Returns
    -------
    float
        Area (m²).
    """
    a, b, c = np.moveaxis(points[tris], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2)


@dataclass(frozen=True)
class Cut:
    """Intersection of a level set with a mesh: vertices on edges, and the simplices between them.

    Parameters
    ----------
    edges : ndarray of int, shape (k, 2)
        Nodes of the cut edges.
    weight : ndarray, shape (k,)
        Position of the vertex on its edge, from 0 to 1.
    simplices : ndarray of int, shape (m, 3) or (m, 2)
        Triangles through tetrahedra, or lines through triangles.
    parent : ndarray of int, shape (m,)
        The tetrahedron or triangle of each simplex.
    """

    edges: Ints
    weight: Floats
    simplices: Ints
    parent: Ints

    def interpolate(self, nodal: npt.NDArray[Any]) -> Floats:
        """Interpolate nodal values (n,) or (n, k) to the vertices."""
        values = np.asarray(nodal, float)
        w = self.weight.reshape((-1,) + (1,) * (values.ndim - 1))
        return np.asarray((1 - w) * values[self.edges[:, 0]] + w * values[self.edges[:, 1]])


def cut_volume(connectivity: Ints, level: Floats) -> Cut:
    """Cut tetrahedra by the zero of a nodal level set; each quadratic one is taken as eight plain ones.

    Parameters
    ----------
    connectivity : ndarray of int, shape (m, 10)
        Tetrahedra in VTK's order.
    level : ndarray, shape (n,)
        Level set at the nodes.

    Returns
    -------
    Cut
        Triangles.
    """
    tets = connectivity[:, _TET_PARTS].reshape(-1, 4)
    return cut_tets(tets, level, np.arange(len(tets)) // len(_TET_PARTS))


def cut_tets(tets: Ints, level: Floats, owner: Ints) -> Cut:
    """Cut plain tetrahedra by the zero of a nodal level set.

    Parameters
    ----------
    tets : ndarray of int, shape (m, 4)
        Tetrahedra.
    level : ndarray, shape (n,)
        Level set at the nodes.
    owner : ndarray of int, shape (m,)
        Parent of the simplices from each tetrahedron.

    Returns
    -------
    Cut
        Triangles.
    """
    side = level[tets] >= 0
    number = side.sum(axis=1)
    pieces: list[tuple[Ints, Ints]] = []  # edges (m, 3, 2) of a triangle's vertices, and its tetrahedron
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
    """Cut triangles by the zero of a nodal level set.

    Parameters
    ----------
    tris : ndarray of int, shape (m, 3)
        Triangles.
    level : ndarray, shape (n,)
        Level set at the nodes.

    Returns
    -------
    Cut
        Lines.
    """
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
    """Area-weighted unit normals at the nodes; 0 at unused nodes.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tris : ndarray of int, shape (m, 3)
        Triangles.

    Returns
    -------
    ndarray, shape (n, 3)
        Normals.
    """
    a, b, c = np.moveaxis(points[tris], 1, 0)
    flat = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normals, tris[:, corner], flat)
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(size > 0, size, 1.0))
