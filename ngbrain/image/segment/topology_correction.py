"""Topology correction: handles are cut and cavities filled, so that the surface of a region is a sphere."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError

OFFSETS = np.array([o for o in product((-1, 0, 1), repeat=3) if any(o) and len({0, *o}) == 2])
"""The 14 neighbours of a voxel, (14, 3): those connected by an edge when every cube between eight voxel centres is cut into six
tetrahedra along its diagonal from the first to the last corner (Kuhn's triangulation). Region and outside have the same
connectivity, and the surface between them has no ambiguities."""
NEIGHBOURS = np.zeros((3, 3, 3), bool)
"""The same as a structure for `scipy.ndimage`."""
NEIGHBOURS[tuple((OFFSETS + 1).T)] = True
NEIGHBOURS[1, 1, 1] = True
_STEP = 0.25  # voxels, depth of a growth step


def largest_filled_component(mask: np.ndarray) -> np.ndarray:
    """Largest connected component of a mask (nx, ny, nz) by 14 neighbours, with its cavities filled.

    Raises
    ------
    InputError
        The mask is empty.

    Examples
    --------
    >>> row = np.array([[[True, False, True, True]]])
    >>> largest_filled_component(row).astype(int).tolist()
    [[[0, 0, 1, 1]]]
    """
    pieces, count = ndimage.label(mask, NEIGHBOURS)
    if not count:
        raise InputError("mask", "empty", "a region of at least a voxel")
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    # The outside surrounds the array.
    filled = ndimage.binary_fill_holes(np.pad(pieces == sizes.argmax(), 1), NEIGHBOURS)
    return np.asarray(filled[1:-1, 1:-1, 1:-1])


def correct_topology(mask: np.ndarray) -> np.ndarray:
    """Region with the topology of a ball, by 14 neighbours, inside the largest filled component of a mask (nx, ny, nz).

    It grows from the deepest voxel, deep voxels first, by simple points, which change no topology: their inside neighbours are
    connected among themselves, and so are the outside ones. A handle is therefore cut where it is thin, by a layer of one
    voxel; a tunnel is never filled.

    Raises
    ------
    InputError
        The mask is empty.

    References
    ----------
    Simple points: Bertrand & Malandain 1994, doi:10.1016/0167-8655(94)90046-9. Cortex by such growth: Kriegeskorte & Goebel
    2001, doi:10.1006/nimg.2001.0831.

    Examples
    --------
    >>> ring = np.ones((3, 3, 1), bool)
    >>> ring[1, 1] = False
    >>> int(correct_topology(ring).sum())
    7
    """
    allowed = np.pad(largest_filled_component(mask), 1)
    depth = np.floor(ndimage.distance_transform_edt(allowed) / _STEP).astype(np.int32).ravel()
    strides = np.array(allowed.strides) // allowed.itemsize
    beside = OFFSETS @ strides
    # Voxels of one class are no neighbours of each other and may be added together.
    classes = (np.indices(allowed.shape) % 2 * np.array([4, 2, 1])[:, None, None, None]).sum(axis=0).ravel()
    weights = 1 << np.arange(len(OFFSETS))
    simple = _simple()
    inside = np.zeros(allowed.size, bool)
    inside[depth.argmax()] = True
    slot = np.zeros(allowed.size, np.int32)

    def unique_voxels(voxels: np.ndarray) -> np.ndarray:
        voxels = voxels[(depth[voxels] > 0) & ~inside[voxels]]
        slot[voxels] = np.arange(len(voxels))  # keeps the last of duplicates; faster than sorting
        return voxels[slot[voxels] == np.arange(len(voxels))]

    border = depth.argmax() + beside  # voxels adjacent to the inside that are not deep enough yet
    for level in np.unique(depth[depth > 0])[::-1]:
        border = unique_voxels(border)
        later = [border[depth[border] < level]]
        front = border[depth[border] >= level]
        while len(front):
            added = []
            for number in range(8):
                mine = front[classes[front] == number]
                mine = mine[simple[inside[mine[:, None] + beside] @ weights]]
                inside[mine] = True
                added.append(mine)
            near = unique_voxels((np.concatenate(added)[:, None] + beside).ravel())
            later.append(near[depth[near] < level])
            front = near[depth[near] >= level]
        border = np.concatenate(later)
    return np.ascontiguousarray(inside.reshape(allowed.shape)[1:-1, 1:-1, 1:-1])


@cache
def _simple() -> np.ndarray:
    """Whether adding a voxel keeps the topology, by a bit mask of its inside neighbours: (2^14,).

    The neighbours are the vertices of a triangulated sphere around the voxel. If the inside ones are connected and so are the
    outside ones, and there are both, each set is a disc.
    """
    differences = OFFSETS[:, None] - OFFSETS
    joined = (differences[:, :, None] == OFFSETS).all(axis=3).any(axis=2)
    bits = joined @ (1 << np.arange(len(OFFSETS)))
    codes = np.arange(1 << len(OFFSETS))
    return _inside_connected(codes, bits) & _inside_connected(codes[::-1], bits)


def _inside_connected(codes: np.ndarray, bits: np.ndarray) -> np.ndarray:
    reached = codes & -codes
    for _ in range(len(bits)):
        for k, near in enumerate(bits):
            reached = np.where(reached >> k & 1, reached | near & codes, reached)
    return (reached == codes) & (codes > 0)
