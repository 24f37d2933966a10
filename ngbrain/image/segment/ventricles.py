"""Segmentation of the lateral ventricles: separated from cisterns and sulci by position, necks and walls."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import require
from ngbrain.image.preprocess import mni_landmarks
from ngbrain.image.read.volume import Volume

_DEPTH = 8.0  # mm below the surface of the brain; fluid above is sulci
_CORE, _REACH = 1.0, 4.0  # relative distance from the centre line: fluid is surely ventricle below, surely not above
_WALL = (3.0, 5.0)  # mm, distance of the wall from a horn, beyond its partial-volume voxels
_WHITE = 0.45  # minimum share of white in the wall; measured: 0.6 and more at ventricles, 0.35 and less at cisterns

_BAND = 2.0  # mm, search range on both sides of the first edge
_BESIDE = (2.5, 5.5)  # mm, distance of the wall from the edge, beyond its partial-volume voxels
_SMOOTH = 2.0  # mm, averaging of the grey values of the wall

FAR = 5.0  # maximum of the relative distance

_FACES = ndimage.generate_binary_structure(3, 1)


def find_ventricles(brain: np.ndarray, fluid: np.ndarray, white: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Mask of the lateral ventricles, with the third where a wide foramen connects it.

    Watersheds start from fluid where ventricles are expected, and from fluid near the surface of the brain or far from
    ventricles; wide places come first, so that the two meet in the necks between them. Components of fluid that neither reaches
    belong to the ventricles if their wall is mostly white matter: tips of horns.

    Parameters
    ----------
    brain : numpy.ndarray
        (nx, ny, nz) mask on voxels of 1 mm, not touching the faces of the array.
    fluid : numpy.ndarray
        Mask of all cerebrospinal fluid.
    white : numpy.ndarray
        Mask of white matter.
    near : numpy.ndarray
        Distance from the expected ventricles relative to their radius (`ventricle_distance`).

    Returns
    -------
    numpy.ndarray
        (nx, ny, nz) mask.

    Examples
    --------
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
    """`ngbrain.image.preprocess.mni_landmarks.ventricle` at all voxels, up to `FAR`, interpolated from a 2 mm grid of the
    template.

    Parameters
    ----------
    affine : numpy.ndarray
        (4, 4), from voxel indices to points (m) of the head.
    place : numpy.ndarray
        (4, 4), from points (m) of the template to points (m) of the head.
    shape : tuple of int
        Shape of the voxel grid.

    Returns
    -------
    numpy.ndarray
        float32, of this shape.
    """
    size = np.array([60, 78, 54])
    template = np.diag([2e-3, 2e-3, 2e-3, 1.0])
    template[:3, 3] = [-0.06, -0.1, -0.05]
    points = 1e3 * Volume(np.empty(0), template).to_world(np.argwhere(np.ones(size, bool)))
    near = mni_landmarks.ventricle(points).clip(0, FAR).astype(np.float32).reshape(size)
    to = np.linalg.inv(template) @ np.linalg.inv(place) @ affine
    return ndimage.affine_transform(near, to[:3, :3], to[:3, 3], shape, order=1, cval=FAR)


def _in_white(pieces: np.ndarray, white: np.ndarray, elsewhere: np.ndarray) -> np.ndarray:
    """Mask of the components (numbered from 1) whose wall is mostly white matter; voxels `elsewhere` are ignored."""
    if not pieces.any():
        return pieces > 0
    away, nearest = ndimage.distance_transform_edt(pieces == 0, return_indices=True)
    wall = (away > _WALL[0]) & (away <= _WALL[1]) & ~elsewhere
    whose = pieces[tuple(axis[wall] for axis in nearest)]
    most = int(pieces.max()) + 1
    share = np.bincount(whose, white[wall], most) / np.maximum(np.bincount(whose, minlength=most), 1)
    return (pieces > 0) & (share >= _WHITE)[pieces]


def refine_ventricle_edges(ventricles: np.ndarray, picture: np.ndarray, tissue: np.ndarray) -> np.ndarray:
    """Move the edge of the ventricles to the grey value half way between fluid and the tissue behind the wall.

    A voxel of half fluid and half white matter is as bright as grey matter and is labelled so. Labels alone therefore make
    ventricles smaller the thicker the slices of a scan are; the position of half the step does not depend on that.

    Parameters
    ----------
    ventricles : numpy.ndarray
        (nx, ny, nz) mask on voxels of 1 mm, not touching the faces of the array.
    picture : numpy.ndarray
        Grey values.
    tissue : numpy.ndarray
        Mask of grey and white matter.

    Returns
    -------
    numpy.ndarray
        (nx, ny, nz) mask.

    Examples
    --------
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
    fluid &= inside | ~touching  # keeps the septum between the ventricles, which is thinner than a voxel
    pieces, _ = ndimage.label(fluid)
    found = np.zeros_like(ventricles)
    found[box] = ndimage.binary_fill_holes(np.isin(pieces, np.unique(pieces[core & fluid])))
    return found
