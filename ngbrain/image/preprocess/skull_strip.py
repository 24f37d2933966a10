"""Skull stripping: the registered template gives the position of the brain, grey values its boundary."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError, file_context, require
from ngbrain.image.preprocess.bias_field import correct_bias_field
from ngbrain.image.preprocess.contrast import TISSUES, measure_contrast
from ngbrain.image.preprocess.registration import ALIKE, Alignment, align, downsample
from ngbrain.image.read.template import mni152
from ngbrain.image.read.volume import Scan, Volume

_WANTED = "a T1 of a whole head or brain"
_T1 = "a T1, in which white matter is brightest"
# Minimum step from grey to white matter; measured: T1s 0.95 and more, after a contrast agent 0.80, FLAIR and PD up to 0.57.
_STEP = 0.7
_VOXEL = 2e-3  # m, working resolution
_AROUND = 8  # voxels, margin around the template's brain
_SURE, _FAR = 6.0, 9.0  # mm: depth in the template's brain where all is brain, and distance outside it where none is
_LEVELS = (0.02, 0.40, 0.85)  # quantiles of the grey values inside that are near fluid, grey and white matter
_FAT = 0.6  # of the step from grey to white matter: brighter than white matter by more is fat
_SMOOTH = 0.7  # mm, against noise
_EDGE = 0.5  # threshold of tissue, 0 for fluid and 1 for grey matter
# Higher thresholds that separate marrow and orbits, which partial-volume voxels of fluid or thin bone connect to the brain.
_EDGES = (0.55, 0.65, 0.75, 0.85)
_NECK = 2.5  # mm: half the width of bridges that are cut
_FOLD = 9.0  # mm: half the width of the widest filled sulcus
_FILM = 1.5  # mm of fluid around the brain that are included


def skull_strip(scan: Scan, place: Alignment | None = None) -> np.ndarray:
    """Brain mask of a T1 with skull, fluid of the sulci included.

    The MNI152 brain is registered to the head (`align`), and the bias field is corrected (`correct_bias_field`). The inside of
    the template gives the grey values of fluid, grey and white matter. What is brighter than half way from fluid to grey
    matter, and not much brighter than white matter, is tissue. It is brain if it is connected to the inside by bridges wider
    than 5 mm, so that eyes, muscle and marrow stay out, and within 9 mm of the template.

    In coarse voxels thin bone is as bright as grey matter, and marrow is connected by wide bridges. So components that separate
    at some brighter threshold and lie mostly outside the template's brain are other tissue, as is fat; their boundary is where
    a watershed from them and one from the brain, brightest places first, meet (Beucher & Meyer 1993). Sulci up to 18 mm wide
    are filled, and 1.5 mm of surrounding fluid are included. No trained model is used; the only prior is the template.

    Parameters
    ----------
    scan : Scan
        The T1.
    place : Alignment, optional
        Alignment of the template, if `align_template` has computed it.

    Returns
    -------
    numpy.ndarray
        (nx, ny, nz) mask over `scan.volume`.

    Raises
    ------
    InputError
        As `align_template`.
    MissingExtra
        nilearn, SimpleITK or scikit-image is not installed.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> affine, noise = np.diag([4e-3, 4e-3, 4e-3, 1]), rng.random((50, 50, 50)).astype(np.float32)
    >>> skull_strip(Scan(Volume(noise, affine), affine, (50, 50, 50), "noise.nii"))
    Traceback (most recent call last):
    ngbrain.errors.InputError: noise.nii: image is an image whose largest bright part has 0.00 litres; wanted: at least 0.5, ...
    """
    template, found = mni152().volume, place or align_template(scan)
    head = downsample(scan.volume, _VOXEL)
    to = np.linalg.inv(template.affine) @ np.linalg.inv(found.affine) @ head.affine
    whole = (template.data != 0).astype(np.float32)
    prior = ndimage.affine_transform(whole, to[:3, :3], to[:3, 3], head.data.shape, order=1) > 0.5
    there = ndimage.find_objects(prior.astype(np.uint8))[0]
    box = tuple(slice(max(part.start - _AROUND, 0), part.stop + _AROUND) for part in there)
    corrected = correct_bias_field(Volume(head.data[box], head.affine), prior[box])
    mask = np.zeros_like(prior)
    mask[box] = _refine_mask(corrected.data, prior[box], 1e3 * head.spacing)
    outside = _signed_distance(mask, 1e3 * head.spacing)
    to = np.linalg.inv(head.affine) @ scan.volume.affine
    fine = ndimage.affine_transform(
        outside, np.diag(to)[:3], to[:3, 3], scan.volume.data.shape, order=1, mode="nearest"
    )
    return np.asarray(ndimage.binary_fill_holes(fine <= _FILM))


def align_template(scan: Scan) -> Alignment:
    """Register the MNI152 template to a scan, with or without skull, and check that it is a T1.

    Raises
    ------
    InputError
        The image is nearly only background; it is unlike the template's brain (likeness below 0.4); or it has another contrast
        than a T1, in which white matter is brightest.
    MissingExtra
        nilearn is not installed.
    """
    with file_context(scan.source):
        found = align(scan.volume, mni152().volume)
        if found.likeness < ALIKE:
            what = f"unlike a brain (correlation with the MNI152 template {found.likeness:.2f}"
            raise InputError("image", f"{what}, at least {ALIKE:g} needed{_orientation_hint(scan.volume)})", _WANTED)
        seen = measure_contrast(scan.volume, found.affine)
        if seen.order[2] != TISSUES[2]:  # fluid is darkest, except for vessels after a contrast agent
            what = f"an image in which {seen.order[2]} is brightest and {seen.order[0]} darkest"
            raise InputError("image", what.replace("grey", "grey matter").replace("white", "white matter"), _T1)
        if seen.step < _STEP:
            what = (
                f"an image in which white matter is hardly brighter than grey (by {seen.step:.2f} standard deviations"
            )
            raise InputError("image", f"{what}, at least {_STEP:g} needed)", _T1)
    return found


def _orientation_hint(head: Volume) -> str:
    """Hint on an affine with which a head is upside down or back to front; empty if neither fits."""
    for axis, how in ((2, "upside down"), (1, "back to front")):
        turned = np.eye(4)
        turned[axis, axis] = -1
        likeness = align(Volume(head.data, turned @ head.affine), mni152().volume, far=False).likeness
        if likeness >= ALIKE:
            return f"; {how} it has {likeness:.2f}: is its affine wrong, and are left and right?"
    return ""


def _refine_mask(grey: np.ndarray, prior: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Brain mask by grey values, given the template's mask `prior`; voxels of `spacing` (3,) mm."""
    smooth = ndimage.gaussian_filter(grey, _SMOOTH / spacing)
    sure = ndimage.distance_transform_edt(prior, sampling=spacing) > _SURE
    fluid, matter, white = np.quantile(smooth[sure], _LEVELS)
    position = (smooth - fluid) / (matter - fluid)
    fat = smooth >= white + _FAT * (white - matter)
    allowed = _dilate(prior, _FAR, spacing)
    tissue = sure | ((position > _EDGE) & ~fat & allowed)
    tissue &= sure | ~_other_tissue(position, tissue, prior, sure, fat & allowed, spacing)
    deep = ndimage.distance_transform_edt(tissue, sampling=spacing) > _NECK
    pieces, _ = ndimage.label(deep)
    deep = np.isin(pieces, np.setdiff1d(pieces[sure], [0]))
    brain = tissue & _dilate(deep, _NECK + 0.5, spacing)
    # Morphological closing; the faces of the volume are not treated as walls.
    margin = [(int(np.ceil(_FOLD / step)) + 1,) * 2 for step in spacing]
    full = _dilate(np.pad(brain, margin), _FOLD, spacing)
    full = ndimage.distance_transform_edt(full, sampling=spacing) > _FOLD
    brain |= full[tuple(slice(before, -after) for before, after in margin)]
    return np.asarray(ndimage.binary_fill_holes(brain))


