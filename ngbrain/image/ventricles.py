"""Which of the fluid in a brain is the lateral ventricles: told from cisterns and sulci by depth and by their walls."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

_DEPTH = 15.0  # mm below the surface of the brain; sulci and most cisterns are above
_SEED = 300  # mm³ that must be left of a piece when thin sheets are cut
_WALL = (3.0, 5.0)  # mm from the seed: beyond the fluid and the voxels that it shares with its wall
_WHITE = 0.45  # of the wall; measured: 0.6 and more around ventricles, 0.35 and less around cisterns
_REACH = 5  # mm of fluid around a seed that go with it

_FACES, _EDGES = (ndimage.generate_binary_structure(3, rank) for rank in (1, 2))


def find_ventricles(brain: np.ndarray, fluid: np.ndarray, white: np.ndarray) -> np.ndarray:
    """The lateral ventricles, with the third where a wide foramen joins it, as a mask.

    Eroding deep fluid leaves seeds without thin sheets. Those whose wall is mostly white matter are kept: around the
    ventricles lie corpus callosum and radiations, around the equally deep cistern of the great vein grey matter. They
    grow back into the horns and out to the walls.

    Args:
        brain: mask (nx, ny, nz) on voxels of 1 mm, not touching the faces of the array.
        fluid: mask of all cerebrospinal fluid.
        white: mask of white matter.

    >>> z = np.indices((70, 70, 70)) - 34.5
    >>> radius, hole = np.linalg.norm(z, axis=0), np.linalg.norm(z * [[[[1]]], [[[1]]], [[[2]]]], axis=0) < 12
    >>> bool((find_ventricles(radius < 34, hole, (radius < 30) & ~hole) == hole).all())
    True
    """
    depth = ndimage.distance_transform_edt(brain)
    found = np.zeros_like(brain)
    if not (depth > _DEPTH).any():
        return found
    box = ndimage.find_objects((depth > _DEPTH).astype(np.uint8))[0]  # walls are looked at up to its faces
    deep, white = fluid[box] & (depth[box] > _DEPTH), white[box]
    pieces, count = ndimage.label(ndimage.binary_erosion(deep, _EDGES))
    large = np.bincount(pieces.ravel(), minlength=count + 1) >= _SEED
    large[0] = False
    if not large.any():
        return found
    away, nearest = ndimage.distance_transform_edt(~large[pieces], return_indices=True)
    wall = (away > _WALL[0]) & (away <= _WALL[1])
    whose = pieces[tuple(axis[wall] for axis in nearest)]
    seen = np.bincount(whose, minlength=count + 1)
    share = np.bincount(whose, white[wall], minlength=count + 1) / np.maximum(seen, 1)
    grown = (large & (share >= _WHITE))[pieces]
    if not grown.any():
        return found
    grown = ndimage.binary_dilation(grown, _FACES, _REACH, mask=deep)
    found[box] = ndimage.binary_fill_holes(grown)  # the choroid plexus
    return found
