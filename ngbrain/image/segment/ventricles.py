"""Which of the fluid in a brain is the lateral ventricles: told from cisterns and sulci by place, by necks and by walls."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import require
from ngbrain.image.preprocess import mni_landmarks
from ngbrain.image.read.volume import Volume

_DEPTH = 8.0  # mm below the surface of the brain; fluid above is sulci
_CORE, _REACH = 1.0, 4.0  # distance from the expected course over its radius: ventricle if fluid, and none
_WALL = (3.0, 5.0)  # mm from a horn: beyond the fluid and the voxels that it shares with its wall
_WHITE = 0.45  # of the wall; measured: 0.6 and more around ventricles, 0.35 and less around cisterns

_BAND = 2.0  # mm to both sides of the first edge that the edge is looked for in
_BESIDE = (2.5, 5.5)  # mm out: what the wall is made of, past the voxels that it shares with the fluid
_SMOOTH = 2.0  # mm, over which grey values of the wall are averaged

FAR = 5.0  # radii from the middle of a ventricle, beyond which distances are not told apart

_FACES = ndimage.generate_binary_structure(3, 1)


def find_ventricles(brain: np.ndarray, fluid: np.ndarray, white: np.ndarray, near: np.ndarray) -> np.ndarray:
    """The lateral ventricles, with the third where a wide foramen joins it, as a mask.

    Fluid where ventricles are expected is flooded from there, fluid near the surface of the brain and far from ventricles
    from there, wide places first, so that the two meet in the necks between them. Pieces of fluid that neither reaches
    belong if their wall is mostly white matter: tips of horns.

    Args:
        brain: mask (nx, ny, nz) on voxels of 1 mm, not touching the faces of the array.
        fluid: mask of all cerebrospinal fluid.
        white: mask of white matter.
        near: distance from where ventricles are expected, over how thick they are there (`ventricle_distance`).

    >>> z = np.indices((70, 70, 70)) - 34.5
    >>> radius, hole = np.linalg.norm(z, axis=0), np.linalg.norm(z * [[[[1]]], [[[1]]], [[[2]]]], axis=0) < 12
    >>> bool((find_ventricles(radius < 34, hole, (radius < 30) & ~hole, radius / 5) == hole).all())
    True
    """
    flood = require("skimage.segmentation", "mri").watershed
    found = np.zeros_like(brain)
    if not (near < _REACH).any():
        return found
    within = ndimage.find_objects((near < _REACH).astype(np.uint8))[0]
    box = tuple(slice(max(axis.start - 2, 0), axis.stop + 2) for axis in within)
    depth = ndimage.distance_transform_edt(brain)[box]
    fluid, white, near = fluid[box], white[box], near[box]
    marks = np.zeros(fluid.shape, np.uint8)
    marks[fluid & ((near > _REACH) | (depth < _DEPTH))] = 2
    marks[fluid & (near < _CORE)] = 1
    if not (marks == 1).any():
        return found
    basins = flood(-ndimage.distance_transform_edt(fluid), marks, mask=fluid)
    grown = basins == 1
    pieces, _ = ndimage.label(fluid & (basins == 0) & (near < _REACH))
    grown |= _in_white(pieces, white, ndimage.binary_dilation(grown, _FACES, int(_WALL[0])))
    found[box] = ndimage.binary_fill_holes(grown)  # the choroid plexus
    return found


def ventricle_distance(affine: np.ndarray, place: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """`ngbrain.image.preprocess.mni_landmarks.ventricle` of all voxels, up to `FAR`, by interpolation on the template's
    voxels of 2 mm.

    affine  (4, 4), takes indices to points (m) of the head; place: points of the template (m) to those
    """
    size = np.array([60, 78, 54])
    template = np.diag([2e-3, 2e-3, 2e-3, 1.0])
    template[:3, 3] = [-0.06, -0.1, -0.05]
    points = 1e3 * Volume(np.empty(0), template).to_world(np.argwhere(np.ones(size, bool)))
    near = mni_landmarks.ventricle(points).clip(0, FAR).astype(np.float32).reshape(size)
    to = np.linalg.inv(template) @ np.linalg.inv(place) @ affine
    return ndimage.affine_transform(near, to[:3, :3], to[:3, 3], shape, order=1, cval=FAR)


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


def refine_ventricle_edges(ventricles: np.ndarray, picture: np.ndarray, tissue: np.ndarray) -> np.ndarray:
    """The same ventricles with their edge where the grey value is half way from fluid to the tissue behind the wall.

    A voxel of half fluid, half white matter is as bright as grey matter and gets its label, so that labels alone make
    ventricles the smaller the thicker the slices of a scan are; the place of half the step stays.

    Args:
        ventricles: mask (nx, ny, nz) on voxels of 1 mm, not touching the faces of the array.
        picture: grey values.
        tissue: mask of grey and white matter.

    >>> x = np.abs(np.indices((40, 40, 40)) - 19.5).max(axis=0)
    >>> picture, small = np.clip((x - 9) / 4, 0, 1), x < 10
    >>> bool((refine_ventricle_edges(small, picture, ~small & (x < 19)) == (x < 11)).all())
    True
    """
    box = tuple(
        slice(max(axis.start - 9, 0), axis.stop + 9) for axis in ndimage.find_objects(ventricles.astype(np.uint8))[0]
    )
    inside, picture, tissue = ventricles[box], picture[box], tissue[box]
    out, deep = ndimage.distance_transform_edt(~inside), ndimage.distance_transform_edt(inside)
    core = deep > 1.5
    if not core.any():
        return ventricles
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
