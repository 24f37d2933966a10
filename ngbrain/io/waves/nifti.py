"""Wave data as NIfTI images, and maps on the grid of the image that the data came from.

    NAME.nii[.gz]           displacement (x, y, z, loads, components), complex, m; NaN where not measured
    NAME.json               the sidecar: frequency, density, symmetry, rheology, …, a complex number as [re, im]
    NAME_mask.nii[.gz], …   one image (x, y, z[, components]) for each field with a value at every point

The sidecar's `files` names those images, by field. Two components are plane data with one slice; one component is motion normal
to that slice (`motion` is anti_plane in the sidecar); three components are 3-D data. The points are the centres of all voxels,
numbered along x first. In 3-D, points and components are in the world coordinates of the image's affine (right, front, up). The
same holds for a horizontal slice; any other slice has the coordinates of its own two axes, with the first voxel at the origin. A
real image with one more axis, of times, holds samples over a period (m), or their phases (rad) if the sidecar has `encoding`
(`ngbrain.io.waves.samples`). Two real images, whose names differ by `part-real` and `part-imag`, may replace a complex one; a
single real image is a real displacement. Fields that are not in the sidecar have their defaults. In 3-D, `fibre_map` in the
sidecar names an image of fibre directions or diffusion tensors in the same folder, on any grid of the same world coordinates, and
`fibre_map_convention` its components (`ngbrain.image.read.fibre_directions`); they replace `fibre`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.fibre_directions import CONVENTIONS, read_fibre_directions
from ngbrain.image.read.image_file import open_image
from ngbrain.image.read.nifti import NIFTI, nifti_suffix, write_nifti
from ngbrain.image.read.volume import Volume
from ngbrain.io.json_file import write_json
from ngbrain.io.waves.data import WaveData
from ngbrain.io.waves.volumes import add_load_axis, is_plane, missing_keys
from ngbrain.reading import read_json

TEMPLATE = """\
{
 "frequency": [50.0],
 "density": 1000.0,
 "symmetry": "isotropic",
 "rheology": "viscoelastic",
 "bulk": 2.2e9,
 "motion": null,
 "displacement_unit": "m",
 "noise": null,
 "conjugate": false,
 "files": {"mask": "NAME_mask.nii.gz"}
}
"""
"""Template of a sidecar. frequency: Hz, per load; density: kg/m³; bulk: Pa, or poisson instead; motion: anti_plane if normal to
one slice; displacement_unit: m, mm or um; noise: relative to the rms; conjugate: whether the time convention is e^{-iωt}; files:
images in the same folder."""
_SIDES = (1e-5, 0.1)  # m, of a voxel: ultrasound to whole-body
_AT_POINTS = ("fibre", "dirichlet", "mask", "labels")
_MOST = 2**28  # numbers in an image
_REAL, _IMAGINARY = "part-real", "part-imag"


def read_nifti(path: Path) -> dict[str, Any]:
    """Fields of wave data in a NIfTI image and its sidecar, as the keys that `files.from_keys` takes."""
    u, affine = _image(path)
    if _REAL in path.name:
        other = path.with_name(path.name.replace(_REAL, _IMAGINARY))
        imaginary, _ = _image(other)
        if imaginary.shape != u.shape or np.iscomplexobj(u) or np.iscomplexobj(imaginary):
            raise InputError("displacement", f"{u.shape} and {imaginary.shape}", "two real images of one shape")
        u = u + 1j * imaginary
    u = add_load_axis(u)
    timed, plane = u.ndim == 6, is_plane(u.shape)
    keys = _sidecar(path)
    d, shape = 2 if plane else 3, u.shape[:3]
    n = int(np.prod(shape))
    name = "displacement" if not timed else "phase" if "encoding" in keys else "samples"
    keys[name] = np.moveaxis(u.reshape(n, *u.shape[3:], order="F"), 1, 0)
    keys["points"] = _voxel_centres(affine, shape, d)
    keys["affine"] = affine
    files = keys.pop("files", {})
    if not isinstance(files, Mapping) or not all(_is_file_name(name) for name in files.values()):
        raise InputError("files", repr(files), "field → name of an image in the same folder", path)
    for name, file in files.items():
        values, _ = _image(path.with_name(file))
        if values.shape[:3] != shape:
            raise InputError(name, f"of shape {values.shape}", f"the grid of the displacement, {shape}", path)
        keys[name] = values.reshape(n, *values.shape[3:], order="F")
    if "fibre_map" in keys or "fibre_map_convention" in keys:
        keys["fibre"] = _fibres(path, keys, np.isfinite(u).reshape(n, -1, order="F").any(axis=1))
    return keys


def _fibres(path: Path, keys: dict[str, Any], measured: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3) at the points, of the image that the sidecar names; takes its two keys away."""
    name, convention = keys.pop("fibre_map", None), keys.pop("fibre_map_convention", None)
    if not _is_file_name(name):
        raise InputError("fibre_map", repr(name), "the name of an image in the same folder", path)
    if convention not in CONVENTIONS:
        raise InputError("fibre_map_convention", repr(convention), f"one of {', '.join(CONVENTIONS)}", path)
    if both := {"fibre", "fibre_angle_deg"} & keys.keys():
        raise InputError("fibre_map", f"given beside {min(both)}", "one of them", path)
    points = keys["points"]
    if points.shape[1] == 2:
        raise InputError("fibre_map", "given for one slice", "displacement in space, or fibre_angle_deg", path)
    directions = read_fibre_directions(path.with_name(name), convention)
    if "mask" in keys:
        measured = measured & (np.asarray(keys["mask"]).ravel() != 0)
    directions.check_covers(points[measured], "measured points")
    return directions.interpolate(points)


