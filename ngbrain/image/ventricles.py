"""Which of the fluid in a brain is the lateral ventricles: told from cisterns and sulci by depth and by their walls."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

_DEPTH = 15.0  # mm below the surface of the brain; sulci and most cisterns are above
_SEED = 300  # mm³ that must be left of a piece when thin sheets are cut
_WALL = (3.0, 5.0)  # mm from the seed: beyond the fluid and the voxels that it shares with its wall
_WHITE = 0.45  # of the wall; measured: 0.6 and more around ventricles, 0.35 and less around cisterns
_REACH = 5  # mm of fluid around a seed that go with it, whatever their wall

_BAND = 2.0  # mm to both sides of the first edge that the edge is looked for in
_BESIDE = (2.5, 5.5)  # mm out: what the wall is made of, past the voxels that it shares with the fluid
_SMOOTH = 2.0  # mm, over which grey values of the wall are averaged

_FACES, _EDGES = (ndimage.generate_binary_structure(3, rank) for rank in (1, 2))


def find_ventricles(brain: np.ndarray, fluid: np.ndarray, white: np.ndarray) -> np.ndarray:
    """The lateral ventricles, with the third where a wide foramen joins it, as a mask.

    Eroding deep fluid leaves seeds without thin sheets. Those whose wall is mostly white matter are kept: around the
    ventricles lie corpus callosum and radiations, around the equally deep cistern of the great vein grey matter. They
    grow back out to the walls, and take in what then touches them and has such a wall itself: tips of horns.

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
    seeds = np.where(large[pieces], pieces, 0)
    grown = _in_white(seeds, white, np.zeros_like(deep))
    if not grown.any():
        return found
    grown = ndimage.binary_dilation(grown, _FACES, _REACH, mask=deep)
    # Horns may hang on thinly, and then how far a seed reaches into them is a matter of voxels.
    pieces, _ = ndimage.label(deep & ~grown)
    near = ndimage.binary_dilation(grown, _FACES)
    horns = np.isin(pieces, np.setdiff1d(pieces[near], [0]))
    grown |= _in_white(np.where(horns, pieces, 0), white, ndimage.binary_dilation(grown, _FACES, int(_WALL[0])))
    found[box] = ndimage.binary_fill_holes(grown)  # the choroid plexus
    return found


def _in_white(pieces: np.ndarray, white: np.ndarray, elsewhere: np.ndarray) -> np.ndarray:
    """Mask of the pieces (numbered from 1, 0 is none) whose wall is mostly white; voxels `elsewhere` are not looked at."""
    if not pieces.any():
        return pieces > 0
    away, nearest = ndimage.distance_transform_edt(pieces == 0, return_indices=True)
    wall = (away > _WALL[0]) & (away <= _WALL[1]) & ~elsewhere
    whose = pieces[tuple(axis[wall] for axis in nearest)]
    most = int(pieces.max()) + 1
    share = np.bincount(whose, white[wall], most) / np.maximum(np.bincount(whose, minlength=most), 1)
    return (pieces > 0) & (share >= _WHITE)[pieces]


def at_half_height(ventricles: np.ndarray, picture: np.ndarray, tissue: np.ndarray) -> np.ndarray:
    """The same ventricles with their edge where the grey value is half way from fluid to the tissue behind the wall.

    A voxel of half fluid, half white matter is as bright as grey matter and gets its label, so that labels alone make
    ventricles the smaller the thicker the slices of a scan are; the place of half the step stays.

    Args:
        ventricles: mask (nx, ny, nz) on voxels of 1 mm, not touching the faces of the array.
        picture: grey values.
        tissue: mask of grey and white matter.

    >>> x = np.abs(np.indices((40, 40, 40)) - 19.5).max(axis=0)
    >>> picture, small = np.clip((x - 9) / 4, 0, 1), x < 10
    >>> bool((at_half_height(small, picture, ~small & (x < 19)) == (x < 11)).all())
    True
    """
    box = tuple(
        slice(max(axis.start - 9, 0), axis.stop + 9) for axis in ndimage.find_objects(ventricles.astype(np.uint8))[0]
    )
    inside, picture, tissue = ventricles[box], picture[box], tissue[box]
    out, deep = ndimage.distance_transform_edt(~inside), ndimage.distance_transform_edt(inside)
    core = deep > 1.5
    wall = tissue & (out > _BESIDE[0]) & (out <= _BESIDE[1])
    behind, near = (
        ndimage.gaussian_filter(part, _SMOOTH) for part in (np.where(wall, picture, 0.0), wall.astype(float))
    )
    half = (np.median(picture[core]) + behind / np.maximum(near, 1e-9)) / 2
    band = (out <= _BAND) & (deep <= _BAND) & (near > 1e-3)
    fluid = np.where(band & (inside | tissue), picture < half, inside)
    pieces, _ = ndimage.label(inside)
    nearest = ndimage.distance_transform_edt(~inside, return_distances=False, return_indices=True)
    whose = pieces[tuple(nearest)]
    touching = ndimage.maximum_filter(np.where(fluid, whose, 0), 3) != whose
    touching |= ndimage.minimum_filter(np.where(fluid, whose, whose.max() + 1), 3) != whose
    fluid &= inside | ~touching  # the septum between two ventricles is thinner than a voxel and stays
    pieces, _ = ndimage.label(fluid)
    found = np.zeros_like(ventricles)
    found[box] = ndimage.binary_fill_holes(np.isin(pieces, np.unique(pieces[core & fluid])))
    return found
