"""Volumes: values on a voxel grid with an affine; T1 scans and their files."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError, require
from ngbrain.image.read.dicom import is_dicom, read_series
from ngbrain.io.labelled_arrays import image_array
from ngbrain.look import BriefText, NotebookCard, grey_slices
from ngbrain.reading import check_regular, gunzip, read_bytes, unzip

_GRID = 1e-3  # m
_MOST_VOXELS = 512**3
_SIDES = (0.2e-3, 5e-3)  # m, of a voxel
_LEAST = 0.1  # m, along each axis of a scan
_FWHM = np.sqrt(8 * np.log(2))  # full width at half maximum of a Gaussian, in standard deviations
_UNITS = {1: 1.0, 2: 1e-3, 3: 1e-6}  # NIfTI's code for the unit of length -> m
_NIFTI = "one NIfTI or MGH file: .nii, .nii.gz, .mgh or .mgz"
_MGH = b"\0\0\0\1\0\0"  # version 1, big-endian, and the size along the first axis below 2^16


@dataclass(frozen=True, eq=False, repr=False)
class Volume(NotebookCard):
    """Values on a voxel grid.

    Parameters
    ----------
    data : numpy.ndarray
        (nx, ny, nz).
    affine : numpy.ndarray
        (4, 4), from voxel indices (of voxel centres) to m; the world axes are right, front, up.

    Examples
    --------
    >>> box = Volume(np.arange(8.0).reshape(2, 2, 2), np.diag([1e-3, 1e-3, 2e-3, 1]))
    >>> box.interpolate(np.array([[0.0, 0.0, 1e-3], [0.5e-3, 0.0, 2e-3]]))
    array([0.5, 3. ])
    """

    data: np.ndarray
    affine: np.ndarray

    def summary(self) -> dict[str, str]:
        """Shape, voxels and values in words."""
        voxel = " × ".join(f"{1e3 * side:.3g}" for side in self.spacing)
        return {
            "shape": " × ".join(str(n) for n in self.data.shape) + " voxels",
            "voxel": f"{voxel} mm",
            "values": f"{np.min(self.data):.4g} to {np.max(self.data):.4g}",
        }

    def plot(self) -> Any:
        """The three middle slices in grey."""
        return grey_slices(np.asarray(self.data, float))

    def to_xarray(self, name: str = "image", units: str = "1", long_name: str = "value") -> Any:
        """As `xarray.DataArray` along x, y, z (m), or along i, j, k if its voxels are oblique.

        Parameters
        ----------
        name : str
            Name of the array.
        units : str
            Unit of the values.
        long_name : str
            What they are.

        Returns
        -------
        xarray.DataArray

        Raises
        ------
        MissingExtra
            xarray is not installed.
        """
        return image_array(np.asarray(self.data), self.affine, name, units, long_name)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write a NIfTI file (.nii, .nii.gz); returns its path."""
        from ngbrain.image.read.nifti import write_nifti  # reads what is defined here

        write_nifti(path, self)
        return Path(path)

    @property
    def spacing(self) -> np.ndarray:
        """Voxel spacing along each axis of `data`, (3,) m."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    @property
    def voxel_volume(self) -> float:
        """Volume of a voxel (m³)."""
        return float(abs(np.linalg.det(self.affine[:3, :3])))

    def to_world(self, indices: np.ndarray) -> np.ndarray:
        """Points (n, 3) in m of voxel indices (n, 3), which need not be integers."""
        return np.asarray(indices) @ self.affine[:3, :3].T + self.affine[:3, 3]

    def to_voxels(self, points: np.ndarray) -> np.ndarray:
        """Voxel indices (n, 3), not rounded, of points (n, 3) in m."""
        return np.linalg.solve(self.affine[:3, :3], (np.asarray(points) - self.affine[:3, 3]).T).T

    def interpolate(self, points: np.ndarray, order: int = 1, outside: float = 0.0) -> np.ndarray:
        """Values at points, by spline interpolation.

        Parameters
        ----------
        points : numpy.ndarray
            (n, 3) m.
        order : int, optional
            Order of the spline, 0 to 5.
        outside : float, optional
            Value outside the volume.

        Returns
        -------
        numpy.ndarray
            (n,).
        """
        # "grid-constant": with "constant", a round-off error would put points on the last voxel outside.
        where = self.to_voxels(points).T
        return ndimage.map_coordinates(self.data, where, float, order=order, mode="grid-constant", cval=outside)

    def digest(self) -> str:
        """SHA-256 of data and affine, in hexadecimal; the cache key of derived results."""
        affine = np.ascontiguousarray(self.affine, float)
        head = f"{self.data.dtype.str} {self.data.shape}".encode()
        return hashlib.sha256(head + affine.tobytes() + np.ascontiguousarray(self.data).tobytes()).hexdigest()


@dataclass(frozen=True, eq=False, repr=False)
class Scan(NotebookCard):
    """A T1 scan.

    Parameters
    ----------
    volume : Volume
        float32, axes right, front, up (RAS), voxels of 1 mm.
    file_affine : numpy.ndarray
        (4, 4), from indices (from 0) of the array in the file to m.
    file_shape : tuple of int
        Shape of that array; outside it nothing was measured, whatever `volume` contains there.
    source : str
        Path of the file or name of a template.
    """

    volume: Volume
    file_affine: np.ndarray
    file_shape: tuple[int, int, int]
    source: str

    def summary(self) -> dict[str, str]:
        """Source, and the volume's."""
        return {"source": self.source, **self.volume.summary()}

    def plot(self) -> Any:
        """The three middle slices in grey."""
        return self.volume.plot()

    def to_xarray(self) -> Any:
        """As `xarray.DataArray` along x, y, z (m)."""
        return self.volume.to_xarray("T1", "1", "T1-weighted signal").assign_attrs(source=self.source)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write a NIfTI file (.nii, .nii.gz); returns its path."""
        return self.volume.save(path)


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


def resample_to_ras(volume: Volume, spacing: float = _GRID) -> Volume:
    """Resample a volume to isotropic voxels along right, front, up (RAS).

    If flips and permutations of the axes suffice (to 1e-3 of `spacing`), values are unchanged. Otherwise they are interpolated
    by cubic splines at multiples of `spacing` in world coordinates, after smoothing along axes finer than `spacing`. The
    background (`border_value`) stays exact, and no value leaves the original range. The affine is rounded to 1 µm, so that
    flipped copies of an image give the same result.

    Parameters
    ----------
    volume : Volume
        The volume.
    spacing : float, optional
        Voxel spacing (m).

    Returns
    -------
    Volume

    Raises
    ------
    InputError
        The new grid would have more than 512³ voxels.
    MissingExtra
        nibabel is not installed.

    Examples
    --------
    >>> image = Volume(np.eye(3, dtype=np.float32)[:, :, None] * np.ones(2, np.float32), np.diag([-1e-3, 1e-3, 1e-3, 1]))
    >>> resample_to_ras(image).affine[:3, 3], resample_to_ras(image).data[:, :, 0].tolist()
    (array([-0.002, 0. , 0. ]), [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    """
    volume = reorient_to_ras(volume)
    linear = volume.affine[:3, :3]
    steps = np.diag(linear)
    if np.abs(linear - np.diag(steps)).max() <= 1e-6 * spacing and np.abs(steps - spacing).max() <= 1e-3 * spacing:
        return volume
    corners = volume.to_world(np.array(list(np.ndindex(2, 2, 2))) * np.array(volume.data.shape) - 0.5)
    # Tolerance of 1e-6 voxels: corners that fall on grid points up to round-off are included.
    first = np.ceil(corners.min(axis=0) / spacing - 1e-6)
    shape = np.floor(corners.max(axis=0) / spacing + 1e-6).astype(int) - first.astype(int) + 1
    if shape.prod() > _MOST_VOXELS:
        found = "x".join(map(str, shape)) + f" voxels of {1e3 * spacing:g} mm"
        raise InputError("image", found, "at most 512³ of them")
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = spacing * first
    matrix = np.linalg.solve(volume.affine, affine)
    turn, offset = matrix[:3, :3], matrix[:3, 3]
    if np.abs(turn - np.diag(np.diag(turn))).max() <= 1e-9:
        turn = np.diag(turn)  # then spline weights are computed once per axis

    background, _ = border_value(volume)
    # Zero around the image: half a voxel outside, its share falls below one half.
    picture = (volume.data != background).astype(np.float32)
    share = ndimage.affine_transform(picture, turn, offset, tuple(shape), order=1, mode="grid-constant")
    inside = share >= 0.5
    values = np.full(inside.shape, background, np.float32)

    data = volume.data.astype(np.float32, copy=False)
    # Anti-aliasing: a Gaussian that widens an old voxel to the width of a new one.
    blur = np.sqrt(np.maximum((spacing / volume.spacing) ** 2 - 1, 0)) / _FWHM
    smooth = ndimage.gaussian_filter(data, blur)
    new = ndimage.affine_transform(smooth, turn, offset, tuple(shape), order=3, mode="nearest")
    values[inside] = new[inside].clip(data.min(), data.max())
    return Volume(values, affine)


def border_value(volume: Volume) -> tuple[float, float]:
    """The most common value on the six faces of a volume, and its share of their voxels.

    >>> border_value(Volume(np.pad(np.ones((2, 2, 2)), 1), np.eye(4)))
    (0.0, 1.0)
    """
    faces = [volume.data.take(end, axis).ravel() for axis in range(3) for end in (0, -1)]
    values, counts = np.unique(np.concatenate(faces), return_counts=True)
    most = counts.argmax()
    return float(values[most]), float(counts[most] / counts.sum())


def reorient_to_ras(volume: Volume) -> Volume:
    """Flip and permute the axes so that they are as close as possible to right, front, up (RAS); no interpolation."""
    orientations = require("nibabel.orientations", "mri")
    turn = orientations.io_orientation(volume.affine)
    affine = volume.affine @ orientations.inv_ornt_aff(turn, volume.data.shape)
    # Remove round-off of the flips and of a float32 header.
    affine[:3, :3] = affine[:3, :3].round(9)
    affine[:3, 3] = affine[:3, 3].round(6)
    return Volume(np.ascontiguousarray(orientations.apply_orientation(volume.data, turn)), affine + 0.0)  # no -0.0


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
    if np.prod(shape) > 4 * _MOST_VOXELS:
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