def _is_file_name(name: Any) -> bool:
    return isinstance(name, str) and bool(name) and Path(name).name == name


def write_nifti_waves(path: Path, data: WaveData, keys: Mapping[str, Any]) -> None:
    """Write the displacement, its sidecar, and an image for each field with values at the points; the displacement is written
    last.

    Parameters
    ----------
    path : Path
        Image of the displacement, .nii or .nii.gz.
    data : WaveData
        The data.
    keys : mapping
        Their fields by key, from `files.to_keys`.

    Raises
    ------
    InputError
        The points are not a grid.
    MissingExtra
        nibabel is not installed.
    """
    suffix, affine, shape = nifti_suffix(path), *_grid_of(data)
    stem = path.name[: -len(suffix)]
    fields = {name: keys[name] for name in keys if name in _AT_POINTS or name.startswith("truth_")}
    fields |= {"noise": keys["noise"]} if isinstance(keys.get("noise"), np.ndarray) else {}
    files = {name: f"{stem}_{name}{suffix}" for name in fields}
    rest = {name: _json(keys[name]) for name in keys if name not in (*fields, "points", "displacement", "affine")}
    for name, values in fields.items():
        _save(path.with_name(files[name]), values, affine, shape)
    write_json(path.with_name(f"{stem}.json"), {**rest, "files": files})
    _save(path, np.moveaxis(data.displacement, 0, 1), affine, shape)


def write_map(
    path: str | os.PathLike[str], data: WaveData, values: np.ndarray, about: str = "", unit: str = ""
) -> None:
    """Write values at the points of wave data as a NIfTI image on their grid.

    The affine is that of the input image; data from other files get the affine of their points.

    Parameters
    ----------
    path : str or Path
        Output file, .nii or .nii.gz.
    data : WaveData
        The data.
    values : numpy.ndarray
        (n,) or (n, k).
    about, unit : str
        What the values are and their unit, for the header.

    Raises
    ------
    InputError
        The points are not a grid; the number of values differs; the suffix is another one.
    MissingExtra
        nibabel is not installed.
    """
    path, values = Path(path), np.asarray(values)
    affine, shape = _grid_of(data)
    if values.ndim not in (1, 2) or len(values) != len(data.points):
        raise InputError("values", f"of shape {values.shape}", f"({len(data.points)},) or ({len(data.points)}, k)")
    _save(path, values, affine, shape, about, unit)


