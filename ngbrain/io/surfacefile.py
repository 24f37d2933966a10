"""Surfaces of triangles in files: STL, PLY, OBJ, OFF, GIfTI and FreeSurfer's."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, require
from ngbrain.io.foreign import check_width, unit_scale
from ngbrain.mesh.surface.triangle_mesh import SurfaceMesh

_MESHIO: Mapping[str, Callable[[Path], meshio.Mesh]] = {
    ".stl": meshio.stl.read,
    ".ply": meshio.ply.read,
    ".obj": meshio.obj.read,
    ".off": meshio.off.read,
}
_GIFTI = ".gii"
_FREESURFER = b"\xff\xff\xfe"
_SHIFT = ("VolGeomC_R", "VolGeomC_A", "VolGeomC_S")
"""Where FreeSurfer's coordinates have their origin, as its own GIfTI files say it."""


def is_surface(path: str | os.PathLike[str]) -> bool:
    """Whether a file is a surface: by its name, or by its first bytes for FreeSurfer's, whose names have no suffix."""
    path = Path(path)
    if path.name.lower().endswith((*_MESHIO, _GIFTI)):
        return True
    if not path.is_file():  # a pipe may never begin
        return False
    try:
        with path.open("rb") as file:
            return file.read(3) == _FREESURFER
    except OSError:
        return False


def read_surface(path: str | os.PathLike[str], unit: str = "mm") -> SurfaceMesh:
    """A closed surface, in m and where the scan that it was made from has it.

    Parameters
    ----------
    path
        STL, PLY, OBJ, OFF; GIfTI; `lh.pial` and the like of FreeSurfer.
    unit
        Of the file's lengths: m, cm, mm or um. GIfTI and FreeSurfer's are always in mm.

    Raises
    ------
    InputError
        For a file that cannot be read, holds no triangles, or is open; for a unit in which no body is so large or small.
    MissingExtra
        For GIfTI and FreeSurfer's where nibabel is not installed.

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
        if suffix in _MESHIO:
            with np.errstate(over="ignore"):  # it tries whether an STL file's text is a number of triangles
                mesh = _MESHIO[suffix](path)
            points = mesh.points
            triangles = np.concatenate([np.zeros((0, 3), int), *(c.data for c in mesh.cells if c.type == "triangle")])
        elif suffix == _GIFTI:
            unit, scale = "mm", 1e-3
            points, triangles = _gifti(path)
        else:
            unit, scale = "mm", 1e-3
            points, triangles, found = require("nibabel.freesurfer", "mri").read_geometry(str(path), read_metadata=True)
            points = points + np.asarray(found.get("cras", np.zeros(3)), float)
    except (OSError, ValueError, KeyError, IndexError, meshio.ReadError) as error:
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
    triangles = triangles[(triangles != triangles[:, [1, 2, 0]]).all(axis=1)]  # of two corners that were one point
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
    """Write a surface as GIfTI, in mm where its scan is; the file is whole or not there."""
    gifti = require("nibabel.gifti", "mri")
    place = gifti.GiftiCoordSystem("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_SCANNER_ANAT", np.eye(4))
    meta = gifti.GiftiMetaData({"AnatomicalStructurePrimary": structure})
    points = gifti.GiftiDataArray(
        (1e3 * surface.points).astype(np.float32), "NIFTI_INTENT_POINTSET", coordsys=place, meta=meta
    )
    triangles = gifti.GiftiDataArray(surface.triangles.astype(np.int32), "NIFTI_INTENT_TRIANGLE")
    _save(Path(path), gifti.GiftiImage(darrays=[points, triangles]))


def write_values(path: str | os.PathLike[str], values: np.ndarray, name: str) -> None:
    """Write values (n,) at the vertices of a surface as GIfTI; the file is whole or not there."""
    gifti = require("nibabel.gifti", "mri")
    array = gifti.GiftiDataArray(
        values.astype(np.float32), "NIFTI_INTENT_SHAPE", meta=gifti.GiftiMetaData({"Name": name})
    )
    _save(Path(path), gifti.GiftiImage(darrays=[array]))


def _save(path: Path, image: Any) -> None:
    atomic_write(path, lambda part: require("nibabel", "mri").save(image, part))
