"""The brain in a head with its skull: the template's place says where it is, grey values where it ends."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError, naming
from ngbrain.image.align import Alignment, align, foreground
from ngbrain.image.bias import unbiased
from ngbrain.image.volume import Scan, Volume, mni152

_WANTED = "a T1 in which white matter is brighter than grey and fluid is dark, of a head upright as its header says, and whole"
_ALIKE = 0.45  # least likeness to the template; measured: T1s above 0.7, other contrasts, balls, noise and wrong headers below 0.3
_AROUND = 16  # voxels about the template's brain that are looked at
_SURE, _FAR = 6.0, 9.0  # mm inside the template's brain all is brain, mm outside it none
_LEVELS = (0.02, 0.40, 0.85)  # quantiles of the grey values in there that are near fluid, grey and white matter
_FAT = 0.6  # of the step from grey to white matter: what is brighter than white matter by more is no brain
_SMOOTH = 0.7  # mm, against noise
_NECK = 2.5  # mm: half the width of what is cut through between brain and other tissue
_FOLD = 9.0  # mm: half the width of the widest sulcus that is filled
_FILM = 1.5  # mm of fluid that goes with the brain


def strip(scan: Scan) -> np.ndarray:
    """The brain of a T1 with skull, fluid of the sulci included, as a mask (nx, ny, nz) over `scan.volume`.

    The MNI152 brain is laid into the head (`align`), and the field of the coil is taken out (`unbiased`). The template's
    inside tells how bright fluid, grey and white matter are. What is brighter than half way from fluid to grey matter
    and not much brighter than white is tissue: the brain where it hangs on to the inside by bridges wider than 5 mm, so
    that eyes, muscle and marrow stay out, and within 9 mm of the template. Sulci up to 18 mm wide are filled, and 1.5 mm
    of fluid around go with it. Nothing of this is learnt; the template is all that it knows.

    Raises:
        InputError: nothing in the picture is like the inside of the template's brain (correlation below 0.45), or it
            is next to nothing but background.
        MissingExtra: nilearn or SimpleITK is not installed.

    >>> rng = np.random.default_rng(1)
    >>> affine, noise = np.diag([4e-3, 4e-3, 4e-3, 1]), rng.random((50, 50, 50)).astype(np.float32)
    >>> strip(Scan(Volume(noise, affine), affine, (50, 50, 50), "noise.nii"))
    Traceback (most recent call last):
    ngbrain.errors.InputError: noise.nii: image is a picture whose largest bright part has 0.00 litres; wanted: at least 0.5, ...
    """
    head, template, found = scan.volume, mni152().volume, placed(scan)
    to = np.linalg.inv(template.affine) @ np.linalg.inv(found.affine) @ head.affine
    whole = (template.data != 0).astype(np.float32)
    prior = ndimage.affine_transform(whole, to[:3, :3], to[:3, 3], head.data.shape, order=1) > 0.5
    there = ndimage.find_objects(prior.astype(np.uint8))[0]
    box = tuple(slice(max(part.start - _AROUND, 0), part.stop + _AROUND) for part in there)
    even = unbiased(Volume(head.data[box], head.affine), prior[box])
    mask = np.zeros_like(prior)
    mask[box] = _refined(even.data, prior[box], 1e3 * head.spacing)
    return mask


def placed(scan: Scan) -> Alignment:
    """Where the template's brain lies in a scan, with a skull or without.

    A surface coil, three times as bright in front as behind, hides the likeness: where there is none, the coil's field is
    taken out of the whole head, and the template laid in again.

    Raises `InputError` as `strip` does.
    """
    head, template = scan.volume, mni152().volume
    with naming(scan.source):
        found = align(head, template)
        if found.likeness < _ALIKE:
            even = align(unbiased(head, foreground(head)), template)
            found = max(found, even, key=lambda place: place.likeness)
    if found.likeness < _ALIKE:
        what = f"a picture in which nothing is like a brain (correlation with the MNI152 template {found.likeness:.2f})"
        raise InputError("image", what, _WANTED, scan.source)
    return found


def _refined(grey: np.ndarray, prior: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """The brain by grey values, where `prior` is the template's; voxels of `spacing` (3,) in mm."""
    smooth = ndimage.gaussian_filter(grey, _SMOOTH / spacing)
    sure = ndimage.distance_transform_edt(prior, sampling=spacing) > _SURE
    fluid, matter, white = np.quantile(smooth[sure], _LEVELS)
    tissue = (smooth > (fluid + matter) / 2) & (smooth < white + _FAT * (white - matter))
    tissue = sure | (tissue & _within(prior, _FAR, spacing))
    deep = ndimage.distance_transform_edt(tissue, sampling=spacing) > _NECK
    pieces, _ = ndimage.label(deep)
    deep = np.isin(pieces, np.setdiff1d(pieces[sure], [0]))
    brain = tissue & _within(deep, _NECK + 0.5, spacing)
    # Closed: what no ball of that size can reach from outside. The faces of the picture are no walls.
    margin = [(int(np.ceil(_FOLD / step)) + 1,) * 2 for step in spacing]
    full = _within(np.pad(brain, margin), _FOLD, spacing)
    full = ndimage.distance_transform_edt(full, sampling=spacing) > _FOLD
    brain |= full[tuple(slice(before, -after) for before, after in margin)]
    return np.asarray(ndimage.binary_fill_holes(_within(brain, _FILM, spacing)))


def _within(mask: np.ndarray, reach: float, spacing: np.ndarray) -> np.ndarray:
    """The mask and what is at most `reach` (mm) from it."""
    return np.asarray(ndimage.distance_transform_edt(~mask, sampling=spacing) <= reach)
