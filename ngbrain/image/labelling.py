"""From a scan to labels of its tissues and structures; every step is cached, so that the next mesh does not segment again."""

from __future__ import annotations

import hashlib
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ngbrain.errors import InputError, file_context
from ngbrain.image.preprocess import bias_field, brain, check_brain, contrast, mni_landmarks, registration, skull_strip
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.label_schemes import TISSUES
from ngbrain.image.read.template import mni152
from ngbrain.image.read.volume import Scan, Volume
from ngbrain.image.segment import tissue_classes, topology, ventricles
from ngbrain.image.segment.partial_volume import correct_partial_volume
from ngbrain.image.structures import atlas, midsurface
from ngbrain.image.structures import structures as structures_module
from ngbrain.image.structures.midsurface import MidSurface
from ngbrain.image.structures.structures import NAMES, Structures, mask_background, segment_structures
from ngbrain.io.cache import Arrays, load_or_compute
from ngbrain.look import slices
from ngbrain.result import Result, Status

LEAST_CONTRAST = 3.0
"""Contrast of grey and white matter, in standard deviations of one tissue's grey values, below which boundaries are unreliable.

Measured: 6 in T1s of humans, 3.4 in their average (MNI152), 2.7 after a contrast agent that had made the two similar.
"""
# Volumes (ml) of humans from 6 to 90 years
_ADULT = {"grey": (400.0, 1100.0), "white": (300.0, 850.0), "ventricle": (7.0, 150.0)}


class TissueWarning(UserWarning):
    """Tissue labels are unreliable and should be inspected."""


@dataclass(repr=False, eq=False)
class Segmentation(Result):
    """Tissue of every voxel of a scan.

    Parameters
    ----------
    volume : Volume
        uint8, indices into `ngbrain.image.segment.tissue_classes.NAMES`.
    contrast : float
        Contrast between grey and white matter, in standard deviations of the grey values of one tissue; below `LEAST_CONTRAST`
        the boundaries are unreliable.
    """

    volume: Volume
    contrast: float

    @property
    def labels(self) -> LabelMap:
        """The tissues as a label map, for meshing."""
        return LabelMap(self.volume, TISSUES)

    @property
    def value(self) -> dict[str, float]:
        """Tissue → volume (ml)."""
        counts = (
            np.bincount(self.volume.data.ravel(), minlength=len(tissue_classes.NAMES)) * self.volume.voxel_volume * 1e6
        )
        return {name: float(counts[i]) for i, name in enumerate(tissue_classes.NAMES) if i != tissue_classes.OUTSIDE}

    @property
    def headline(self) -> str:
        """Volumes (ml) as text."""
        return ", ".join(f"{name} {ml:.4g} ml" for name, ml in self.value.items())

    @property
    def statistics(self) -> dict[str, float]:
        """The contrast between grey and white matter."""
        return {"spreads_from_grey_to_white": round(self.contrast, 1)}

    def plot(self) -> Any:
        """Plot the three middle slices."""
        return slices(self.volume.data, tissue_classes.NAMES)

    def to_xarray(self) -> Any:
        """As `xarray.DataArray` of region numbers, see `LabelMap.to_xarray`."""
        return self.labels.to_xarray()


def label_tissues(scan: Scan) -> Segmentation:
    """Segment the tissues of a scan: skull stripping, bias-field correction and classification
    (`ngbrain.image.segment.tissue_classes`).

    Warns (`TissueWarning`, and in the result's `warnings`) if grey and white matter have too little contrast, or if a volume is
    outside the range of humans.

    Raises
    ------
    InputError
        The scan is not a T1 of a whole head or brain.
    """
    with file_context(scan.source):  # volumes and masks do not know their file
        return _with_warnings(*_tissues(_brain(scan)))


def grey_white_contrast(scan: Scan) -> float:
    """Contrast between grey and white matter, in standard deviations of the grey values of one tissue; unreliable below
    `LEAST_CONTRAST`.

    Segments the scan unless that is cached; raises what `label_tissues` raises.
    """
    with file_context(scan.source):
        return _tissues(_brain(scan))[1]


def template_affine(scan: Scan) -> np.ndarray:
    """Affine map of the MNI152 template to a head, by registration of the brains.

    Parameters
    ----------
    scan : Scan
        T1 of the head.

    Returns
    -------
    numpy.ndarray
        (4, 4), from points (m) of the template to points of the head. Structures of the brain remain some millimetres off.

    Raises
    ------
    InputError
        The scan is not a T1 of a whole head or brain.
    """
    with file_context(scan.source):
        of = _brain(scan)
        return _alignment(of, _bias_corrected(of)).affine


def label_structures(scan: Scan) -> Structures:
    """Segment the tissues and structures of a scan (`label_tissues`, then `segment_structures`); raises what they raise.

    >>> from ngbrain.image.read.template import mni152
    >>> label_structures(mni152()).labels.regions[:4]
    ('csf', 'ventricles', 'grey_left', 'grey_right')
    """
    with file_context(scan.source):
        return _cached_structures(_brain(scan))


