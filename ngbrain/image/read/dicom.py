"""DICOM series."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import InputError, require

_POSITION, _ROWS, _DESCRIPTION = "0020|0032", "0020|0037", "0008|103e"
_UNEVEN = 0.05
"""Relative tolerance of the distance between slices."""
_TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])
"""DICOM's axes point left and back, those of NIfTI right and front."""


def is_dicom(path: Path) -> bool:
    """Whether a file has the DICOM prefix."""
    with path.open("rb") as file:
        return file.read(132)[128:] == b"DICM"


def read_series(path: Path) -> Any:
    """Read the DICOM series in a folder, or the series of a file, as a nibabel image in mm.

    Raises
    ------
    InputError
        The folder has no series or several, slices are missing or duplicated, or a file cannot be read.
    MissingExtra
        SimpleITK or nibabel is not installed.
    """
    sitk, nibabel = require("SimpleITK", "mri"), require("nibabel", "mri")
    sitk.ProcessObject.SetGlobalWarningDisplay(False)  # it writes to stderr
    try:
        files = _files(sitk, path)
        image = sitk.ReadImage(files if len(files) > 1 else files[0])
    except RuntimeError as error:
        raise InputError("image", f"unreadable ({str(error).splitlines()[-1]})", "whole DICOM files", path) from error
    if image.GetDimension() != 3 or image.GetNumberOfComponentsPerPixel() != 1:
        raise InputError("image", "a DICOM series that is not a 3-D image with one value per voxel", "a T1 scan", path)
    affine = np.eye(4)
    affine[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) * np.array(image.GetSpacing())
    affine[:3, 3] = image.GetOrigin()
    values = sitk.GetArrayFromImage(image).transpose(2, 1, 0)
    found = nibabel.Nifti1Image(values.astype(np.float32), _TO_RAS @ affine)
    found.header.set_xyzt_units("mm")
    return found


def _files(sitk: Any, path: Path) -> list[str]:
    folder = path if path.is_dir() else path.parent
    found = {
        name: list(sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder), name)) for name in _series(sitk, folder)
    }
    if not path.is_dir():
        mine = [files for files in found.values() if path.absolute() in {Path(file).absolute() for file in files}]
        found = {"": mine[0] if mine else [str(path)]}
    if not found:
        raise InputError(
            "image", "a folder without a DICOM series", "a folder with one, not with folders of them", path
        )
    if len(found) > 1:
        some = "; ".join(
            f"{len(files)} files {_tag(sitk, files[0], _DESCRIPTION)!r}, as {Path(files[0]).name}"
            for files in found.values()
        )
        raise InputError(
            "image", f"a folder with {len(found)} DICOM series ({some})", "one of them: a file of it", path
        )
    (files,) = found.values()
    if len(files) > 1:
        _check_places(sitk, files, path)
    return files


def _series(sitk: Any, folder: Path) -> list[str]:
    return list(sitk.ImageSeriesReader.GetGDCMSeriesIDs(str(folder)))


def _check_places(sitk: Any, files: list[str], path: Path) -> None:
    """Check that the slices are equidistant."""
    try:
        places = np.array([[float(x) for x in _tag(sitk, file, _POSITION).split("\\")] for file in files])
        rows = np.array([float(x) for x in _tag(sitk, files[0], _ROWS).split("\\")]).reshape(2, 3)
    except ValueError:
        raise InputError(
            "image", "a DICOM series without the places of its slices", "Image Position (0020,0032)", path
        ) from None
    steps = np.diff(np.sort(places @ np.cross(*rows)))
    usual = float(np.median(steps))
    if (steps < 0.5 * usual).any() or usual == 0:
        raise InputError("image", "a DICOM series with several slices at one place", "one image of one head", path)
    if (np.abs(steps - usual) > _UNEVEN * usual).any():
        found = (
            f"a DICOM series with slices {steps.min():.3g} to {steps.max():.3g} mm from each other: some are missing"
        )
        raise InputError("image", found, "all slices", path)


def _tag(sitk: Any, file: str, key: str) -> str:
    reader = sitk.ImageFileReader()
    reader.SetFileName(file)
    reader.ReadImageInformation()
    return reader.GetMetaData(key).strip() if reader.HasMetaDataKey(key) else ""
