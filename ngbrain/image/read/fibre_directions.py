"""Fibre directions from vector or diffusion-tensor images in NIfTI files, in world coordinates, and at points.

A direction has no sign, so that vectors cannot be averaged: structure tensors a⊗a are averaged and interpolated, and a
direction is the eigenvector of the largest eigenvalue. The axes of the components follow the convention of the file:

fsl       voxel axes, the first reversed if the affine has a positive determinant; tensors xx xy xz yy yz zz
mrtrix    scanner axes (right, front, up); tensors xx yy zz xy xz yz
nifti     scanner axes; tensors xx xy yy xz yz zz (`NIFTI_INTENT_SYMMATRIX`)
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.read.image_file import open_image
from ngbrain.image.read.property_maps import COVERED, SIDES
from ngbrain.image.read.volume import Volume
from ngbrain.look import BriefText

CONVENTIONS = {
    "fsl": ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)),
    "mrtrix": ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)),
    "nifti": ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)),
}
"""Convention → tensor entries in the order of the file."""
TWO_AXES = 1e-9
"""Relative difference of a tensor's two largest eigenvalues below which it has no direction."""


@dataclass(frozen=True, eq=False, repr=False)
class FibreDirections(BriefText):
    """Fibre directions on a voxel grid.

    Parameters
    ----------
    data : numpy.ndarray
        (nx, ny, nz, 3) unit vectors in world axes, 0 where unknown.
    affine : numpy.ndarray
        (4, 4), from voxel indices to m.

    Examples
    --------
    >>> along = FibreDirections(np.array([[[[1.0, 0, 0], [0, 0, 0], [-1.0, 0, 0]]]]), np.diag([1e-3, 1e-3, 1e-3, 1]))
    >>> along.interpolate(np.array([[0, 0, 0.4e-3], [0, 0, 1.6e-3]])).round(12).tolist()
    [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    """

    data: np.ndarray
    affine: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """(nx, ny, nz) bool: voxels with a direction."""
        return np.asarray(self.data.any(axis=-1))

    def tensors(self, points: np.ndarray) -> np.ndarray:
        """Structure tensors (n, 3, 3) at points (n, 3) in m, interpolated linearly; unknown voxels take the nearest known
        direction.
        """
        grid = Volume(np.zeros(self.data.shape[:3]), self.affine)
        last = np.array(grid.data.shape) - 1
        where = np.clip(grid.to_voxels(points), 0, last)
        low = np.minimum(np.floor(where).astype(int), np.maximum(last - 1, 0))
        beyond = where - low
        found = np.zeros((len(where), 3, 3))
        for corner in np.ndindex(2, 2, 2):
            index = np.minimum(low + corner, last)
            weight = np.where(corner, beyond, 1 - beyond).prod(axis=1)
            a = self.data[tuple(self._nearest[(slice(None), *index.T)])]
            found += np.einsum("n,ni,nj->nij", weight, a, a)
        return found

    @cached_property
    def _nearest(self) -> np.ndarray:
        """Index of the nearest voxel with a direction, (3, nx, ny, nz)."""
        spacing = np.linalg.norm(self.affine[:3, :3], axis=0)
        return np.asarray(
            ndimage.distance_transform_edt(~self.known, return_distances=False, return_indices=True, sampling=spacing)
        )

    def interpolate(self, points: np.ndarray) -> np.ndarray:
        """Unit vectors (n, 3), up to sign, at points (n, 3) in m; unknown voxels take the nearest known direction."""
        return principal_directions(self.tensors(points))

    def covers(self, points: np.ndarray) -> np.ndarray:
        """(n,) bool: points (n, 3) in m that lie in a voxel with a direction."""
        return Volume(self.known.astype(np.float32), self.affine).interpolate(points, order=0) > 0

    def check_covers(self, points: np.ndarray, what: str) -> None:
        """Refuse a map that leaves out most of a body.

        Parameters
        ----------
        points : numpy.ndarray
            (n, 3), m.
        what : str
            What the points are, for the message.

        Raises
        ------
        InputError
            Fewer than the share `property_maps.COVERED` of the points lie in voxels with a direction.
        """
        covered = float(self.covers(points).mean()) if len(points) else 1.0
        if covered < COVERED:
            found = f"without a direction at {1 - covered:.0%} of the {what}"
            raise InputError("fibre_map", found, f"a map in the coordinates of the {what} that covers most of them")


