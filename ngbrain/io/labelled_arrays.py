"""Arrays with named axes, coordinates and units: what `to_xarray` of images, waves, maps and series returns.

Numbers are in SI units unless `units` says otherwise; the attributes `units` and `long_name` describe every variable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ngbrain.errors import require

ALIGNED = 1e-6
"""Largest part of a voxel's side across the other axes with which an image counts as aligned."""
AXES = ("x", "y", "z")

Variable = tuple[tuple[str, ...], np.ndarray, str, str]
"""Names of the axes, values, unit, and what it is in words."""


def image_array(data: np.ndarray, affine: np.ndarray, name: str, units: str, long_name: str, **attributes: Any) -> Any:
    """An image with the positions of its voxels.

    Parameters
    ----------
    data : numpy.ndarray
        (nx, ny, nz) values.
    affine : numpy.ndarray
        (4, 4), from voxel indices to m.
    name : str
        Name of the array.
    units : str
        Unit of the values.
    long_name : str
        What it is.
    **attributes
        Further attributes.

    Returns
    -------
    xarray.DataArray
        Along x, y, z (m) in the order of the voxels' axes; along i, j, k where voxels are oblique. The attribute `affine` has the
        numbers of the affine, row by row.

    Raises
    ------
    MissingExtra
        xarray is not installed.
    """
    steps = affine[:3, :3]
    along = np.abs(steps).argmax(axis=0).tolist()
    rest = np.abs(steps)
    rest[along, range(3)] = 0.0
    known = {"units": units, "long_name": long_name, **attributes, "affine": affine.ravel().tolist()}
    if len(set(along)) < 3 or rest.max() > ALIGNED * np.abs(steps).max():
        dims = ("i", "j", "k")
        places = {dim: (dim, np.arange(n), _said("1", "voxel index")) for dim, n in zip(dims, data.shape, strict=True)}
    else:
        dims = (AXES[along[0]], AXES[along[1]], AXES[along[2]])
        places = {
            dim: (dim, affine[axis, 3] + steps[axis, i] * np.arange(n), _said("m", f"{dim} of the voxel centre"))
            for i, (dim, axis, n) in enumerate(zip(dims, along, data.shape, strict=True))
        }
    return require("xarray", "xarray").DataArray(data, places, dims, name, known)


def dataset(
    variables: Mapping[str, Variable], coordinates: Mapping[str, Variable], attributes: Mapping[str, Any]
) -> Any:
    """A data set of variables along named axes.

    Parameters
    ----------
    variables, coordinates : mapping
        Name → axes, values, unit and words.
    attributes : mapping
        Attributes of the whole.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    MissingExtra
        xarray is not installed.
    """
    made = [
        {name: (dims, values, _said(units, said)) for name, (dims, values, units, said) in each.items()}
        for each in (variables, coordinates)
    ]
    return require("xarray", "xarray").Dataset(*made, dict(attributes))


def series(columns: Mapping[str, tuple[Sequence[float] | np.ndarray, str, str]], attributes: Mapping[str, Any]) -> Any:
    """Quantities over time.

    Parameters
    ----------
    columns : mapping
        Name → values, unit and words; one of them is `time`.
    attributes : mapping
        Attributes of the whole.

    Returns
    -------
    xarray.Dataset
        Along `time`.

    Raises
    ------
    MissingExtra
        xarray is not installed.
    """
    found = {name: (("time",), np.asarray(values), units, said) for name, (values, units, said) in columns.items()}
    return dataset({name: each for name, each in found.items() if name != "time"}, {"time": found["time"]}, attributes)


def _said(units: str, long_name: str) -> dict[str, str]:
    return {"units": units, "long_name": long_name}
