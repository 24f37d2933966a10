"""Write NIfTI files, and resample label maps."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from scipy import ndimage

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, require
from ngbrain.image.read.volume import Volume

NIFTI = (".nii", ".nii.gz")
_SAME = 0.05
"""Tolerance of coinciding voxel centres, relative to the voxel size."""
_AT_A_TIME = 100_000
"""Number of voxels per chunk, which limits the memory."""


def write_nifti(path: str | os.PathLike[str], volume: Volume, about: str = "", unit: str = "") -> None:
    """Write a volume as NIfTI-1 atomically, in mm, with an sform of code 1 (scanner).

    Further axes of the values (time, components) may follow the three of the image.

    Parameters
    ----------
    path : str or Path
        Output file, .nii or .nii.gz.
    volume : Volume
        The volume.
    about : str
        What the values are, up to 80 ASCII characters of it in the header's `descrip`, with the unit, and 16 in `intent_name`.
    unit : str
        Unit of the values.

    Raises
    ------
    InputError
        The suffix is another one.
    MissingExtra
        nibabel is not installed.
    """
    path = Path(path)
    nifti_suffix(path)
    nibabel = require("nibabel", "mri")
    affine = np.diag([1e3, 1e3, 1e3, 1]) @ volume.affine
    image = nibabel.Nifti1Image(volume.data, affine)
    image.header.set_xyzt_units("mm")
    if about:
        plain = about.encode("ascii", "ignore").decode()
        image.header["descrip"] = f"{plain} ({unit or '1'})"[:79]
        image.header.set_intent("none", name=plain[:15])
    image.set_sform(affine, 1)
    image.set_qform(None, 0)
    atomic_write(path, lambda part: nibabel.save(image, part))


def nifti_suffix(path: Path) -> str:
    """.nii or .nii.gz; raises `InputError` for other suffixes."""
    for suffix in reversed(NIFTI):
        if path.name.endswith(suffix):
            return suffix
    raise InputError("image file", repr(path.name), " or ".join(NIFTI))


def resample_labels(volume: Volume, affine: np.ndarray, shape: tuple[int, int, int]) -> Volume:
    """Resample a label map to another grid, such as that of its source file: each voxel takes the label of its largest part, 0
    outside.

    Nearest-neighbour interpolation would shift the map by up to half a voxel along each axis, as the voxel centres of the two
    grids have a constant offset.

    Parameters
    ----------
    volume : Volume
        Integer labels.
    affine : numpy.ndarray
        (4, 4), from indices of the new grid to m.
    shape : tuple of int
        Shape of the new grid.

    Returns
    -------
    Volume
        With labels of the same type. Where voxel centres coincide, labels are unchanged.

    Examples
    --------
    >>> box = Volume(np.arange(1, 9, dtype=np.uint8).reshape(2, 2, 2), np.diag([1e-3, 1e-3, 1e-3, 1]))
    >>> flipped = np.diag([-1e-3, 1e-3, 1e-3, 1])
    >>> flipped[0, 3] = 1e-3
    >>> resample_labels(box, flipped, (2, 2, 2)).data[:, 0, 0].tolist()
    [5, 1]
    """
    to = np.linalg.solve(volume.affine, affine)
    found = ndimage.affine_transform(volume.data, to[:3, :3], to[:3, 3], shape, order=0, mode="grid-constant")
    ends = np.array(list(np.ndindex(2, 2, 2))) * (np.array(shape) - 1) @ to[:3, :3].T + to[:3, 3]
    off = max(np.abs(each - np.rint(each)).max() for each in (ends, to[:3, :3]))
    size = np.linalg.norm(to[:3, :3], axis=0)
    if (off < _SAME and np.abs(size - 1).max() < _SAME) or not volume.data.any():
        return Volume(found, affine)
    parts = np.ceil(size - _SAME).astype(int)
    within = ((np.array(list(np.ndindex(*parts))) + 0.5) / parts - 0.5) @ to[:3, :3].T
    reach = int(np.ceil(np.abs(within).max() + 0.5))
    pad = 2 * reach
    box = tuple(
        slice(max(side.start - pad, 0), side.stop + pad)
        for side in ndimage.find_objects((volume.data != 0).astype(np.uint8))[0]
    )
    part = np.pad(volume.data[box], 1)  # 0 outside the image
    start = to[:3, 3] - [side.start - 1 for side in box]
    width = 2 * reach + 1
    mixed = ndimage.maximum_filter(part, width) != ndimage.minimum_filter(part, width)
    at = np.argwhere(ndimage.affine_transform(mixed, to[:3, :3], start, shape, order=0, mode="grid-constant"))
    values = np.unique(part[mixed])
    number = np.searchsorted(values, part).clip(0, len(values) - 1)
    for few in np.array_split(at, len(at) // _AT_A_TIME + 1):
        found[tuple(few.T)] = values[_largest_label(number, few @ to[:3, :3].T + start, within, len(values))]
    return Volume(found, affine)


def _largest_label(number: np.ndarray, points: np.ndarray, offsets: np.ndarray, count: int) -> np.ndarray:
    """Of `count` labels on voxels the one with the largest share (n,) at points (n, 3), each the mean over offsets (m, 3)."""
    shares = np.zeros(len(points) * count)
    rows = count * np.arange(len(points))
    for offset in offsets:
        low = np.floor(points + offset).astype(int)
        beyond = points + offset - low
        for corner in np.ndindex(2, 2, 2):
            index = (low + corner).clip(0, np.array(number.shape) - 1)
            weight = np.where(corner, beyond, 1 - beyond).prod(axis=1)
            shares += np.bincount(rows + number[tuple(index.T)], weight, len(shares))
    return np.asarray(shares.reshape(-1, count).argmax(axis=1))
