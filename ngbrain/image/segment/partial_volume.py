"""The rim of a brain in a coarse scan: voxels that the brain shares with what is around it."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.image.read.volume import Scan, Volume

_COARSE = 1.5e-3  # m: edge of a cube as large as a file's voxel that is too much
_REACH = 1.5  # of the voxel's longest edge: how deep the rim is
_FLUID = 0.01  # quantile of the grey values deeper in: about the middle of the fluid in the ventricles


def correct_partial_volume(scan: Scan, mask: np.ndarray) -> Volume:
    """The picture with a rim of the brain, `mask` (nx, ny, nz), nowhere darker than fluid; as it is if voxels are small.

    Voxels of 3 mm, half brain and half background, are darker than any fluid, and many: a mixture of tissues fitted to
    them takes them for its fluid, and what fluid there is for grey matter. In voxels of 1 mm they are few.

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
