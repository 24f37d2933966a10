"""Scans and other images from NIfTI, MGH and DICOM files, whose header and values are checked."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError, require
from ngbrain.image.read.dicom import is_dicom, read_series
from ngbrain.image.read.resampling import MOST_VOXELS, resample_to_ras
from ngbrain.image.read.volume import Scan, Volume
from ngbrain.look import BriefText
from ngbrain.reading import check_regular, gunzip, read_bytes, unzip

_SIDES = (0.2e-3, 5e-3)  # m, of a voxel
_LEAST = 0.1  # m, along each axis of a scan
_UNITS = {1: 1.0, 2: 1e-3, 3: 1e-6}  # NIfTI's code for the unit of length -> m
_NIFTI = "one NIfTI or MGH file: .nii, .nii.gz, .mgh or .mgz"
_MGH = b"\0\0\0\1\0\0"  # version 1, big-endian, and the size along the first axis below 2^16


@dataclass(frozen=True, eq=False, repr=False)
class ImageFile(BriefText):
    """An image as stored in its file.

    Parameters
    ----------
    image : nibabel image
        The image.
    affine : numpy.ndarray
        (4, 4), from indices of the array to m.
    shape : tuple of int
        Shape of the array.
    """

    image: Any
    affine: np.ndarray
    shape: tuple[int, int, int]


def open_volume(path: str | os.PathLike[str]) -> ImageFile:
    """Open a 3-D NIfTI or MGH file and check its affine and shape, not its values; raises what `read_scan` raises of these."""
    path = Path(path)
    image, affine = open_image(path)
    return ImageFile(image, affine, _file_shape(image, path))


def open_image(path: Path, sides: tuple[float, float] = _SIDES) -> tuple[Any, np.ndarray]:
    """Open an image file with any number of axes and check its affine.

    Parameters
    ----------
    path : Path
        NIfTI or MGH file, or DICOM.
    sides : tuple of float, optional
        Smallest and largest accepted voxel size (m).

    Returns
    -------
    image : nibabel image
        The image; its values are not read yet.
    affine : numpy.ndarray
        (4, 4), from indices to m.

    Raises
    ------
    InputError
        The file cannot be read, or has no usable affine.
    MissingExtra
        nibabel is not installed.
    """
    image = _load_header(path)
    return image, _file_affine(image, path, sides)


def read_scan(path: str | os.PathLike[str]) -> Scan:
    """Read a T1 scan of a head, with or without skull, from a NIfTI-1, NIfTI-2, MGH (FreeSurfer) or DICOM file.

    The affine is the sform, or the qform if there is no sform. After an affine registration, lengths are those of the template.
    The default unit of length is mm. Copies of a scan that differ only by flipped or permuted axes give the same bits.

    Raises
    ------
    InputError
        The file does not exist, is of another format, truncated or damaged; it is not one 3-D image of finite real numbers with
        at least 16 different values; it has no usable affine; voxels are not of 0.2 to 5 mm; an axis is shorter than 100 mm, so
        that it is not a whole head.
    MissingExtra
        nibabel is not installed.

    Examples
    --------
    >>> read_scan("case.toml")
    Traceback (most recent call last):
    ngbrain.errors.InputError: case.toml: image is missing; wanted: one NIfTI or MGH file: .nii, .nii.gz, .mgh or .mgz
    """
    path, file = Path(path), open_volume(path)
    extent = np.linalg.norm(file.affine[:3, :3], axis=0) * file.shape
    if extent.min() < _LEAST:
        text = " x ".join(f"{1e3 * side:.0f}" for side in extent)
        raise InputError("image", f"{text} mm", "a whole head, at least 100 mm along each axis", path)
    data = _values(file.image, path).reshape(file.shape)
    try:
        volume = resample_to_ras(Volume(data, file.affine))
    except InputError as error:
        raise InputError(error.field, error.value, error.wanted, path) from None
    return Scan(volume, file.affine, file.shape, str(path))


def _load_header(path: Path) -> Any:
    """The nibabel image of a file; its values are not read yet."""
    if not path.exists():
        raise InputError("image", "missing", _NIFTI, path)
    if path.is_dir():
        return read_series(path)
    try:
        check_regular(path, "image")
    except InputError as error:
        raise InputError("image", error.value, _NIFTI, path) from None
    if is_dicom(path):
        return read_series(path)
    nibabel = require("nibabel", "mri")
    raw = read_bytes(path, "image")
    if raw[:4] == b"PK\3\4":
        raw = unzip(raw, "image", path)
    if raw[:2] == b"\x1f\x8b":
        raw = bytes(gunzip(raw, "image", path))
    if raw[344:348] == b"n+1\0":
        kind = nibabel.Nifti1Image
    elif raw[4:8] == b"n+2\0":
        kind = nibabel.Nifti2Image
    elif raw[:6] == _MGH:
        kind = nibabel.MGHImage
    else:
        raise InputError("image", "neither a NIfTI nor an MGH file" if raw else "an empty file", _NIFTI, path)
    try:
        with nibabel.imageglobals.LoggingOutputSuppressor():  # nibabel prints its corrections to stderr
            return kind.from_bytes(raw)
    except Exception as error:  # damaged headers make nibabel raise many kinds of exception
        raise InputError("image", f"a file with a damaged header ({error})", "an undamaged one", path) from error


def _file_affine(image: Any, path: Path, sides: tuple[float, float]) -> np.ndarray:
    """Affine (4, 4) from indices of the stored array to m."""
    header = image.header
    if "sform_code" not in header:  # MGH, in mm
        given, unit = header["goodRASFlag"] == 1, 1e-3
    else:
        given = bool(header["sform_code"] or header["qform_code"])
        unit = _UNITS.get(int(header["xyzt_units"]) & 7, 1e-3)
    if not given:  # nibabel would invent one
        raise InputError("image affine", "not given", "a sform or qform with a code above 0, or MGH's good RAS", path)
    _check_sides(header, path)
    affine = np.diag([unit, unit, unit, 1.0]) @ image.affine
    sizes = np.linalg.norm(affine[:3, :3], axis=0)
    # The determinant relative to the product of the sizes is 1 for right angles.
    if not np.isfinite(affine).all() or abs(np.linalg.det(affine[:3, :3])) <= 0.1 * sizes.prod():
        raise InputError("image affine", image.affine[:3].tolist(), "three independent axes, finite", path)
    if sizes.min() < sides[0] or sizes.max() > sides[1]:
        text = " x ".join(f"{1e3 * size:.4g}" for size in sizes)
        wanted = f"{1e3 * sides[0]:g} to {1e3 * sides[1]:g} mm along each side"
        raise InputError("image voxel", f"{text} mm", wanted, path)
    return affine


def _check_sides(header: Any, path: Path) -> None:
    """Refuse a file whose sform and qform are mirror images: one of them swaps left and right."""
    if "sform_code" not in header or not (header["sform_code"] and header["qform_code"]):
        return
    sform, qform = (np.linalg.det(form[:3, :3]) for form in (header.get_sform(), header.get_qform()))
    if sform * qform < 0:
        found = "a sform and a qform that disagree about left and right"
        raise InputError("image affine", found, "two that agree, or one with code 0", path)


def _file_shape(image: Any, path: Path) -> tuple[int, int, int]:
    shape = tuple(int(n) for n in image.shape)
    if 0 in shape or len(shape) < 3 or any(n > 1 for n in shape[3:]):
        raise InputError("image shape", shape, "three axes: one image of one head", path)
    if np.prod(shape) > 4 * MOST_VOXELS:
        raise InputError("image shape", shape, "at most 2^29 voxels", path)
    return shape[0], shape[1], shape[2]


def fill_nan_background(data: np.ndarray, value: float) -> np.ndarray:
    """Replace NaN in the background, as written by software that leaves out the outside, by another value.

    NaN that is not connected to the border of the volume is kept.

    Parameters
    ----------
    data : numpy.ndarray
        The values.
    value : float
        Value of the background.

    Returns
    -------
    numpy.ndarray

    Examples
    --------
    >>> fill_nan_background(np.array([[np.nan, 1.0, np.nan, 2.0, np.nan]] * 3).T, 0.0)[:, 0].tolist()
    [0.0, 1.0, 0.0, 2.0, 0.0]
    >>> inner = np.ones((3, 3)); inner[1, 1] = np.nan
    >>> int(np.isnan(fill_nan_background(inner, 0.0)).sum())
    1
    """
    unknown = np.isnan(data)
    if not unknown.any() or unknown.all():
        return data
    enclosed = ndimage.binary_fill_holes(~unknown)
    return np.where(unknown & ~enclosed, data.dtype.type(value), data)


def _values(image: Any, path: Path) -> np.ndarray:
    """Values of the image, scaled as in the header, float32."""
    dtype = image.get_data_dtype()
    if dtype.fields or dtype.kind not in "iuf":
        kind = "colours" if dtype.fields else f"{dtype} numbers"
        raise InputError("image", f"made of {kind}", "grey values", path)
    try:
        with np.errstate(all="ignore"):  # overflow of float32 is detected below
            data = image.get_fdata(dtype=np.float32, caching="unchanged")
    except (OSError, EOFError, ValueError, MemoryError) as error:
        raise InputError("image", f"cut short ({error})", "a whole NIfTI file", path) from error
    data = fill_nan_background(data, float(np.nanmin(data, initial=np.inf)))
    bad = data.size - int(np.isfinite(data).sum())
    if bad:
        raise InputError("image", f"not a finite number in {bad} voxels", "finite values", path)
    few = np.unique(data.ravel()[::97])  # fast, and enough for a scan
    if len(few) < 16:
        few = np.unique(data)
    if len(few) == 1:
        raise InputError("image", f"{few[0]:g} everywhere", "a T1 scan", path)
    is_labels = "intent_code" in image.header and int(image.header["intent_code"]) == 1002
    if len(few) < 16 or is_labels:
        wanted = "a T1 scan, its grey values; labels go with --labels"
        raise InputError("image", f"a map of labels ({len(few)} values or more)", wanted, path)
    return data
