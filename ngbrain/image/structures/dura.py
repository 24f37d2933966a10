"""Falx and tentorium, the dural sheets between the parts of a brain, as open triangulated surfaces."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from ngbrain.errors import InputError
from ngbrain.image.preprocess.mni_landmarks import free_margin
from ngbrain.image.read.volume import Volume
from ngbrain.image.structures.structures import CEREBELLUM, LEFT, PARTS, RIGHT, Structures

_STEP = 2.0  # mm between vertices
_FINE = 0.5  # mm between sampling points of the search lines
_BLUR = 1.0  # mm, smoothing of the parts
_BESIDE = 4.0  # mm, range on both sides of the surface
_FILL = 0.75  # minimum share of that range that a part must fill
_SMOOTH = 2.0  # mm, smoothing of the surface
_CLEAR = 3.0  # mm, minimum distance of falx and corpus callosum

Sheet = tuple[np.ndarray, np.ndarray]


def falx(found: Structures) -> Sheet:
    """Vertices (n, 3) m and triangles (m, 3) of the falx: where left and right cerebrum meet, facing right.

    It extends from the skull to its free margin, which a T1 does not show: here a line from the crista galli over the corpus
    callosum to the tentorium, 5 mm above the template's corpus callosum (`ngbrain.image.preprocess.mni_landmarks.free_margin`)
    and at least 3 mm from the subject's. The vertices are 2 mm apart; the surface is connected, has an edge, and is a graph
    over the template's mid plane.

    Raises
    ------
    InputError
        Left and right cerebrum do not meet.

    Examples
    --------
    >>> from ngbrain.image import mni152
    >>> from ngbrain.image.labelling import label_structures
    >>> points, triangles = falx(label_structures(mni152()))
    >>> f"{1e3 * np.abs(points[:, 0]).mean():.0f} mm from the middle on average"
    '0 mm from the middle on average'
    """
    y, z = np.arange(-112.0, 84.0, _STEP), np.arange(-60.0, 94.0, _STEP)
    where = np.stack(np.meshgrid(y, z, indexing="ij"), axis=-1)
    return _sheet(found, (LEFT,), (RIGHT,), 0, (-15.0, 15.0), where, free_margin(where) > 0)


def tentorium(found: Structures) -> Sheet:
    """Vertices (n, 3) m and triangles (m, 3) of the tentorium: where the cerebellum meets the cerebrum, facing up.

    As `falx`; a graph over the template's horizontal plane, without the surroundings of the brain stem, where no cerebrum lies
    on the cerebellum.
    """
    x, y = np.arange(-70.0, 72.0, _STEP), np.arange(-112.0, -8.0, _STEP)
    where = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    return _sheet(found, (CEREBELLUM,), (LEFT, RIGHT), 2, (-60.0, 20.0), where, np.ones(where.shape[:2], bool))


def _sheet(
    found: Structures,
    below: tuple[int, ...],
    above: tuple[int, ...],
    axis: int,
    reach: tuple[float, float],
    where: np.ndarray,
    wanted: np.ndarray,
) -> Sheet:
    """Surface where one part ends and another begins along an axis of the template; `where` (k, l, 2) are the positions of the
    lines.
    """
    heights = np.arange(reach[0], reach[1] + _FINE, _FINE)
    lines = np.insert(np.repeat(where[..., None, :], len(heights), axis=-2), axis, 0.0, axis=-1)
    lines[..., axis] = heights
    shares = [_share(found, part, lines) for part in (below, above)]
    n = int(_BESIDE / _FINE)
    before, after = (np.lib.stride_tricks.sliding_window_view(share, n, axis=-1).mean(axis=-1) for share in shares)
    both = np.minimum(before[..., :-n], after[..., n:])
    at, best = both.argmax(axis=-1), both.max(axis=-1)
    sure = wanted & (best > _FILL)
    there = _largest(ndimage.binary_opening(ndimage.binary_closing(sure)) & wanted)
    sure &= there
    middle = heights[at + n] - _FINE / 2
    height, weight = (
        ndimage.gaussian_filter(each, _SMOOTH / _STEP) for each in (np.where(sure, middle, 0.0), sure.astype(float))
    )
    points = np.insert(where, axis, height / np.maximum(weight, 1e-6), axis=-1)
    points = 1e-3 * points @ found.affine[:3, :3].T + found.affine[:3, 3]
    if axis == 0:
        there = _largest(there & (_from_callosum(found, points) > 1e-3 * _CLEAR))
    i, j = np.nonzero(there[:-1, :-1] & there[1:, :-1] & there[1:, 1:] & there[:-1, 1:])
    squares = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
    if not len(i):
        names = [" and ".join(PARTS[part] for part in side) for side in (below, above)]
        raise InputError("structures", f"without a place where {names[0]} meets {names[1]}", "a whole brain")
    used = np.zeros_like(there)
    for corner in squares:
        used[corner] = True
    number = np.cumsum(used).reshape(used.shape) - 1
    a, b, c, d = (number[corner] for corner in squares)
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return points[used], triangles


def _from_callosum(found: Structures, points: np.ndarray) -> np.ndarray:
    region = [number for number, name in found.labels.names.items() if name == "corpus_callosum"]
    voxels = np.argwhere(np.isin(found.labels.volume.data, region))
    if not len(voxels):
        return np.full(points.shape[:-1], np.inf)
    return np.asarray(cKDTree(found.labels.volume.to_world(voxels)).query(points)[0])


def _share(found: Structures, parts: tuple[int, ...], lines: np.ndarray) -> np.ndarray:
    mask = np.isin(found.parts.data, parts).astype(np.float32)
    smooth = ndimage.gaussian_filter(mask, 1e-3 * _BLUR / found.parts.spacing)
    points = 1e-3 * lines.reshape(-1, 3) @ found.affine[:3, :3].T + found.affine[:3, 3]
    return Volume(smooth, found.parts.affine).interpolate(points).reshape(lines.shape[:-1])


def _largest(mask: np.ndarray) -> np.ndarray:
    pieces, count = ndimage.label(mask)
    return np.asarray(pieces == np.bincount(pieces.ravel())[1:].argmax() + 1) if count else mask
