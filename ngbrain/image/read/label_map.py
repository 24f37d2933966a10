"""Label maps: the region of each voxel, and the names of the regions."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.read.resampling import reorient_to_ras
from ngbrain.image.read.volume import Volume
from ngbrain.io.labelled_arrays import image_array
from ngbrain.look import NotebookCard, slices


@dataclass(frozen=True, eq=False, repr=False)
class LabelMap(NotebookCard):
    """Region of each voxel.

    Parameters
    ----------
    volume : Volume
        Integers; 0 is outside.
    names : mapping
        Number → region; required for every number but 0. Several numbers may share a name.
    cut : numpy.ndarray, optional
        Share of each voxel that is cut away, where a cut runs through voxels.

    Raises
    ------
    InputError
        The volume has no integers, or a number has no name.

    Examples
    --------
    >>> two = LabelMap(Volume(np.array([[[0, 1, 1, 7]]]), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey", 7: "white"})
    >>> two.regions, two.volumes_ml()
    (('grey', 'white'), {'grey': 0.002, 'white': 0.001})
    """

    volume: Volume
    names: Mapping[int, str]
    cut: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.volume.data.dtype.kind not in "iu":
            raise InputError("labels", f"made of {self.volume.data.dtype} numbers", "integers")
        unnamed = sorted(set(np.unique(self.volume.data).tolist()) - {0} - set(self.names))
        if unnamed:
            raise InputError("labels", f"without a name for {unnamed[:5]}", "a name for every number but 0")

    def summary(self) -> dict[str, str]:
        """Regions with their volumes, and the grid."""
        ml = ", ".join(f"{name} {volume:.4g} ml" for name, volume in self.volumes_ml().items())
        shape = self.volume.summary()
        return {"regions": ml or "none", "shape": shape["shape"], "voxel": shape["voxel"]}

    def plot(self) -> Any:
        """The three middle slices, one colour for each region."""
        return slices(self.region_numbers(), ("outside", *self.regions))

    def to_xarray(self) -> Any:
        """As `xarray.DataArray` of region numbers, with their names in the attributes `flag_values` and `flag_meanings`."""
        flags = {
            "flag_values": list(range(len(self.regions) + 1)),
            "flag_meanings": " ".join(("outside", *self.regions)),
        }
        return image_array(self.region_numbers(), self.volume.affine, "label", "1", "number of the region", **flags)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write region numbers, counted from 1 in the order of `regions`, as a NIfTI file (.nii, .nii.gz); returns its path."""
        return Volume(self.region_numbers(), self.volume.affine).save(path)

    @cached_property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions that occur, in the order of their numbers."""
        present = set(np.unique(self.volume.data).tolist()) - {0}
        return tuple(dict.fromkeys(name for number, name in sorted(self.names.items()) if number in present))

    def region_numbers(self) -> np.ndarray:
        """Voxels with regions numbered from 1 in the order of `regions`, uint8; 0 is outside, or more than half cut away."""
        table = np.zeros(int(self.volume.data.max()) + 1, np.uint8)
        place = {name: i for i, name in enumerate(self.regions, 1)}
        for number, name in self.names.items():
            if 0 < number < len(table):
                table[number] = place.get(name, 0)
        numbers = table[self.volume.data]
        return numbers if self.cut is None else np.where(self.cut > 0.5, np.uint8(0), numbers)

    def volumes_ml(self) -> dict[str, float]:
        """Volume (ml) of each region."""
        left = None if self.cut is None else (1 - self.cut.astype(float)).ravel()
        counts = np.bincount(replace(self, cut=None).region_numbers().ravel(), left, len(self.regions) + 1)[1:]
        return dict(zip(self.regions, (counts * self.volume.voxel_volume * 1e6).tolist(), strict=True))

    def crop(self, air: float = 8e-3) -> LabelMap:
        """Crop to the labelled voxels with a margin `air` (m): files hold up to four times as many voxels as a head needs.

        >>> row = LabelMap(Volume(np.array([[[0, 0, 0, 1, 7, 0]]]), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey", 7: "white"})
        >>> row.crop(1e-3).volume.data.tolist(), row.crop(1e-3).volume.affine[2, 3]
        ([[[0, 1, 7, 0]]], np.float64(0.002))
        """
        boxes = ndimage.find_objects((self.volume.data != 0).astype(np.uint8))
        if not boxes:
            return self
        pad = np.ceil(air / self.volume.spacing).astype(int)
        first = np.maximum([side.start for side in boxes[0]] - pad, 0)
        last = np.minimum([side.stop for side in boxes[0]] + pad, self.volume.data.shape)
        box = tuple(slice(*ends) for ends in zip(first.tolist(), last.tolist(), strict=True))
        affine = self.volume.affine.copy()
        affine[:3, 3] = self.volume.to_world(first)
        cut = None if self.cut is None else self.cut[box]
        return LabelMap(Volume(self.volume.data[box], affine), self.names, cut)

    def resample_to_ras(self, spacing: float = 1e-3) -> LabelMap:
        """Resample to cubic voxels of `spacing` (m) along right, front and up, with regions numbered from 1.

        Flips and permutations of the axes keep the voxels. Otherwise a voxel takes the region with the largest share around it,
        by linear interpolation of each region's share in a box of the size of the new voxels.

        >>> two = LabelMap(Volume(np.array([[[0, 1, 1, 7]]]), np.diag([-1e-3, 1e-3, 1e-3, 1])), {1: "grey", 7: "white"})
        >>> two.resample_to_ras().volume.data.tolist()
        [[[0, 1, 1, 2]]]
        """
        turned = reorient_to_ras(Volume(self.region_numbers(), self.volume.affine))
        names = dict(enumerate(self.regions, 1))
        linear = turned.affine[:3, :3]
        if np.allclose(linear, spacing * np.eye(3), rtol=0, atol=1e-3 * spacing):
            return LabelMap(turned, names)
        corners = turned.to_world(np.array(list(np.ndindex(2, 2, 2))) * np.array(turned.data.shape) - 0.5)
        first = np.floor(corners.min(axis=0) / spacing)
        shape = tuple((np.ceil(corners.max(axis=0) / spacing) - first).astype(int) + 1)
        affine = np.diag([spacing, spacing, spacing, 1.0])
        affine[:3, 3] = spacing * first
        to = np.linalg.solve(turned.affine, affine)
        box = np.maximum(np.rint(spacing / turned.spacing), 1).astype(int)
        best, most = np.zeros(shape, np.uint8), np.full(shape, -1.0, np.float32)
        for number in range(len(names) + 1):
            share = (turned.data == number).astype(np.float32)
            share = ndimage.uniform_filter(share, tuple(box)) if box.max() > 1 else share
            around = 1.0 if number == 0 else 0.0
            share = ndimage.affine_transform(
                share, to[:3, :3], to[:3, 3], shape, order=1, mode="grid-constant", cval=around
            )
            best[share > most] = number
            most = np.maximum(most, share)
        return LabelMap(Volume(best, affine), names)
