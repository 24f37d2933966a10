"""The brain in any T1 of a head, with its skull or without."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ngbrain.image.extracted import check_whole, parted
from ngbrain.image.strip import strip
from ngbrain.image.volume import Scan


def find_brain(scan: Scan, strip: Callable[[Scan], np.ndarray] = strip) -> np.ndarray:
    """The whole brain, sulci included, as a mask (nx, ny, nz) over `scan.volume`.

    In a brain-extracted scan (`check_extracted`) it is what differs from the background. In any other, `strip` finds it:
    `ngbrain.image.strip.strip`, or what takes its place, such as those in `ngbrain.image.backends`.

    Raises:
        InputError: the field of view cuts the brain; less than 0.7 litres; or a picture of something else, see `strip`.
        MissingExtra: the head has a skull, and nilearn or SimpleITK is not installed.

    >>> from ngbrain.image import mni152
    >>> scan = mni152()
    >>> f"{find_brain(scan).sum() * scan.volume.voxel_volume * 1e3:.2f} litres"
    '1.89 litres'
    """
    mask, more = parted(scan)
    if more:
        mask = strip(scan)
    check_whole(scan, mask)
    return mask
