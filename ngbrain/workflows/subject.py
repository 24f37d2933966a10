"""Labels of a head, read from a scan, a label map or closed surfaces, with their source."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ngbrain.errors import InputError, nearest
from ngbrain.image.labelling import grey_white_contrast, label_by_atlas, label_structures, label_tissues
from ngbrain.image.read.image_file import read_scan
from ngbrain.image.read.label_file import read_labels, read_labels_with_notes
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.landmarks import landmarks
from ngbrain.image.read.volume import Scan, Volume
from ngbrain.image.segment.fluid import label_sulcal_fluid, label_ventricles
from ngbrain.image.segment.from_surfaces import labels_from_surfaces
from ngbrain.io.surfacefile import read_surface
from ngbrain.look import BriefText


@dataclass(frozen=True, eq=False, repr=False)
class Subject(BriefText):
    """Labels of a head and their source.

    Parameters
    ----------
    labels : LabelMap
        What is meshed.
    t1 : Volume, optional
        The scan on the same voxels.
    affine : (4, 4) array
        Voxel to world (m) of the file's grid, on which maps are written.
    shape : tuple of int
        Shape of the file's grid.
    source : str
        The file.
    named : dict of tuple
        Named places (m) of the user.
    notes : tuple of str
        What was done to the labels, in sentences.
    contrast : float, optional
        Contrast of grey and white matter in the scan (`ngbrain.image.labelling.grey_white_contrast`); None without tissues from a
        scan.
    """

    labels: LabelMap
    t1: Volume | None
    affine: np.ndarray
    shape: tuple[int, int, int]
    source: str
    named: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    contrast: float | None = None

    def place(self, text: str, field: str = "place") -> tuple[float, float, float]:
        """A point in the file's field of view.

        Parameters
        ----------
        text : str
            "X,Y,Z" in mm, "voxel:I,J,K" of the file from 0, or the name of a landmark.
        field : str
            Name of the argument, for messages.

        Returns
        -------
        tuple of float
            In m.

        Raises
        ------
        InputError
            Another text, or a point outside the field of view.

        Examples
        --------
        >>> ball = np.linalg.norm(np.indices((9, 9, 9)) - 4, axis=0) < 4
        >>> labels = LabelMap(Volume(ball.astype(int), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey"})
        >>> subject = Subject(labels, None, labels.volume.affine, (9, 9, 9), "labels.nii")
        >>> [tuple(round(1e3 * c) for c in subject.place(text)) for text in ("1,2,3", "voxel:4,4,8", "centre of grey")]
        [(1, 2, 3), (4, 4, 8), (4, 4, 4)]
        """
        where = text.removeprefix("voxel:")
        try:
            numbers = np.array([float(part) for part in where.split(",")])
        except ValueError:
            known = {name: tuple(point.tolist()) for name, point in landmarks(self.labels).items()} | self.named
            if text in known:
                return known[text]
            raise InputError(field, repr(text), "X,Y,Z in mm, voxel:I,J,K, or " + nearest(text, known)) from None
        if numbers.shape != (3,):
            raise InputError(field, repr(text), "three numbers with commas")
        point = self.affine[:3] @ [*numbers, 1.0] if where != text else 1e-3 * numbers
        voxel = np.linalg.solve(self.affine, [*point, 1.0])[:3]
        if not ((voxel >= -0.5) & (voxel <= np.array(self.shape) - 0.5)).all():
            raise InputError(field, repr(text), f"a place in the field of view of {self.source}")
        return float(point[0]), float(point[1]), float(point[2])

    @classmethod
    def from_scan(cls, path: str | os.PathLike[str]) -> Subject:
        """From a T1 scan; raises what `read_scan` and `label_tissues` raise."""
        scan = read_scan(path)
        return cls._of_scan(label_tissues(scan).labels, scan)

    @classmethod
    def from_structures(cls, path: str | os.PathLike[str]) -> Subject:
        """From a T1 scan, with tissues split into structures (`ngbrain.image.structures.structures`): `grey_left`, `brain_stem`, …

        Patterns select them in a mesh of a route that conforms to tissues: `white.*` all white matter except the corpus callosum,
        `.*_left` a side; the boundary under the tentorium is `(grey|white)_(left|right)_(grey|white)_cerebellum` where cerebrum
        and cerebellum touch. For falx and tentorium as surfaces see `ngbrain.image.structures.dura`.

        Raises what `read_scan` and `label_structures` raise.
        """
        scan = read_scan(path)
        return cls._of_scan(label_structures(scan).labels, scan)

    @classmethod
    def from_atlas(
        cls,
        path: str | os.PathLike[str],
        atlas: str | os.PathLike[str],
        template: str | os.PathLike[str],
        names: str | Mapping[int, str] | None = None,
        others: Mapping[int, str] | None = None,
    ) -> Subject:
        """From a T1 scan and the labels of another head, transferred by registration of that head's own T1
        (`ngbrain.image.structures.atlas`).

        Parameters
        ----------
        path : path
            T1 scan.
        atlas : path
            Label map of the other head.
        template : path
            T1 scan of the other head.
        names : str or mapping of str, optional
            Label scheme, or number → name.
        others : mapping of str, optional
            Further names.

        Returns
        -------
        Subject
        """
        scan, labels = read_scan(path), read_labels(atlas, names, others)
        moved = label_by_atlas(scan, labels, read_scan(template))
        return cls(moved, scan.volume, scan.file_affine, scan.file_shape, scan.source)

    @classmethod
    def from_labels(
        cls,
        path: str | os.PathLike[str],
        names: str | Mapping[int, str] | None = None,
        others: Mapping[int, str] | None = None,
        fill: bool = True,
    ) -> Subject:
        """From a label map; raises what `read_labels` raises.

        Parameters
        ----------
        path : path
            Label map.
        names : str or mapping of str, optional
            Label scheme, or number → name.
        others : mapping of str, optional
            Further names.
        fill : bool
            Fill unlabelled sulci with fluid (`ngbrain.image.segment.fluid`). Ventricles are separated from other fluid in any case.

        Returns
        -------
        Subject
        """
        file, notes = read_labels_with_notes(path, names, others)
        labels, ml = label_ventricles(file.crop())
        notes += (f"ventricles are the fluid that lies deep in white matter, {ml:.1f} ml",) if ml else ()
        if fill:
            labels, ml = label_sulcal_fluid(labels)
            notes += (f"sulci without a label are filled with fluid, {ml:.1f} ml",) if ml else ()
        return cls._of(labels, file.volume, str(path), notes)

    @classmethod
    def from_surfaces(
        cls, parts: Sequence[tuple[str, str | os.PathLike[str]]], unit: str = "mm", fill: bool = True
    ) -> Subject:
        """From closed surfaces, named by their interior, outer ones first; raises what `read_surface` and `labels_from_surfaces`
        raise.

        They become a label map (`ngbrain.image.segment.from_surfaces`), which is written on its own voxels.

        Parameters
        ----------
        parts : sequence of tuple
            Name and path of each surface.
        unit : str
            Unit of length in files that do not state it.
        fill : bool
            See `from_labels`.

        Returns
        -------
        Subject
        """
        surfaces = [(name, read_surface(path, unit)) for name, path in parts]
        file = labels_from_surfaces(surfaces)
        points = np.concatenate([surface.points for _, surface in surfaces])
        wide = " by ".join(f"{1e3 * side:.0f}" for side in np.ptp(points, axis=0))
        units = "mm" if unit == "mm" else f"{unit} (mm in GIfTI and FreeSurfer's files)"
        notes: tuple[str, ...] = (
            f"lengths are in {units}: a body of {wide} mm",
            "surfaces enclose "
            + ", ".join(f"{1e6 * abs(surface.volume):.1f} ml ({name})" for name, surface in surfaces),
        )
        labels, ml = label_sulcal_fluid(file) if fill else (file, 0.0)
        notes += (f"sulci without a label are filled with fluid, {ml:.1f} ml",) if ml else ()
        return cls._of(labels, file.volume, ", ".join(str(path) for _, path in parts), notes)

    @classmethod
    def _of_scan(cls, labels: LabelMap, scan: Scan) -> Subject:
        contrast = grey_white_contrast(scan)
        return cls(labels, scan.volume, scan.file_affine, scan.file_shape, scan.source, contrast=contrast)

    @classmethod
    def _of(cls, labels: LabelMap, file: Volume, source: str, notes: tuple[str, ...]) -> Subject:
        shape = file.data.shape
        return cls(labels, None, file.affine, (shape[0], shape[1], shape[2]), source, notes=notes)
