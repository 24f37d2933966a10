"""Label propagation from an atlas, by registration of its template."""

from __future__ import annotations

from typing import Any

import numpy as np

from ngbrain.errors import InputError, nearest, require
from ngbrain.image.preprocess.registration import ALIKE, INSIDE, align, correlation_inside
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.resampling import reorient_to_ras
from ngbrain.image.read.volume import Volume

METHODS = ("affine", "demons")
_LEVELS = ((4, 60), (2, 60))  # spacing (mm) of the displacement field, and iterations, coarse to fine
_SMOOTH = 1.2  # smoothing of the field, in its spacing


def propagate_labels(labels: LabelMap, template: Volume, brain: Volume, method: str = "demons") -> LabelMap:
    """Propagate the labels of an atlas to the voxels of a brain, by nearest-neighbour interpolation.

    An affine map (`ngbrain.image.preprocess.registration`) aligns the template with the brain. "demons" adds a non-linear
    registration by SimpleITK: symmetric forces on histogram-matched grey values, with a displacement field that is smoothed
    after each step.

    Parameters
    ----------
    labels : LabelMap
        Labels of the atlas in the space of the template, on any voxels.
    template : Volume
        T1 brain that the atlas was drawn on, with an exact background of 0.
    brain : Volume
        Skull-stripped T1 with a background of 0, axes right, front, up, voxels of 1 mm.
    method : str, optional
        "affine" or "demons".

    Returns
    -------
    LabelMap

    Raises
    ------
    InputError
        The method is unknown, or the two images are not alike (likeness below 0.4).
    MissingExtra
        SimpleITK or nibabel is not installed.

    References
    ----------
    Thirion 1998, doi:10.1016/S1361-8415(98)80022-4; Vercauteren et al. 2009, doi:10.1016/j.neuroimage.2008.10.040.

    Examples
    --------
    >>> from ngbrain.image.read.template import mni152
    >>> scan = mni152().volume
    >>> halves = LabelMap(Volume((scan.data > 0) * (1 + (np.indices(scan.data.shape)[0] > 98)), scan.affine), {1: "l", 2: "r"})
    >>> moved = propagate_labels(halves, scan, scan, "affine")
    >>> f"{(moved.volume.data == halves.volume.data).mean():.2f}"
    '1.00'
    """
    if method not in METHODS:
        raise InputError("method", repr(method), nearest(method, METHODS))
    template = reorient_to_ras(template)
    place = align(brain, template)
    inside = correlation_inside(brain, template, place.affine)
    if place.likeness < ALIKE or inside < INSIDE:
        what = f"unlike the brain (correlation {place.likeness:.2f}, inside {inside:.2f})"
        raise InputError("template", what, "T1s of two brains, without skulls")
    sitk = require("SimpleITK", "mri")
    atlas = reorient_to_ras(labels.volume)
    fixed, to = _image(sitk, brain.data, brain.affine), np.linalg.inv(place.affine)
    affine = sitk.AffineTransform(3)
    affine.SetMatrix(to[:3, :3].ravel().tolist())
    affine.SetTranslation((1e3 * to[:3, 3]).tolist())
    way = sitk.CompositeTransform([affine])
    if method == "demons":
        moving = sitk.Resample(_image(sitk, template.data, template.affine), fixed, affine, sitk.sitkLinear, 0.0)
        way.AddTransform(sitk.DisplacementFieldTransform(_field(sitk, fixed, moving)))
    numbers = _image(sitk, atlas.data.astype(np.int32), atlas.affine)
    found = sitk.GetArrayFromImage(sitk.Resample(numbers, fixed, way, sitk.sitkNearestNeighbor, 0)).T
    return LabelMap(Volume(np.ascontiguousarray(found), brain.affine), labels.names)


def _image(sitk: Any, data: np.ndarray, affine: np.ndarray) -> Any:
    """Volume as a SimpleITK image, in mm."""
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    image = sitk.GetImageFromArray(np.ascontiguousarray(data.T))
    image.SetSpacing((1e3 * spacing).tolist())
    image.SetOrigin((1e3 * affine[:3, 3]).tolist())
    image.SetDirection((affine[:3, :3] / spacing).ravel().tolist())
    return image


def _field(sitk: Any, fixed: Any, moving: Any) -> Any:
    """Displacement (mm) from points of `fixed` to the corresponding points of `moving`."""
    moving = sitk.HistogramMatching(moving, fixed, 256, 15, True)
    field = None
    for step, rounds in _LEVELS:
        shrink = [max(round(step / each), 1) for each in fixed.GetSpacing()]
        one, other = (sitk.Shrink(sitk.SmoothingRecursiveGaussian(each, step / 2), shrink) for each in (fixed, moving))
        demons = sitk.FastSymmetricForcesDemonsRegistrationFilter()
        demons.SetNumberOfThreads(1)
        demons.SetNumberOfIterations(rounds)
        demons.SetStandardDeviations(_SMOOTH)
        demons.SetSmoothUpdateField(True)
        demons.SetUpdateFieldStandardDeviations(1.0)
        if field is None:
            field = demons.Execute(one, other)
        else:
            field = demons.Execute(one, other, sitk.Resample(field, one, sitk.Transform(), sitk.sitkLinear))
    return sitk.Resample(field, fixed, sitk.Transform(), sitk.sitkLinear)
