"""Triangle surfaces in files: STL, PLY, OBJ, OFF, GIfTI and FreeSurfer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, require
from ngbrain.io.foreign import check_width, read_format, unit_scale
from ngbrain.mesh.surface.triangle_mesh import SurfaceMesh

_MESHIO = ("stl", "ply", "obj", "off")
"""Modules of meshio, by suffix without its dot."""
_GIFTI = ".gii"
_FREESURFER = b"\xff\xff\xfe"
_SHIFT = ("VolGeomC_R", "VolGeomC_A", "VolGeomC_S")
"""Keys of the origin of FreeSurfer's coordinates in its GIfTI files."""


def is_surface(path: str | os.PathLike[str]) -> bool:
    """Whether a file is a surface: by its suffix, or by its first bytes for FreeSurfer, whose file names have no suffix."""
    path = Path(path)
    if path.name.lower().endswith((*(f".{kind}" for kind in _MESHIO), _GIFTI)):
        return True
    if not path.is_file():  # reading a pipe may never return
        return False
    try:
        with path.open("rb") as file:
            return file.read(3) == _FREESURFER
    except OSError:
        return False


def read_surface(path: str | os.PathLike[str], unit: str = "mm") -> SurfaceMesh:
    """Read a closed surface, in m, in the coordinates of its scan.

    Parameters
    ----------
    path : str or Path
        STL, PLY, OBJ, OFF, GIfTI, or a FreeSurfer surface such as `lh.pial`.
    unit : str, optional
        Unit of length of the file: m, cm, mm or um. GIfTI and FreeSurfer are always in mm.

    Returns
    -------
    SurfaceMesh

    Raises
    ------
    InputError
        The file cannot be read, holds no triangles, or the surface is open; the body has an implausible size in this unit.
    MissingExtra
        nibabel, needed for GIfTI and FreeSurfer, is not installed.

    Examples
    --------
    >>> read_surface("head.stl")
    Traceback (most recent call last):
    ngbrain.errors.InputError: head.stl: surface file is missing; wanted: a file
    """
    path = Path(path)
    if not path.is_file():
        raise InputError("surface file", "missing", "a file", path)
    scale = unit_scale(unit, path)
    suffix = path.suffix.lower()
    try:
        if suffix[1:] in _MESHIO:
            with np.errstate(over="ignore"):  # meshio interprets the text of an STL file as a number of triangles
                mesh = read_format(suffix[1:], path)
            points = mesh.points
            triangles = np.concatenate([np.zeros((0, 3), int), *(c.data for c in mesh.cells if c.type == "triangle")])
        elif suffix == _GIFTI:
            unit, scale = "mm", 1e-3
            points, triangles = _gifti(path)
        else:
            unit, scale = "mm", 1e-3
            points, triangles, found = require("nibabel.freesurfer", "mri").read_geometry(str(path), read_metadata=True)
            points = points + np.asarray(found.get("cras", np.zeros(3)), float)
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise InputError(
            "surface file", f"unreadable ({type(error).__name__} {error})", "a whole file", path
        ) from error
    if not len(triangles):
        raise InputError("surface file", "without triangles", "a surface of triangles", path)
    used, corners = np.unique(scale * np.asarray(points, float)[triangles].reshape(-1, 3), axis=0, return_inverse=True)
    if not np.isfinite(used).all():
        raise InputError("surface file", "with points that are not finite", "numbers", path)
    check_width(used, unit, path)
    triangles = corners.reshape(-1, 3)
    triangles = triangles[
        (triangles != triangles[:, [1, 2, 0]]).all(axis=1)
    ]  # not degenerate after merging equal points
    _check_closed(used, triangles, path)
    return SurfaceMesh(used, triangles)


def _gifti(path: Path) -> tuple[np.ndarray, np.ndarray]:
    image = require("nibabel", "mri").load(path)
    points, triangles = (image.agg_data(name) for name in ("pointset", "triangle"))
    if not len(points) or not len(triangles):
        raise ValueError("neither points nor triangles in it")
    array = image.get_arrays_from_intent("pointset")[0]
    moved = array.coordsys.xform if array.coordsys is not None else np.eye(4)
    shift = [float(array.meta.get(key, 0.0)) for key in _SHIFT]
    return np.asarray(points, float) @ moved[:3, :3].T + moved[:3, 3] + shift, np.asarray(triangles)


def _check_closed(points: np.ndarray, triangles: np.ndarray, path: Path) -> None:
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    odd = unique[count % 2 == 1]
    if len(odd):
        at = ", ".join(f"{1e3 * x:.1f}" for x in points[odd[0]].mean(axis=0))
        raise InputError("surface", f"open at {len(odd)} edges, the first at ({at}) mm", "a closed surface", path)


def write_surface(path: str | os.PathLike[str], surface: SurfaceMesh, structure: str = "Cortex") -> None:
    """Write a surface as GIfTI atomically, in mm, in the coordinates of its scan.

    Parameters
    ----------
    path : str or Path
        Output file.
    surface : SurfaceMesh
        The surface.
    structure : str, optional
        Anatomical structure (`AnatomicalStructurePrimary`).

    Raises
    ------
    MissingExtra
        nibabel is not installed.
    """
    gifti = require("nibabel.gifti", "mri")
    place = gifti.GiftiCoordSystem("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_SCANNER_ANAT", np.eye(4))
    meta = gifti.GiftiMetaData({"AnatomicalStructurePrimary": structure})
    points = gifti.GiftiDataArray(
        (1e3 * surface.points).astype(np.float32), "NIFTI_INTENT_POINTSET", coordsys=place, meta=meta
    )
    triangles = gifti.GiftiDataArray(surface.triangles.astype(np.int32), "NIFTI_INTENT_TRIANGLE")
    _save(Path(path), gifti.GiftiImage(darrays=[points, triangles]))


def write_values(path: str | os.PathLike[str], values: np.ndarray, name: str) -> None:
    """Write values at the vertices of a surface as GIfTI, atomically.

    Parameters
    ----------
    path : str or Path
        Output file.
    values : numpy.ndarray
        (n,) values.
    name : str
        Name of the quantity.

    Raises
    ------
    MissingExtra
        nibabel is not installed.
    """
    gifti = require("nibabel.gifti", "mri")
    array = gifti.GiftiDataArray(
        values.astype(np.float32), "NIFTI_INTENT_SHAPE", meta=gifti.GiftiMetaData({"Name": name})
    )
    _save(Path(path), gifti.GiftiImage(darrays=[array]))


def _save(path: Path, image: Any) -> None:
    atomic_write(path, lambda part: require("nibabel", "mri").save(image, part))
