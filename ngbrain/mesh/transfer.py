"""Transfer of a mesh's regions to the voxels of an image."""

from __future__ import annotations

import numpy as np

from ngbrain.image.read.volume import Volume
from ngbrain.mesh.tet_mesh import Elements

_CHUNK = 4_000_000
_SLACK = 1e-9


def voxelise(
    elements: Elements, affine: np.ndarray, shape: tuple[int, int, int]
) -> tuple[Volume, np.ndarray, np.ndarray]:
    """Regions of a mesh on an image grid, and the element that contains each voxel centre.

    Parameters
    ----------
    elements : Elements
        The mesh.
    affine : ndarray, shape (4, 4)
        Voxel indices → m, in any orientation, for example that of a file.
    shape : tuple of int
        Number of voxels along each axis.

    Returns
    -------
    regions : Volume
        Label map, uint8: regions from 1, outside 0.
    voxels : ndarray of int, shape (k,)
        Flat indices of the voxels inside the mesh.
    owner : ndarray of int, shape (k,)
        Tetrahedron of each of them. A centre on a common face belongs to one of the two tetrahedra.

    Examples
    --------
    >>> tet = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4.0]]) * 1e-3
    >>> none = np.zeros((0, 3), int)
    >>> one = Elements(tet, np.array([[1, 0, 2, 3]]), np.zeros(1, int), none, np.zeros(0, int), ("brain",), ())
    >>> voxelise(one, np.diag([1e-3, 1e-3, 1e-3, 1]), (4, 4, 4))[0].data.sum().item()
    32
    """
    owner = np.full(int(np.prod(shape)), -1, np.int64)
    inverse = np.linalg.inv(affine)
    at = elements.points @ inverse[:3, :3].T + inverse[:3, 3]
    corners = at[elements.tets]
    low = np.clip(np.ceil(corners.min(axis=1) - _SLACK), 0, shape).astype(int)
    high = np.clip(np.floor(corners.max(axis=1) + _SLACK) + 1, 0, shape).astype(int)
    extent = np.maximum(high - low, 0)
    number = extent.prod(axis=1)
    to_bary = np.linalg.inv((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))
    rows = np.flatnonzero(number)
    for chunk in np.split(rows, np.flatnonzero(np.diff(np.cumsum(number[rows]) // _CHUNK)) + 1):
        t = np.repeat(chunk, number[chunk])
        k = np.arange(len(t)) - np.repeat(np.cumsum(number[chunk]) - number[chunk], number[chunk])
        e = extent[t]
        i = low[t] + np.column_stack([k // (e[:, 1] * e[:, 2]), k // e[:, 2] % e[:, 1], k % e[:, 2]])
        bary = np.einsum("nij,nj->ni", to_bary[t], i - corners[t, 0])
        inside = (bary >= -_SLACK).all(axis=1) & (bary.sum(axis=1) <= 1 + _SLACK)
        owner[np.ravel_multi_index(tuple(i[inside].T), shape)] = t[inside]
    voxels = np.flatnonzero(owner >= 0)
    regions = np.zeros(len(owner), np.uint8)
    regions[voxels] = elements.region[owner[voxels]] + 1
    return Volume(regions.reshape(shape), affine), voxels, owner[voxels]
