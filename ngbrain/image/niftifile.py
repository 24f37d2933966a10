"""Pictures to NIfTI files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError, require
from ngbrain.image.volume import Volume
from ngbrain.io.whole import whole

NIFTI = (".nii", ".nii.gz")


def write_nifti(path: str | os.PathLike[str], volume: Volume) -> None:
    """Write a picture as NIfTI-1, in mm, its place as a sform with code 1 (scanner); the file is whole or not there.

    Further axes of the values (time, components) may follow the three of the picture.

    Raises:
        InputError: the name does not end in .nii or .nii.gz.
        MissingExtra: nibabel is not installed.
    """
    path = Path(path)
    suffix_of(path)
    nibabel = require("nibabel", "mri")
    affine = np.diag([1e3, 1e3, 1e3, 1]) @ volume.affine
    image = nibabel.Nifti1Image(volume.data, affine)
    image.header.set_xyzt_units("mm")
    image.set_sform(affine, 1)
    image.set_qform(None, 0)
    whole(path, lambda part: nibabel.save(image, part))


def suffix_of(path: Path) -> str:
    """.nii or .nii.gz; raises `InputError` for another name."""
    for suffix in reversed(NIFTI):
        if path.name.endswith(suffix):
            return suffix
    raise InputError("image file", repr(path.name), " or ".join(NIFTI))


def on_grid(volume: Volume, affine: np.ndarray, shape: tuple[int, int, int]) -> Volume:
    """A map of labels on another grid, such as that of the file it was made from: the nearest voxel, 0 outside.

    >>> box = Volume(np.arange(1, 9, dtype=np.uint8).reshape(2, 2, 2), np.diag([1e-3, 1e-3, 1e-3, 1]))
    >>> flipped = np.diag([-1e-3, 1e-3, 1e-3, 1])
    >>> flipped[0, 3] = 1e-3
    >>> on_grid(box, flipped, (2, 2, 2)).data[:, 0, 0].tolist()
    [5, 1]
    """
    to = np.linalg.solve(volume.affine, affine)
    found = ndimage.affine_transform(volume.data, to[:3, :3], to[:3, 3], shape, order=0, mode="grid-constant")
    return Volume(found, affine)
