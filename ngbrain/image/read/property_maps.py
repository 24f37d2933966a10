"""Maps of a measured quantity of a head, such as shear stiffness: from files, and at points."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.read.image_file import open_image
from ngbrain.image.read.volume import Volume

SIDES = (0.1e-3, 20e-3)
"""Smallest and largest accepted voxel size (m)."""
COVERED = 0.5
"""Minimum share of the points of a body that its map must cover."""


def read_map(path: str | os.PathLike[str], what: str) -> Volume:
    """Read a map of positive numbers.

    Parameters
    ----------
    path : str or Path
        NIfTI or MGH, optionally in a ZIP archive; 0 and NaN mark missing values.
    what : str
        Quantity and unit, for messages.

    Returns
    -------
    Volume
        In the unit of the file, NaN where values are missing.

    Raises
    ------
    InputError
        The file is unreadable, has other than three axes, no value above 0, or a negative value.
    MissingExtra
        nibabel is not installed.
    """
    path = Path(path)
    image, affine = open_image(path, SIDES)
    try:
        values = np.asarray(image.get_fdata(dtype=np.float64))
    except (OSError, EOFError, ValueError) as error:
        raise InputError("map", f"cut short ({error})", "a whole file", path) from error
    if values.ndim != 3:
        raise InputError("map", f"of {values.ndim} axes", f"a volume of {what}, three axes", path)
    values = np.where(np.isfinite(values) & (values != 0), values, np.nan)
    if np.isnan(values).all():
        raise InputError("map", "without a value above 0", what, path)
    if np.nanmin(values) < 0:
        raise InputError("map", f"as low as {np.nanmin(values):.3g}", f"{what}, 0 where nothing was measured", path)
    return Volume(values, affine)


def fill_missing(volume: Volume) -> Volume:
    """Fill missing values with the value of the nearest measured voxel.

    >>> fill_missing(Volume(np.array([[[1.0, np.nan, np.nan, 4.0, np.nan]]]), np.eye(4))).data.ravel().tolist()
    [1.0, 1.0, 4.0, 4.0, 4.0]
    """
    unknown = np.isnan(volume.data)
    nearest = ndimage.distance_transform_edt(
        unknown, return_distances=False, return_indices=True, sampling=volume.spacing
    )
    return Volume(volume.data[tuple(nearest)], volume.affine)


def measured_mask(volume: Volume, points: np.ndarray) -> np.ndarray:
    """Points that lie in a measured voxel.

    Parameters
    ----------
    volume : Volume
        The map, NaN where values are missing.
    points : numpy.ndarray
        (n, 3) m.

    Returns
    -------
    numpy.ndarray
        (n,) bool.

    Raises
    ------
    InputError
        They are fewer than the share `COVERED` of the points.

    Examples
    --------
    >>> line = Volume(np.array([[[1.0, 2.0, np.nan]]]), np.diag([1e-3, 1e-3, 1e-3, 1]))
    >>> measured_mask(line, np.array([[0, 0, 0], [0, 0, 1.4e-3], [0, 0, 2e-3]])).tolist()
    [True, True, False]
    """
    known = Volume((~np.isnan(volume.data)).astype(np.float32), volume.affine).interpolate(points, order=0) > 0
    if known.mean() < COVERED:
        found = f"without a value at {1 - known.mean():.0%} of the body"
        raise InputError("map", found, "one in the space of the body, measured over most of it")
    return np.asarray(known)


def interpolate_map(volume: Volume, points: np.ndarray) -> np.ndarray:
    """Values at points by linear interpolation; missing voxels take the value of the nearest measured one.

    Parameters
    ----------
    volume : Volume
        The map, NaN where values are missing.
    points : numpy.ndarray
        (n, 3) m.

    Returns
    -------
    numpy.ndarray
        (n,) in the unit of the map.

    Examples
    --------
    >>> line = Volume(np.array([[[1.0, 2.0, np.nan]]]), np.diag([1e-3, 1e-3, 1e-3, 1]))
    >>> interpolate_map(line, np.array([[0, 0, 0.5e-3], [0, 0, 9e-3]])).tolist()
    [1.5, 2.0]
    """
    last = np.array(volume.data.shape) - 1
    return fill_missing(volume).interpolate(volume.to_world(np.clip(volume.to_voxels(points), 0, last)))
