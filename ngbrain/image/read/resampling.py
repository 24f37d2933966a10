"""Volumes on other axes: flipped, permuted or resampled to right, front, up."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError, require
from ngbrain.image.read.volume import Volume

MOST_VOXELS = 512**3
"""Largest number of voxels of a new grid."""
_GRID = 1e-3  # m
_FWHM = np.sqrt(8 * np.log(2))  # full width at half maximum of a Gaussian, in standard deviations


def resample_to_ras(volume: Volume, spacing: float = _GRID) -> Volume:
    """Resample a volume to isotropic voxels along right, front, up (RAS).

    If flips and permutations of the axes suffice (to 1e-3 of `spacing`), values are unchanged. Otherwise they are interpolated
    by cubic splines at multiples of `spacing` in world coordinates, after smoothing along axes finer than `spacing`. The
    background (`border_value`) stays exact, and no value leaves the original range. The affine is rounded to 1 µm, so that
    flipped copies of an image give the same result.

    Parameters
    ----------
    volume : Volume
        The volume.
    spacing : float, optional
        Voxel spacing (m).

    Returns
    -------
    Volume

    Raises
    ------
    InputError
        The new grid would have more than 512³ voxels.
    MissingExtra
        nibabel is not installed.

    Examples
    --------
    >>> image = Volume(np.eye(3, dtype=np.float32)[:, :, None] * np.ones(2, np.float32), np.diag([-1e-3, 1e-3, 1e-3, 1]))
    >>> resample_to_ras(image).affine[:3, 3], resample_to_ras(image).data[:, :, 0].tolist()
    (array([-0.002, 0. , 0. ]), [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    """
    volume = reorient_to_ras(volume)
    linear = volume.affine[:3, :3]
    steps = np.diag(linear)
    if np.abs(linear - np.diag(steps)).max() <= 1e-6 * spacing and np.abs(steps - spacing).max() <= 1e-3 * spacing:
        return volume
    corners = volume.to_world(np.array(list(np.ndindex(2, 2, 2))) * np.array(volume.data.shape) - 0.5)
    # Tolerance of 1e-6 voxels: corners that fall on grid points up to round-off are included.
    first = np.ceil(corners.min(axis=0) / spacing - 1e-6)
    shape = np.floor(corners.max(axis=0) / spacing + 1e-6).astype(int) - first.astype(int) + 1
    if shape.prod() > MOST_VOXELS:
        found = "x".join(map(str, shape)) + f" voxels of {1e3 * spacing:g} mm"
        raise InputError("image", found, "at most 512³ of them")
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = spacing * first
    matrix = np.linalg.solve(volume.affine, affine)
    turn, offset = matrix[:3, :3], matrix[:3, 3]
    if np.abs(turn - np.diag(np.diag(turn))).max() <= 1e-9:
        turn = np.diag(turn)  # then spline weights are computed once per axis

    background, _ = border_value(volume)
    # Zero around the image: half a voxel outside, its share falls below one half.
    picture = (volume.data != background).astype(np.float32)
    share = ndimage.affine_transform(picture, turn, offset, tuple(shape), order=1, mode="grid-constant")
    inside = share >= 0.5
    values = np.full(inside.shape, background, np.float32)

    data = volume.data.astype(np.float32, copy=False)
    # Anti-aliasing: a Gaussian that widens an old voxel to the width of a new one.
    blur = np.sqrt(np.maximum((spacing / volume.spacing) ** 2 - 1, 0)) / _FWHM
    smooth = ndimage.gaussian_filter(data, blur)
    new = ndimage.affine_transform(smooth, turn, offset, tuple(shape), order=3, mode="nearest")
    values[inside] = new[inside].clip(data.min(), data.max())
    return Volume(values, affine)


def border_value(volume: Volume) -> tuple[float, float]:
    """The most common value on the six faces of a volume, and its share of their voxels.

    >>> border_value(Volume(np.pad(np.ones((2, 2, 2)), 1), np.eye(4)))
    (0.0, 1.0)
    """
    faces = [volume.data.take(end, axis).ravel() for axis in range(3) for end in (0, -1)]
    values, counts = np.unique(np.concatenate(faces), return_counts=True)
    most = counts.argmax()
    return float(values[most]), float(counts[most] / counts.sum())


def reorient_to_ras(volume: Volume) -> Volume:
    """Flip and permute the axes so that they are as close as possible to right, front, up (RAS); no interpolation."""
    orientations = require("nibabel.orientations", "mri")
    turn = orientations.io_orientation(volume.affine)
    affine = volume.affine @ orientations.inv_ornt_aff(turn, volume.data.shape)
    # Remove round-off of the flips and of a float32 header.
    affine[:3, :3] = affine[:3, :3].round(9)
    affine[:3, 3] = affine[:3, 3].round(6)
    return Volume(np.ascontiguousarray(orientations.apply_orientation(volume.data, turn)), affine + 0.0)  # no -0.0
