"""The brain in a head with its skull: the template's place says where it is, grey values where it ends."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.align import align
from ngbrain.image.bias import unbiased
from ngbrain.image.volume import Scan, Volume, mni152

_WANTED = "a T1 of a head, or of a brain taken out of it, in which white matter is brighter than grey and fluid dark"
_ALIKE = 0.5  # least correlation with the template
_AROUND = 14.0  # mm about the template's brain that are looked at
_SURE, _FAR = 6.0, 9.0  # mm inside the template's brain all is brain, mm outside it none
_NECK = 2.5  # mm: half the width of what is cut through between brain and other tissue
_FOLD = 9.0  # mm: half the width of the widest sulcus that is filled
_FILM = 1.5  # mm of fluid that goes with the brain


def strip(scan: Scan) -> np.ndarray:
    """The brain of a T1 with skull, fluid of the sulci included, as a mask (nx, ny, nz) over `scan.volume`.

    The MNI152 brain is laid into the head (`align`) and tells, by its inside, how bright fluid, grey and white matter
    are. Tissue is what is brighter than half way from fluid to grey matter and no brighter than white. It is parted
    from eyes, muscle and marrow where the bridge to them is thinner than 5 mm, or beyond the template's brain by 9 mm;
    what is left is closed over its sulci and takes in 1 mm of fluid. The field of the coil is estimated first.

    Raises:
        InputError: nothing in the picture is like the template: the best correlation is below 0.5.
        MissingExtra: nilearn or SimpleITK is not installed.
    """
    head, template = scan.volume, mni152().volume
    found = align(head, template)
    if found.correlation < _ALIKE:
        what = f"a picture like no brain: its best correlation with the MNI152 template is {found.correlation:.2f}"
        raise InputError("image", what, _WANTED, scan.source)
    to = np.linalg.inv(template.affine) @ np.linalg.inv(found.affine) @ head.affine
    prior = template_on(template, to, head.data.shape)
    mask = np.zeros(prior.shape, bool)
    wide = [slice(max(part.start - 16, 0), part.stop + 16) for part in ndimage.find_objects(prior.astype(np.uint8))[0]]
    box = tuple(wide)
    corner = head.to_world(np.array([[part.start for part in box]]))[0]
    affine = head.affine.copy()
    affine[:3, 3] = corner
    spacing = 1e3 * head.spacing
    even = unbiased(Volume(head.data[box], affine), prior[box])
    mask[box] = _refined(even.data, prior[box], spacing)
    return mask


def template_on(template: Volume, to: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Where on a grid the brain of a template is; `to` (4, 4) takes voxel indices of the grid to the template's."""
    brain = ndimage.binary_fill_holes(template.data != 0).astype(np.float32)
    return np.asarray(ndimage.affine_transform(brain, to[:3, :3], to[:3, 3], shape, order=1) > 0.5)


def _refined(grey: np.ndarray, prior: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """The mask from grey values, given the template's brain."""
    inner = ndimage.distance_transform_edt(prior, sampling=spacing)
    outer = ndimage.distance_transform_edt(~prior, sampling=spacing)
    smooth = ndimage.gaussian_filter(grey, 0.7 / spacing)
    fluid, matter, white = _levels(smooth[inner > 5])
    tissue = (smooth > (fluid + matter) / 2) & (smooth < white + 0.6 * (white - matter)) & (outer < _FAR)
    tissue |= inner > _SURE
    core = _opened(tissue, _NECK, spacing, inner > _SURE)
    brain = _closed(core, _FOLD, spacing)
    brain |= ndimage.distance_transform_edt(~brain, sampling=spacing) <= _FILM
    return ndimage.binary_fill_holes(brain)


def _levels(values: np.ndarray) -> tuple[float, float, float]:
    return tuple(np.quantile(values, (0.02, 0.40, 0.85)))


def _opened(mask, radius, spacing, sure):
    """What is left of a mask without parts narrower than twice the radius, and hangs together with what is sure."""
    deep = ndimage.distance_transform_edt(mask, sampling=spacing) > radius
    pieces, _ = ndimage.label(deep)
    keep = np.unique(pieces[sure & deep])
    deep = np.isin(pieces, keep[keep > 0])
    return mask & (ndimage.distance_transform_edt(~deep, sampling=spacing) <= radius + 0.5)


def _closed(mask, radius, spacing):
    pad = int(np.ceil(radius / spacing.min())) + 1
    grown = ndimage.distance_transform_edt(~np.pad(mask, pad), sampling=spacing) <= radius
    back = ndimage.distance_transform_edt(grown, sampling=spacing) > radius
    return back[(slice(pad, -pad),) * 3] | mask