def label_by_atlas(scan: Scan, labels: LabelMap, template: Scan) -> LabelMap:
    """Label a scan by an atlas: its template is registered non-linearly to the scan's brain (`ngbrain.image.structures.atlas`).

    Parameters
    ----------
    scan : Scan
        T1 of the head.
    labels : LabelMap
        Labels of the atlas, in the space of the template.
    template : Scan
        T1 that the atlas was drawn on, with or without skull.

    Returns
    -------
    LabelMap

    Raises
    ------
    InputError
        `find_brain` or `propagate_labels` refuses a scan, or no label lies in the brain.
    MissingExtra
        SimpleITK, nilearn or nibabel is not installed.
    """
    head, drawn = _masked_brain(scan), _masked_brain(template)

    def make() -> Arrays:
        return {"labels": atlas.propagate_labels(labels, drawn, head).volume.data}

    names = {str(number): name for number, name in labels.names.items()}
    made_from = [head.digest(), drawn.digest(), labels.volume.digest(), names]
    found = LabelMap(
        Volume(load_or_compute("atlas", made_from, (atlas, registration), make)["labels"], head.affine), labels.names
    )
    if not found.regions:
        raise InputError("atlas", f"beside the brain of {template.source}", "labels in the space of the template")
    return found


def _masked_brain(scan: Scan) -> Volume:
    """The brain on a background of 0."""
    with file_context(scan.source):
        found = _brain(scan)
    return Volume(np.where(found.mask, found.picture.data, 0), found.picture.affine)


@dataclass(frozen=True, eq=False)
class _Brain:
    """A brain in a scan.

    Parameters
    ----------
    picture : Volume
        The scan after partial-volume correction.
    mask : numpy.ndarray
        Mask of the brain.
    place : numpy.ndarray
        (4, 4), affine of the template, found in the whole head.
    voxel : float
        Edge (m) of the voxels of the file.
    """

    picture: Volume
    mask: np.ndarray
    place: np.ndarray
    voxel: float

    @cached_property
    def seen(self) -> list[str]:
        """Digests of the picture and the mask."""
        return [self.picture.digest(), hashlib.sha256(np.packbits(self.mask).tobytes()).hexdigest()]


def _brain(scan: Scan) -> _Brain:
    made_from = [scan.volume.digest(), scan.file_affine.tolist(), list(scan.file_shape)]
    made_by = (registration, bias_field, brain, contrast, check_brain, mni_landmarks, skull_strip)

    def make() -> Arrays:
        mask, place = brain.find_brain_and_alignment(scan)
        return {"mask": mask, "place": place.affine}

    found = load_or_compute("brain", made_from, made_by, make)
    voxel = float(np.cbrt(abs(np.linalg.det(scan.file_affine[:3, :3]))))
    return _Brain(correct_partial_volume(scan, found["mask"]), found["mask"], found["place"], voxel)


def _bias_corrected(of: _Brain) -> Volume:
    """The picture after bias-field correction."""
    arrays = load_or_compute(
        "bias_corrected",
        of.seen,
        (bias_field,),
        lambda: {"t1": bias_field.correct_bias_field(of.picture, of.mask).data},
    )
    return Volume(arrays["t1"], of.picture.affine)


def _alignment(of: _Brain, corrected: Volume) -> registration.Alignment:
    """Alignment of the template with a brain."""

    def make() -> Arrays:
        found = registration.align(mask_background(corrected, of.mask), mni152().volume, of.place)
        return {"affine": found.affine, "likeness": np.array(found.likeness)}

    found = load_or_compute("place", [*of.seen, of.place.tolist()], (registration, bias_field), make)
    return registration.Alignment(found["affine"], float(found["likeness"]))


def _tissues(of: _Brain) -> tuple[Volume, float]:
    """Tissue labels, and the contrast between grey and white matter."""

    def make() -> Arrays:
        corrected = _bias_corrected(of)
        found = tissue_classes.segment(corrected, of.mask, _alignment(of, corrected).affine, of.voxel)
        return {"labels": found.volume.data, "contrast": np.array(found.contrast)}

    made_by = (tissue_classes, topology, ventricles, mni_landmarks, contrast, registration, bias_field)
    found = load_or_compute("labels", [*of.seen, of.place.tolist(), of.voxel], made_by, make)
    return Volume(found["labels"], of.picture.affine), float(found["contrast"])


def _with_warnings(labels: Volume, contrast: float) -> Segmentation:
    """The labels, with a warning if they should be inspected."""
    found = Segmentation(labels, contrast, status=Status.CONVERGED)
    if contrast < LEAST_CONTRAST:
        text = f"grey and white matter differ by {contrast:.1f} times the spread of one tissue's grey values"
        found.warnings.append(f"low contrast: {text}; below {LEAST_CONTRAST:g}, their boundaries are unreliable")
    for name, millilitres in found.value.items():
        low, high = _ADULT.get(name, (0.0, np.inf))
        if not low <= millilitres <= high:
            text = f"{millilitres:.1f} ml of {name} found, where people have {low:g} to {high:g} ml"
            found.warnings.append(f"{text}: inspect the labels")
    for text in found.warnings:
        warnings.warn(text, TissueWarning, stacklevel=3)
    return found


def _cached_structures(of: _Brain) -> Structures:
    labels = _with_warnings(*_tissues(of)).volume

    def make() -> Arrays:
        corrected = _bias_corrected(of)
        made = segment_structures(corrected, labels, _alignment(of, corrected))
        return {
            "labels": made.labels.volume.data,
            "parts": made.parts.data,
            "affine": made.affine,
            "offset": made.middle.offset,
        }

    modules = (structures_module, mni_landmarks, midsurface, registration, bias_field)
    found = load_or_compute("structures", [*of.seen, of.place.tolist(), labels.digest()], modules, make)
    names, affine = LabelMap(Volume(found["labels"], labels.affine), NAMES), labels.affine
    return Structures(names, Volume(found["parts"], affine), found["affine"], MidSurface(found["offset"]))
