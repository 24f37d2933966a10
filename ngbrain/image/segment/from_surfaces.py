"""Label map from closed surfaces."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.surface.triangle_mesh import SurfaceMesh

VOXEL, FINEST = 1e-3, 1e-2
"""Voxel size (m), and its maximum relative to the smallest extent."""
AIR = 8
"""Margin (voxels)."""
_ASIDE = np.array([0.318310e-3, 0.271828e-3])
"""Offset of the rays from the voxel centres (in voxels), so that they meet no vertex of a surface on a grid."""


def labels_from_surfaces(surfaces: Iterable[tuple[str, SurfaceMesh]]) -> LabelMap:
    """Label voxels by the last surface that they are inside.

    Outer surfaces come first, and surfaces of the same name form one region. A voxel is inside if its ray crosses an odd number
    of triangles: surfaces may have cavities and any orientation.

    Parameters
    ----------
    surfaces : iterable of (str, SurfaceMesh)
        Name of the region inside, and the closed surface.

    Returns
    -------
    LabelMap

    Raises
    ------
    InputError
        A surface contains no voxel centre.

    Examples
    --------
    >>> corners = 1e-3 * np.array([[i, j, k] for i in (0, 60) for j in (0, 60) for k in (0, 60)])
    >>> faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
    ...          [1, 5, 7], [1, 7, 3]]
    >>> labels = labels_from_surfaces([("brain", SurfaceMesh(corners, np.array(faces)))])
    >>> labels.regions, round(labels.volumes_ml()["brain"])
    (('brain',), 216)
    """
    parts = list(surfaces)
    every = np.concatenate([surface.points for _, surface in parts])
    low, high = every.min(axis=0), every.max(axis=0)
    spacing = min(VOXEL, FINEST * float((high - low).min()))
    first = spacing * (np.floor(low / spacing) - AIR)
    shape = (np.ceil((high - first) / spacing).astype(int) + AIR + 1).tolist()
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = first
    data, names = np.zeros(shape, np.int32), list[str]()
    for name, surface in parts:
        inside = inside_surface(surface, first, spacing, (shape[0], shape[1], shape[2]))
        if not inside.any():
            raise InputError(f"surface {name}", "around no voxel", "a larger one, or another unit")
        if name not in names:
            names.append(name)
        data[inside] = names.index(name) + 1
    return LabelMap(Volume(data, affine), dict(enumerate(names, 1)))


def inside_surface(surface: SurfaceMesh, first: np.ndarray, spacing: float, shape: tuple[int, int, int]) -> np.ndarray:
    """Voxels whose centre is inside a closed surface, by ray casting along the third axis.

    Parameters
    ----------
    surface : SurfaceMesh
        The closed surface (m).
    first : numpy.ndarray
        (3,) m, centre of the first voxel.
    spacing : float
        Voxel spacing (m).
    shape : tuple of int
        Shape of the voxel grid.

    Returns
    -------
    numpy.ndarray
        bool, of this shape.
    """
    x = (surface.points - first) / spacing
    x[:, :2] += _ASIDE
    corners = x[surface.triangles]
    low = np.ceil(corners[:, :, :2].min(axis=1)).astype(int)
    wide = np.maximum(np.floor(corners[:, :, :2].max(axis=1)).astype(int) - low + 1, 0)
    count = wide.prod(axis=1)
    triangle = np.repeat(np.arange(len(count)), count)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    column = low[triangle] + np.stack(np.divmod(number, wide[triangle, 1]), axis=1)
    a, b, c = (corners[triangle, k] for k in range(3))
    weights = np.stack([_cross(p, q, column) for p, q in ((b, c), (c, a), (a, b))], axis=1)
    hit = (weights > 0).all(axis=1) | (weights < 0).all(axis=1)
    weights = weights[hit] / weights[hit].sum(axis=1, keepdims=True)
    height = np.einsum("ij,ij->i", weights, corners[triangle[hit], :, 2])
    above = np.clip(np.ceil(height).astype(int), 0, shape[2])
    flips = np.zeros((shape[0], shape[1], shape[2] + 1), np.uint8)
    np.add.at(flips, (*column[hit].T, above), 1)
    return (np.cumsum(flips, axis=2, dtype=np.uint8)[:, :, :-1] & 1).astype(bool)


def _cross(p: np.ndarray, q: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Side of the edge from p to q on which a point lies; of two triangles at an edge exactly one contains the point."""
    swap = (p[:, 0] > q[:, 0]) | ((p[:, 0] == q[:, 0]) & (p[:, 1] > q[:, 1]))
    s, t = np.where(swap[:, None], q, p), np.where(swap[:, None], p, q)
    side = (t[:, 0] - s[:, 0]) * (at[:, 1] - s[:, 1]) - (t[:, 1] - s[:, 1]) * (at[:, 0] - s[:, 0])
    return np.asarray(np.where(swap, -side, side))