def _image(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Values of an image, real or complex, and its affine (m)."""
    if not path.name.endswith(NIFTI):
        raise InputError("image", repr(path.name), " or ".join(NIFTI), path)
    image, affine = open_image(path, _SIDES)
    if not image.shape or np.prod(image.shape, dtype=float) > _MOST:
        raise InputError("image", f"of shape {image.shape}", f"at most {_MOST} numbers", path)
    values = np.asanyarray(image.dataobj)
    if values.dtype.kind not in "iufc":
        raise InputError("image", f"made of {values.dtype}", "numbers", path)
    return values, affine


def _sidecar(path: Path) -> dict[str, Any]:
    place = path.with_name(path.name[: -len(nifti_suffix(path))] + ".json")
    if not place.is_file():
        wanted = "a JSON file beside the image: `ngbrain invert --template` prints one"
        raise InputError("sidecar", "missing", wanted, place)
    keys = read_json(place, "sidecar")
    if not isinstance(keys, dict):
        raise InputError("sidecar", f"a {type(keys).__name__}", "a JSON object", place)
    for name in ("points", "displacement", "samples", "phase", "affine"):
        if name in keys:
            raise InputError(name, "given", "nothing: the image has it", place)
    files = keys.get("files", {})
    known = ("points", "displacement", *(files if isinstance(files, Mapping) else ()))
    if missing := missing_keys({name: value for name, value in keys.items() if value is not None}, known):
        wanted = "a number or text for each: `ngbrain invert --template` prints a sidecar that has all"
        raise InputError(", ".join(missing), "missing", wanted, place)
    bulk = keys.get("bulk")
    if isinstance(bulk, list) and len(bulk) == 2 and all(isinstance(part, int | float) for part in bulk):
        keys["bulk"] = complex(*bulk)
    return {name: value for name, value in keys.items() if value is not None}


def _voxel_centres(affine: np.ndarray, shape: tuple[int, ...], d: int) -> np.ndarray:
    """Voxel centres, (n, d) m."""
    index = np.indices(shape).reshape(3, -1, order="F").T
    if d == 3:
        return index @ affine[:3, :3].T + affine[:3, 3]
    if np.abs(affine[2, :2]).max() < 1e-6 * np.abs(affine[:2, :2]).max():  # level
        return index[:, :2] @ affine[:2, :2].T + affine[:2, 3]
    return index[:, :2] * np.linalg.norm(affine[:3, :2], axis=0)


def _grid_of(data: WaveData) -> tuple[np.ndarray, tuple[int, int, int]]:
    """Affine (m) and shape of the image whose voxels are the points."""
    grid = data.grid
    if grid is None:
        raise InputError("points", "no grid", "points on a grid, numbered along its first axis first, for NIfTI")
    d = data.dim
    affine = np.eye(4)
    affine[2, 2] = grid.spacing[0]  # of the one slice of plane data
    affine[:d, :d] = grid.axes.T * grid.spacing
    affine[:d, 3] = grid.origin
    shape = (*grid.shape, 1)[:3]
    return (affine if data.affine is None else data.affine), (shape[0], shape[1], shape[2])


def _json(value: Any) -> Any:
    if isinstance(value, complex):
        return [value.real, value.imag]
    return value.tolist() if isinstance(value, np.ndarray) else value


def _save(
    path: Path, values: np.ndarray, affine: np.ndarray, shape: tuple[int, int, int], about: str = "", unit: str = ""
) -> None:
    """Write values (n, …) at the points as an image; NIfTI has no booleans, and few readers support 64-bit integers."""
    values = values.astype(np.uint8) if values.dtype == bool else values
    values = values.astype(np.int32) if values.dtype.kind in "iu" and values.dtype.itemsize > 4 else values
    write_nifti(path, Volume(values.reshape(*shape, *values.shape[1:], order="F"), affine), about, unit)
