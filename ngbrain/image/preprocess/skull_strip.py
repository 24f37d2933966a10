"""The brain in a head with its skull: the template's place says where it is, grey values where it ends."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError, file_context, require
from ngbrain.image.preprocess.bias_field import correct_bias_field
from ngbrain.image.preprocess.contrast import TISSUES, measure_contrast
from ngbrain.image.preprocess.registration import ALIKE, Alignment, align, downsample
from ngbrain.image.read.volume import Scan, Volume, mni152

_WANTED = "a T1 of a whole head or brain"
_T1 = "a T1, in which white matter is brightest"
# Least step from grey to white matter; measured: T1s 0.95 and more, after a contrast agent 0.80, FLAIR and PD to 0.57.
_STEP = 0.7
_VOXEL = 2e-3  # m, on which the brain is looked for
_AROUND = 8  # such voxels about the template's brain that are looked at
_SURE, _FAR = 6.0, 9.0  # mm inside the template's brain all is brain, mm outside it none
_LEVELS = (0.02, 0.40, 0.85)  # quantiles of the grey values in there that are near fluid, grey and white matter
_FAT = 0.6  # of the step from grey to white matter: what is brighter than white matter by more is no brain
_SMOOTH = 0.7  # mm, against noise
_EDGE = 0.5  # on the way from fluid to grey matter: what is brighter is tissue
# Brighter edges, at which marrow and orbits come off the brain that hang on it by voxels which share fluid or thin bone.
_EDGES = (0.55, 0.65, 0.75, 0.85)
_NECK = 2.5  # mm: half the width of what is cut through between brain and other tissue
_FOLD = 9.0  # mm: half the width of the widest sulcus that is filled
_FILM = 1.5  # mm of fluid that goes with the brain


def skull_strip(scan: Scan, place: Alignment | None = None) -> np.ndarray:
    """The brain of a T1 with skull, fluid of the sulci included, as a mask (nx, ny, nz) over `scan.volume`.

    place   of the template in it, if `align_template` has found it before

    The MNI152 brain is laid into the head (`align`), and the field of the coil is taken out (`correct_bias_field`). The template's
    inside tells how bright fluid, grey and white matter are. What is brighter than half way from fluid to grey matter
    and not much brighter than white is tissue: the brain where it hangs on to the inside by bridges wider than 5 mm, so
    that eyes, muscle and marrow stay out, and within 9 mm of the template. In coarse voxels thin bone is as bright as
    grey matter, and marrow hangs on by wide bridges. So pieces that come off at some brighter edge and lie mostly outside
    the template's brain are taken for other tissue, as fat is, and end where a flood from them and one from the brain,
    brightest places first, meet (Beucher & Meyer 1993). Sulci up to 18 mm wide are filled, and 1.5 mm
    of fluid around go with it. Nothing of this is learnt; the template is all that it knows.

    Raises:
        InputError: as `align_template` does.
        MissingExtra: nilearn, SimpleITK or scikit-image is not installed.

    >>> rng = np.random.default_rng(1)
    >>> affine, noise = np.diag([4e-3, 4e-3, 4e-3, 1]), rng.random((50, 50, 50)).astype(np.float32)
    >>> skull_strip(Scan(Volume(noise, affine), affine, (50, 50, 50), "noise.nii"))
    Traceback (most recent call last):
    ngbrain.errors.InputError: noise.nii: image is a picture whose largest bright part has 0.00 litres; wanted: at least 0.5, ...
    """
    template, found = mni152().volume, place or align_template(scan)
    head = downsample(scan.volume, _VOXEL)
    to = np.linalg.inv(template.affine) @ np.linalg.inv(found.affine) @ head.affine
    whole = (template.data != 0).astype(np.float32)
    prior = ndimage.affine_transform(whole, to[:3, :3], to[:3, 3], head.data.shape, order=1) > 0.5
    there = ndimage.find_objects(prior.astype(np.uint8))[0]
    box = tuple(slice(max(part.start - _AROUND, 0), part.stop + _AROUND) for part in there)
    even = correct_bias_field(Volume(head.data[box], head.affine), prior[box])
    mask = np.zeros_like(prior)
    mask[box] = _refined(even.data, prior[box], 1e3 * head.spacing)
    outside = _beyond(mask, 1e3 * head.spacing)
    to = np.linalg.inv(head.affine) @ scan.volume.affine
    fine = ndimage.affine_transform(
        outside, np.diag(to)[:3], to[:3, 3], scan.volume.data.shape, order=1, mode="nearest"
    )
    return np.asarray(ndimage.binary_fill_holes(fine <= _FILM))


def align_template(scan: Scan) -> Alignment:
    """Where the template's brain lies in a scan, with a skull or without.

    Raises:
        InputError: next to nothing but background; nothing like the template's brain (likeness below 0.4); or another
            contrast than that of a T1, in which white matter is brightest.
        MissingExtra: nilearn is not installed.
    """
    with file_context(scan.source):
        found = align(scan.volume, mni152().volume)
        if found.likeness < ALIKE:
            what = f"a picture that is not like a brain (correlation with the MNI152 template {found.likeness:.2f}"
            raise InputError("image", f"{what}, at least {ALIKE:g} needed{_turned(scan.volume)})", _WANTED)
        seen = measure_contrast(scan.volume, found.affine)
        if seen.order[2] != TISSUES[2]:  # fluid is darkest, but for the vessels in it after a contrast agent
            what = f"a picture in which {seen.order[2]} is brightest and {seen.order[0]} darkest"
            raise InputError("image", what.replace("grey", "grey matter").replace("white", "white matter"), _T1)
        if seen.step < _STEP:
            what = f"a picture in which white matter is hardly brighter than grey (by {seen.step:.2f} of the spread of grey values"
            raise InputError("image", f"{what}, at least {_STEP:g} needed)", _T1)
    return found


def _turned(head: Volume) -> str:
    """What is wrong with an affine by which a head stands on its head, or looks back; nothing where it is no such head."""
    for axis, how in ((2, "upside down"), (1, "back to front")):
        turned = np.eye(4)
        turned[axis, axis] = -1
        likeness = align(Volume(head.data, turned @ head.affine), mni152().volume, far=False).likeness
        if likeness >= ALIKE:
            return f"; {how} it has {likeness:.2f}: is its affine wrong, and are left and right?"
    return ""


def _refined(grey: np.ndarray, prior: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """The brain by grey values, where `prior` is the template's; voxels of `spacing` (3,) in mm."""
    smooth = ndimage.gaussian_filter(grey, _SMOOTH / spacing)
    sure = ndimage.distance_transform_edt(prior, sampling=spacing) > _SURE
    fluid, matter, white = np.quantile(smooth[sure], _LEVELS)
    position = (smooth - fluid) / (matter - fluid)
    fat = smooth >= white + _FAT * (white - matter)
    allowed = _within(prior, _FAR, spacing)
    tissue = sure | ((position > _EDGE) & ~fat & allowed)
    tissue &= sure | ~_other_tissue(position, tissue, prior, sure, fat & allowed, spacing)
    deep = ndimage.distance_transform_edt(tissue, sampling=spacing) > _NECK
    pieces, _ = ndimage.label(deep)
    deep = np.isin(pieces, np.setdiff1d(pieces[sure], [0]))
    brain = tissue & _within(deep, _NECK + 0.5, spacing)
    # Closed: what no ball of that size can reach from outside. The faces of the picture are no walls.
    margin = [(int(np.ceil(_FOLD / step)) + 1,) * 2 for step in spacing]
    full = _within(np.pad(brain, margin), _FOLD, spacing)
    full = ndimage.distance_transform_edt(full, sampling=spacing) > _FOLD
    brain |= full[tuple(slice(before, -after) for before, after in margin)]
    return np.asarray(ndimage.binary_fill_holes(brain))


def _other_tissue(
    position: np.ndarray, tissue: np.ndarray, prior: np.ndarray, sure: np.ndarray, fat: np.ndarray, spacing: np.ndarray
) -> np.ndarray:
    """Which of the tissue is not brain, though it hangs on it.

    position  of grey values, 0 fluid and 1 grey matter; prior: the template's brain, sure: its inside
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
    marks[brain[pieces] & (marks == 0)] = 1  # what still hangs on at the brightest edge
    marks[fat & ~prior] = 2
    return np.asarray(flood(-position, marks, mask=tissue | (marks > 0)) == 2)


def _beyond(mask: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """How far a voxel's centre lies outside the mask's surface (mm), below 0 inside: finer than its voxels are."""
    out, inside = (ndimage.distance_transform_edt(each, sampling=spacing) for each in (~mask, mask))
    half = spacing.mean() / 2
    return np.where(mask, half - inside, out - half).astype(np.float32)


def _within(mask: np.ndarray, reach: float, spacing: np.ndarray) -> np.ndarray:
    """The mask and what is at most `reach` (mm) from it."""
    return np.asarray(ndimage.distance_transform_edt(~mask, sampling=spacing) <= reach)
