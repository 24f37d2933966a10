"""Volumes, values on a voxel grid with an affine, and T1 scans."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from ngbrain.io.labelled_arrays import image_array
from ngbrain.look import NotebookCard, grey_slices


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