def principal_directions(tensors: np.ndarray) -> np.ndarray:
    """Eigenvectors (…, 3) of the largest eigenvalues of symmetric tensors (…, 3, 3); the largest component is positive.

    >>> principal_directions(np.diag([1.0, 3.0, 2.0])).tolist()
    [0.0, 1.0, 0.0]
    """
    a = np.linalg.eigh(tensors)[1][..., -1]
    largest = np.take_along_axis(a, np.abs(a).argmax(axis=-1)[..., None], axis=-1)
    return np.asarray(a * np.where(largest < 0, -1.0, 1.0))


def read_fibre_directions(path: str | os.PathLike[str], convention: str) -> FibreDirections:
    """Read fibre directions from a NIfTI file.

    Parameters
    ----------
    path : str or Path
        Vectors (x, y, z, 3) of any length, 0 where unknown, or tensors (x, y, z, 6), (x, y, z, 9) or (x, y, z, 3, 3), whose
        principal direction is used.
    convention : str
        "fsl", "mrtrix" or "nifti": axes and order of the components.

    Returns
    -------
    FibreDirections
        In world axes.

    Raises
    ------
    InputError
        The file is unreadable, has another shape, no direction, or sheared voxels, for which components are undefined.
    MissingExtra
        nibabel is not installed.

    Examples
    --------
    >>> read_fibre_directions("scene.toml", "fsl")
    Traceback (most recent call last):
    ngbrain.errors.InputError: scene.toml: image is missing; wanted: one NIfTI or MGH file: .nii, .nii.gz, .mgh or .mgz
    """
    path = Path(path)
    if convention not in CONVENTIONS:
        raise InputError("fibre_map_convention", repr(convention), f"one of {', '.join(CONVENTIONS)}")
    return _read(path, convention, path.stat().st_mtime_ns if path.exists() else 0)


@lru_cache(maxsize=4)
def _read(path: Path, convention: str, _stamp: int) -> FibreDirections:
    image, affine = open_image(path, SIDES)
    try:
        values = np.asarray(image.get_fdata(dtype=np.float64))
    except (OSError, EOFError, ValueError) as error:
        raise InputError("fibre_map", f"cut short ({error})", "a whole file", path) from error
    if values.ndim == 5 and values.shape[3] == 1:  # NIfTI stores vectors and tensors along the fifth axis
        values = values[:, :, :, 0]
    count = values.shape[3:]
    if count not in ((3,), (6,), (9,), (3, 3)):
        wanted = "vectors (x, y, z, 3), or tensors (x, y, z, 6) or (x, y, z, 3, 3)"
        raise InputError("fibre_map", f"of shape {values.shape}", wanted, path)
    values = np.where(np.isfinite(values).all(axis=tuple(range(3, values.ndim)), keepdims=True), values, 0.0)
    turn = _axes(affine, convention, path)
    own = values if count == (3,) else _of_tensors(values, count, convention)
    length = np.linalg.norm(own, axis=-1, keepdims=True)
    if not length.any():
        raise InputError("fibre_map", "without a direction", "vectors or tensors that are not all 0", path)
    return FibreDirections(own / np.where(length > 0, length, 1.0) @ turn.T, affine)


def _of_tensors(values: np.ndarray, count: tuple[int, ...], convention: str) -> np.ndarray:
    """Principal directions; 0 where the tensor is 0 or its two largest eigenvalues are equal."""
    shape = values.shape[:3]
    if count == (6,):
        tensors = np.empty((*shape, 3, 3))
        for k, (i, j) in enumerate(CONVENTIONS[convention]):
            tensors[..., i, j] = tensors[..., j, i] = values[..., k]
    else:
        tensors = values.reshape(*shape, 3, 3)
        tensors = (tensors + np.swapaxes(tensors, -1, -2)) / 2
    known = np.argwhere(tensors.any(axis=(-1, -2)))
    found, own = np.zeros((*shape, 3)), tensors[tuple(known.T)]
    sizes = np.linalg.eigvalsh(own)
    sure = sizes[:, 2] - sizes[:, 1] > TWO_AXES * np.abs(sizes).max(axis=1, initial=0.0)
    found[tuple(known[sure].T)] = principal_directions(own[sure])
    return found


def _axes(affine: np.ndarray, convention: str, path: Path) -> np.ndarray:
    """Matrix from the components of a file to world axes."""
    if convention != "fsl":
        return np.eye(3)
    axes = affine[:3, :3] / np.linalg.norm(affine[:3, :3], axis=0)
    if np.abs(axes.T @ axes - np.eye(3)).max() > 1e-3:
        raise InputError(
            "fibre_map", "of sheared voxels", "voxels with right angles, whose axes components can be along", path
        )
    return np.asarray(axes @ np.diag([-1.0 if np.linalg.det(axes) > 0 else 1.0, 1.0, 1.0]))
