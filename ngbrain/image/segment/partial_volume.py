"""Partial-volume correction at the boundary of the brain in a coarse scan."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.image.read.volume import Scan, Volume

_COARSE = 1.5e-3  # m, cube root of the voxel volume above which a scan is coarse
_REACH = 1.5  # depth of the corrected layer, relative to the longest edge of a voxel
_FLUID = 0.01  # quantile of the grey values deeper inside, near the mean of the ventricles


def correct_partial_volume(scan: Scan, mask: np.ndarray) -> Volume:
    """Raise the grey values at the boundary of the brain to at least those of fluid; scans with small voxels are unchanged.

    Voxels of 3 mm that are half brain and half background are darker than any fluid, and many: a mixture model of the tissues
    takes them for fluid, and true fluid for grey matter. In voxels of 1 mm they are few.

    Parameters
    ----------
    scan : Scan
        The scan.
    mask : numpy.ndarray
        (nx, ny, nz) mask of the brain.

    Returns
    -------
    Volume

    Examples
    --------
    >>> ball = np.linalg.norm(np.indices((50, 50, 50)) - 24.5, axis=0)
    >>> affine = np.diag([1e-3, 1e-3, 1e-3, 1])
    >>> picture = Volume(np.select([ball < 8, ball < 20, ball < 22], [40, 90, 10]).astype(np.float32), affine)
    >>> coarse = Scan(picture, affine * 3, (17, 17, 17), "coarse.nii")
    >>> np.unique(correct_partial_volume(coarse, ball < 22).data)
    array([ 0., 40., 90.], dtype=float32)
    """
    sides = np.linalg.norm(scan.file_affine[:3, :3], axis=0)
    if np.cbrt(sides.prod()) <= _COARSE:
        return scan.volume
    data = scan.volume.data.astype(np.float32)
    box = tuple(slice(max(side.start - 1, 0), side.stop + 1) for side in ndimage.find_objects(mask.astype(np.uint8))[0])
    part, brain = data[box], mask[box]
    deep = ndimage.distance_transform_edt(brain, sampling=scan.volume.spacing) > _REACH * sides.max()
    fluid = np.quantile(part[deep], _FLUID)
    part[brain & ~deep] = part[brain & ~deep].clip(fluid)
    return Volume(data, scan.volume.affine)
