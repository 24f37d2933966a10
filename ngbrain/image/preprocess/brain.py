"""The brain in any T1 of a head, with its skull or without."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ngbrain.image.preprocess.check_brain import check_whole, foreground_mask
from ngbrain.image.preprocess.registration import Alignment
from ngbrain.image.preprocess.skull_strip import align_template
from ngbrain.image.preprocess.skull_strip import skull_strip as own
from ngbrain.image.read.volume import Scan, Volume


def find_brain(scan: Scan, strip: Callable[[Scan], np.ndarray] | None = None) -> np.ndarray:
    """The whole brain, sulci included, as a mask (nx, ny, nz) over `scan.volume`.

    In a brain-extracted scan (`check_extracted`) it is what differs from the background, if that is like the template's
    brain (`ngbrain.image.preprocess.skull_strip.align_template`): other contrasts and balls without a skull look whole as well. In
    any other, `ngbrain.image.preprocess.skull_strip.skull_strip` finds it, or what takes its place, such as those in
    `ngbrain.image.preprocess.external_skull_strip`.

    Raises:
        InputError: the field of view cuts the brain; less than 0.7 litres; or a picture of something else, see `strip`.
        MissingExtra: the head has a skull, and nilearn or SimpleITK is not installed.

    >>> from ngbrain.image import mni152
    >>> scan = mni152()
    >>> f"{find_brain(scan).sum() * scan.volume.voxel_volume * 1e3:.2f} litres"
    '1.89 litres'
    """
    return find_brain_and_alignment(scan, strip)[0]


def find_brain_and_alignment(
    scan: Scan, strip: Callable[[Scan], np.ndarray] | None = None
) -> tuple[np.ndarray, Alignment]:
    """What `find_brain` finds, and where the MNI152 template lies in the scan; raises as that does."""
    mask, more = foreground_mask(scan)
    place = align_template(scan) if more and strip is None else None
    if more:
        mask = strip(scan) if strip else own(scan, place)
    check_whole(scan, mask)
    return mask, place or align_template(replace(scan, volume=_on_dark(scan.volume, mask)))


def _on_dark(volume: Volume, mask: np.ndarray) -> Volume:
    """The picture with a background as dark as the darkest in the mask: a background may be as bright as it likes."""
    dark = np.quantile(volume.data[mask], 0.001)
    return Volume(np.where(mask, volume.data.clip(dark), dark).astype(np.float32), volume.affine)
