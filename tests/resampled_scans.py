"""Copies of a scan of the same head on other grids."""

import numpy as np
from scipy import ndimage

from ngbrain.image import Volume


def rotation(degrees, axis):
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def slanted(volume, degrees=12.0, axis=(1.0, 2.0, 0.5)):
    """The same head in a scanner with rotated axes; margins of 8 voxels, exact zeros."""
    centre = volume.to_world(np.array([volume.data.shape]) / 2)[0]
    shape = np.array(volume.data.shape) + 16
    affine = np.eye(4)
    affine[:3, :3] = rotation(degrees, np.array(axis)) * 1e-3
    affine[:3, 3] = centre - affine[:3, :3] @ (shape / 2)
    to = np.linalg.inv(volume.affine) @ affine
    where = {"matrix": to[:3, :3], "offset": to[:3, 3], "output_shape": tuple(shape)}
    data = ndimage.affine_transform(volume.data, order=3, **where)
    data[ndimage.affine_transform((volume.data != 0).astype(np.float32), order=1, **where) < 0.5] = 0
    return Volume(data, affine)


def thick(volume):
    """Pairs of slices averaged: voxels of 1 x 1 x 2 mm."""
    data = volume.data[:, :, : volume.data.shape[2] // 2 * 2]
    first, second = data[:, :, ::2], data[:, :, 1::2]
    affine = volume.affine @ np.diag([1, 1, 2.0, 1])
    affine[:3, 3] += [0, 0, 0.5e-3]
    # Where one of the two is outside, an extraction would decide this way or that: every other column.
    half = (first != 0) ^ (second != 0)
    keep = np.indices(half.shape).sum(axis=0) % 2 == 0
    return Volume(np.where(half & ~keep, 0, (first + second) / 2), affine)


def fine(volume):
    """Voxels of 0.5 mm, each 1 mm voxel twice along x."""
    affine = volume.affine @ np.diag([0.5, 1, 1, 1])
    affine[:3, 3] -= [0.25e-3, 0, 0]
    return Volume(np.repeat(volume.data, 2, axis=0), affine)