def _other_tissue(
    position: np.ndarray, tissue: np.ndarray, prior: np.ndarray, sure: np.ndarray, fat: np.ndarray, spacing: np.ndarray
) -> np.ndarray:
    """Tissue that is not brain although it is connected to it.

    Parameters
    ----------
    position : numpy.ndarray
        Grey values, 0 for fluid and 1 for grey matter.
    tissue : numpy.ndarray
        Mask of all tissue.
    prior : numpy.ndarray
        Mask of the template's brain.
    sure : numpy.ndarray
        Mask of its inside.
    fat : numpy.ndarray
        Mask of fat.
    spacing : numpy.ndarray
        (3,) mm.

    Returns
    -------
    numpy.ndarray
        Mask.
    """
    flood = require("skimage.segmentation", "mri").watershed
    marks = np.zeros(tissue.shape, np.int32)
    for edge in _EDGES:
        deep = ndimage.distance_transform_edt(sure | (tissue & (position > edge)), sampling=spacing) > _NECK
        pieces, count = ndimage.label(deep)
        size, within = (np.bincount(pieces[part].ravel(), minlength=count + 1) for part in (..., prior))
        apart = within < size / 2
        brain = np.isin(np.arange(count + 1), pieces[sure])
        apart[0] = brain[0] = False
        marks[(apart & ~brain)[pieces]] = 2
    marks[brain[pieces] & (marks == 0)] = 1  # still connected at the highest threshold
    marks[fat & ~prior] = 2
    return np.asarray(flood(-position, marks, mask=tissue | (marks > 0)) == 2)


def _signed_distance(mask: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Signed distance (mm) of voxel centres from the surface of the mask, negative inside."""
    out, inside = (ndimage.distance_transform_edt(each, sampling=spacing) for each in (~mask, mask))
    half = spacing.mean() / 2
    return np.where(mask, half - inside, out - half).astype(np.float32)


def _dilate(mask: np.ndarray, reach: float, spacing: np.ndarray) -> np.ndarray:
    """The mask dilated by `reach` (mm)."""
    return np.asarray(ndimage.distance_transform_edt(~mask, sampling=spacing) <= reach)
