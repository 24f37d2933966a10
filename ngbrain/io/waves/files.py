"""Wave data in files: NumPy archives, HDF5, MATLAB, NIfTI."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, NgbrainError, file_context
from ngbrain.image.read.nifti import NIFTI
from ngbrain.io.hdf5 import hdf5_image
from ngbrain.io.waves.data import TRUTHS, WaveData, to_array
from ngbrain.io.waves.matlab import read_matlab, write_matlab
from ngbrain.io.waves.nifti import read_nifti, write_nifti_waves
from ngbrain.io.waves.samples import SAMPLED, samples_to_amplitudes
from ngbrain.io.waves.volumes import IN_VOLUMES, REQUIRED, convert_to_metres, missing_keys, voxels_to_points
from ngbrain.reading import check_regular, read_npz
from ngbrain.reading.hdf5 import hdf5

_OPTIONAL = (
    "poisson",
    "bulk",
    "fibre",
    "element",
    "dirichlet",
    "mask",
    "noise",
    "labels",
    "affine",
    "motion",
    "tissue",
)
_KEYS = (
    *REQUIRED,
    *_OPTIONAL,
    *SAMPLED,
    *IN_VOLUMES,
    "fibre_angle_deg",
    "conjugate",
    *(f"truth_{name}" for name in TRUTHS),
)
_WANTED = "wave data: .npz, .h5, .hdf5, .mat, .nii or .nii.gz"
_HDF5 = (".h5", ".hdf5")
_ALIKE = 0.84  # similarity (difflib) above which an unknown key is considered misspelt


def read_waves(path: str | os.PathLike[str]) -> WaveData:
    """Read wave data. The keys of the file are the fields of `WaveData`, in SI units.

    .npz, .h5, .hdf5: one array per field; `truth_youngs`, `truth_shear`, `truth_mu`, `truth_zeta`, `truth_phi` for the truth;
    `fibre_angle_deg` (from x to y, one number or one per point) may replace a plane `fibre`; `samples` over a period, or their
    `phase` and `encoding`, may replace `displacement` (`ngbrain.io.waves.samples`); `conjugate` is true for data in the time
    convention e^{-iωt}. Unknown keys are ignored, unless they look like a misspelt key. Nothing is unpickled.

    .mat: the same, of any MATLAB version. All of these may have displacements on voxels and lengths in other units, see
    `volumes`.

    .nii, .nii.gz: complex displacements (x, y, z, loads, components), m, or samples (x, y, z, loads, components, times), with
    all other fields in a sidecar file (`ngbrain.io.waves.nifti`).

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    WaveData

    Raises
    ------
    InputError
        A field is missing or invalid; the message names file, field, value and what is wanted.
    MissingExtra
        nibabel, needed for NIfTI, is not installed.

    Examples
    --------
    >>> read_waves("waves.dcm")
    Traceback (most recent call last):
    ngbrain.errors.InputError: waves.dcm: data is a .dcm file; wanted: wave data: .npz, .h5, .hdf5, .mat, .nii or .nii.gz
    """
    path = Path(path)
    with file_context(path):
        keys = _format_of(path)[0](path)
        for key in keys:
            slip = get_close_matches(key, _KEYS, n=1, cutoff=_ALIKE)
            if key not in _KEYS and slip:
                raise InputError("key", repr(key), f"did you mean {slip[0]!r}?")
        return from_keys(keys)


def write_waves(path: str | os.PathLike[str], data: WaveData) -> None:
    """Write wave data atomically; `read_waves` restores them exactly (points of NIfTI: to round-off).

    Parameters
    ----------
    path : str or Path
        Output file: .npz, .h5, .hdf5, .mat, .nii or .nii.gz.
    data : WaveData
        The data.

    Raises
    ------
    InputError
        The suffix is another one; NIfTI for points that are not a grid.
    MissingExtra
        nibabel, needed for NIfTI, is not installed.
    OSError
        The disk is full, the folder is not writable, ...

    Examples
    --------
    >>> import tempfile
    >>> grid = np.array([[x, y] for y in range(3) for x in range(3)]) * 0.01
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 9, 2)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_waves(f"{folder}/waves.npz", data)
    ...     read_waves(f"{folder}/waves.npz").frequency
    array([50.])
    """
    path = Path(path)
    with file_context(path):
        _format_of(path)[1](path, data)


def to_keys(data: WaveData) -> dict[str, Any]:
    """Fields by their key in a file, without those that are None."""
    keys = {name: getattr(data, name) for name in (*REQUIRED, *_OPTIONAL)}
    keys |= {f"truth_{name}": values for name, values in data.truth.items()}
    return {name: value for name, value in keys.items() if value is not None}


def from_keys(keys: Mapping[str, Any]) -> WaveData:
    """Wave data from the keys of a file; 0-d arrays become numbers and text."""
    for name, value in keys.items():
        to_array(name, value)
    keys = samples_to_amplitudes(voxels_to_points(convert_to_metres(keys)))
    if missing := missing_keys(keys):
        raise InputError(", ".join(missing), "missing", f"wave data with {', '.join(REQUIRED)} and poisson or bulk")
    if np.ndim(keys["frequency"]) == 0:
        keys["frequency"] = np.atleast_1d(keys["frequency"])
    fields = {name: _scalar_or_array(name, keys[name]) for name in (*REQUIRED, *_OPTIONAL) if name in keys}
    fields["element"] = fields.get("element") or None
    if "fibre_angle_deg" in keys:
        if "fibre" in keys:
            raise InputError("fibre_angle_deg", "given beside fibre", "one of them")
        fields["fibre"] = _directions(keys["fibre_angle_deg"], np.shape(keys["points"]))
    conjugate = np.asarray(keys.get("conjugate", False))
    if conjugate.shape not in ((), (1,)) or conjugate.dtype.kind not in "biu" or conjugate.item() not in (0, 1):
        raise InputError("conjugate", keys["conjugate"], "true or false")
    truth = {name: np.asarray(keys[f"truth_{name}"]) for name in TRUTHS if f"truth_{name}" in keys}
    data = WaveData(**fields, truth=truth)
    return data.conjugate() if conjugate.item() else data


def _scalar_or_array(name: str, value: Any) -> Any:
    value = np.asarray(value)
    if value.dtype.kind in "SU" and value.ndim == 0:
        return value.item().decode(errors="replace") if value.dtype.kind == "S" else value.item()
    if name in ("symmetry", "rheology", "element", "motion", "tissue"):
        raise InputError(name, f"{value.dtype} of shape {value.shape}", "text")
    return value.reshape(()) if value.shape == (1,) and name in ("density", "poisson", "bulk", "noise") else value


def _directions(angle: Any, shape: tuple[int, ...]) -> np.ndarray:
    angle = np.asarray(angle)
    if len(shape) != 2 or shape[1] != 2:
        raise InputError("fibre_angle_deg", "given in space", "plane points, or fibre")
    if angle.dtype.kind not in "fiu" or angle.shape not in ((), (1,), shape[:1]) or not np.isfinite(angle).all():
        found = f"{angle.dtype} of shape {angle.shape}"
        raise InputError("fibre_angle_deg", found, f"finite degrees, one number or {shape[0]}")
    turn = np.deg2rad(np.broadcast_to(angle, shape[:1]).astype(float))
    return np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _read_npz(path: Path) -> dict[str, Any]:
    return dict(read_npz(path, "data"))


def _read_h5(path: Path) -> dict[str, Any]:
    with hdf5(path, "data") as file:
        found = {name: item[()] for name, item in file.items() if isinstance(item, h5py.Dataset)}
    return {name: value.decode() if isinstance(value, bytes) else value for name, value in found.items()}


def _write_npz(path: Path, data: WaveData) -> None:
    atomic_write(path, lambda part: np.savez_compressed(part, **to_keys(data)))


def _write_h5(path: Path, data: WaveData) -> None:
    def fill(file: h5py.File) -> None:
        for name, value in to_keys(data).items():
            file[name] = value

    image = hdf5_image(fill)
    atomic_write(path, lambda part: part.write_bytes(image))


def _write_matlab(path: Path, data: WaveData) -> None:
    atomic_write(path, lambda part: write_matlab(part, to_keys(data)))


def _catch_damage(read: Callable[[Path], dict[str, Any]]) -> Callable[[Path], dict[str, Any]]:
    """The reader, with errors of damaged files turned into `InputError`."""

    def reader(path: Path) -> dict[str, Any]:
        check_regular(path, "data")
        try:
            return read(path)
        except NgbrainError:
            raise
        except Exception as error:  # damaged bytes make the libraries raise many kinds of exception
            wanted = f"a whole {path.suffix} file of plain arrays, without pickles"
            raise InputError("data", f"unreadable ({type(error).__name__}: {error})", wanted) from error

    return reader


def _format_of(path: Path) -> tuple[Callable[[Path], Mapping[str, Any]], Callable[[Path, WaveData], None]]:
    """Reader and writer of a file, by its suffix."""
    if path.suffix == ".npz":
        return _catch_damage(_read_npz), _write_npz
    if path.suffix == ".mat":
        return _catch_damage(read_matlab), _write_matlab
    if path.suffix in _HDF5:
        return _catch_damage(_read_h5), _write_h5
    if path.name.endswith(NIFTI):
        return _catch_damage(read_nifti), lambda place, data: write_nifti_waves(place, data, to_keys(data))
    raise InputError("data", f"a {path.suffix} file" if path.suffix else "a file without suffix", _WANTED)
