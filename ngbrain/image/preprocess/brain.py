"""Brain mask of any T1 of a head, with or without skull."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ngbrain.image.preprocess.check_brain import check_whole, foreground_mask
from ngbrain.image.preprocess.registration import Alignment
from ngbrain.image.preprocess.skull_strip import align_template, skull_strip
from ngbrain.image.read.volume import Scan, Volume


def find_brain(scan: Scan, strip: Callable[[Scan], np.ndarray] | None = None) -> np.ndarray:
    """Mask of the whole brain, sulci included.

    In a skull-stripped scan (`check_extracted`) the brain is what differs from the background, if it is like the template's
    brain (`align_template`), because other contrasts and balls without a skull are complete as well. In any other scan it is
    found by `skull_strip`, or by a replacement such as those in `ngbrain.image.preprocess.external_skull_strip`.

    Parameters
    ----------
    scan : Scan
        The T1.
    strip : callable, optional
        Skull stripping: the brain mask of a scan.

    Returns
    -------
    numpy.ndarray
        (nx, ny, nz) mask over `scan.volume`.

    Raises
    ------
    InputError
        The field of view cuts the brain; the brain has less than 0.7 litres; or the image is no T1 of a brain, see
        `skull_strip`.
    MissingExtra
        The head has a skull, and nilearn or SimpleITK is not installed.

    Examples
    --------
    >>> from ngbrain.image import mni152
    >>> scan = mni152()
    >>> f"{find_brain(scan).sum() * scan.volume.voxel_volume * 1e3:.2f} litres"
    '1.89 litres'
    """
    return find_brain_and_alignment(scan, strip)[0]


def find_brain_and_alignment(
    scan: Scan, strip: Callable[[Scan], np.ndarray] | None = None
) -> tuple[np.ndarray, Alignment]:
    """Brain mask of `find_brain`, and the alignment of the MNI152 template with the scan.

    Parameters
    ----------
    scan, strip
        As for `find_brain`.

    Returns
    -------
    mask : numpy.ndarray
        (nx, ny, nz).
    place : Alignment
        The template in the scan.

    Raises
    ------
    InputError
        As `find_brain`.
    """
    mask, more = foreground_mask(scan)
    place = align_template(scan) if more and strip is None else None
    if more:
        mask = strip(scan) if strip else skull_strip(scan, place)
    check_whole(scan, mask)
    return mask, place or align_template(replace(scan, volume=_on_dark(scan.volume, mask)))


def _on_dark(volume: Volume, mask: np.ndarray) -> Volume:
    """The image with a background as dark as the darkest values of the mask, as backgrounds may be bright."""
    dark = np.quantile(volume.data[mask], 0.001)
    return Volume(np.where(mask, volume.data.clip(dark), dark).astype(np.float32), volume.affine)
