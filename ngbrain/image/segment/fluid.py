"""Sulcal fluid and ventricles missing in label maps of other programs: FreeSurfer leaves sulci empty, tissue maps have one fluid
class.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.preprocess.registration import ALIKE, align
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.nifti import resample_labels
from ngbrain.image.read.template import mni152
from ngbrain.image.read.volume import Volume
from ngbrain.image.segment.ventricles import find_ventricles, ventricle_distance

FLUID, VENTRICLES, GREY, WHITE = "csf", "ventricles", "grey", "white"
REACH = 7.5e-3
"""Radius (m) of the closing, as of FreeSurfer's outer surface for the gyrification index (Schaer et al. 2008,
doi:10.1109/TMI.2007.903576)."""
_BRIGHT = {FLUID: 0.1, GREY: 0.6, WHITE: 1.0}
"""Approximate brightness of tissues in a T1."""
_FLUIDS = (FLUID, VENTRICLES, "fluid")


def label_sulcal_fluid(labels: LabelMap) -> tuple[LabelMap, float]:
    """Label the empty space between folds as `csf`.

    Empty voxels up to the hull (the closing by a ball of 7.5 mm) are filled where most of the adjacent labels are tissue; open
    space between folds that are covered by fluid is left. A map without a region called `grey` is returned unchanged.

    Parameters
    ----------
    labels : LabelMap
        Regions on voxels of any size and orientation.

    Returns
    -------
    labels : LabelMap
        The input itself if nothing is filled.
    ml : float
        Added volume (ml).

    Examples
    --------
    >>> data = np.zeros((20, 20, 20), int)
    >>> data[4:16, 4:16, 4:16] = 3
    >>> data[9:11, 4:16, 10:16] = 0  # 2 by 12 by 6 mm
    >>> labels = LabelMap(Volume(data, np.diag([1e-3, 1e-3, 1e-3, 1])), {3: "grey"})
    >>> filled, ml = label_sulcal_fluid(labels)
    >>> filled.regions, round(ml, 2)
    (('grey', 'csf'), 0.14)
    """
    if not any(name.startswith(GREY) for name in labels.regions):
        return labels, 0.0
    every = labels.volume.data
    box = ndimage.find_objects((every > 0).astype(np.uint8))[0]
    data = every[box]  # the hull stays within the bounding box
    empty = _hull(data > 0, labels.volume.spacing) & (data == 0)
    fluid = [number for number, name in labels.names.items() if name.startswith(_FLUIDS)]
    pockets, count = ndimage.label(empty)
    tissue, wet = (
        _border_faces(pockets, side, count) for side in ((data > 0) & ~np.isin(data, fluid), np.isin(data, fluid))
    )
    chosen = tissue > wet
    chosen[0] = False
    filled = chosen[pockets]
    if not filled.any():
        return labels, 0.0
    own = [number for number in fluid if labels.names[number] == FLUID]
    number = own[0] if own else max(int(data.max()), *labels.names) + 1
    new = every.astype(np.int32)
    new[box][filled] = number
    found = LabelMap(Volume(new, labels.volume.affine), {**labels.names, number: FLUID})
    return found, float(filled.sum()) * labels.volume.voxel_volume * 1e6


def label_ventricles(labels: LabelMap) -> tuple[LabelMap, float]:
    """Separate the lateral ventricles from other fluid.

    They are found by position and by the white matter around them (`ngbrain.image.segment.ventricles`), because tissue maps of
    SPM, CAT and FAST have one class for all fluid. The position follows from registering the MNI152 template to an image in
    which the tissues are as bright as in a T1.

    Parameters
    ----------
    labels : LabelMap
        Regions on voxels of any size and orientation.

    Returns
    -------
    labels : LabelMap
        The input itself if it has ventricles, lacks `csf`, `grey` or `white`, is unlike a brain, or no ventricles are found.
    ml : float
        Volume (ml) of the ventricles found.
    """
    if VENTRICLES in labels.regions or not set(_BRIGHT) <= set(labels.regions):
        return labels, 0.0
    upright = labels.resample_to_ras()
    data, place = np.pad(upright.volume.data, 1), upright.volume.affine.copy()
    place[:3, 3] -= place[:3, :3].sum(axis=1)
    tissue = {name: data == upright.regions.index(name) + 1 for name in _BRIGHT}
    picture = sum(brightness * tissue[name] for name, brightness in _BRIGHT.items())
    try:
        template = align(Volume(np.asarray(picture, np.float32), place), mni152().volume)
    except InputError:
        return labels, 0.0
    if template.likeness < ALIKE:
        return labels, 0.0
    near = ventricle_distance(place, template.affine, data.shape)
    found = Volume(find_ventricles(data > 0, tissue[FLUID], tissue[WHITE], near).astype(np.uint8), place)
    old = labels.volume
    own = [number for number, name in labels.names.items() if name == FLUID]
    shape = (old.data.shape[0], old.data.shape[1], old.data.shape[2])
    inside = (resample_labels(found, old.affine, shape).data > 0) & np.isin(old.data, own)
    if not inside.any():
        return labels, 0.0
    number = max(int(old.data.max()), *labels.names) + 1
    new = np.where(inside, number, old.data).astype(np.int32)
    ml = float(inside.sum()) * old.voxel_volume * 1e6
    return LabelMap(Volume(new, old.affine), {**labels.names, number: VENTRICLES}), ml


def _hull(mask: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Morphological closing of a mask by a ball."""
    pad = np.ceil(REACH / spacing).astype(int) + 1
    whole = np.pad(mask, [(n, n) for n in pad])
    reached = ndimage.distance_transform_edt(~whole, spacing) <= REACH
    depth = ndimage.distance_transform_edt(reached, spacing)
    return np.asarray(depth[tuple(slice(n, -n) for n in pad)] > REACH)


def _border_faces(pockets: np.ndarray, side: np.ndarray, count: int) -> np.ndarray:
    """Number of faces (count + 1,) of each component that border on the mask `side`."""
    faces = np.zeros(count + 1, int)
    for axis in range(3):
        low, high = (
            tuple(part if k == axis else slice(None) for k in range(3)) for part in (slice(-1), slice(1, None))
        )
        for mine, other in ((low, high), (high, low)):
            faces += np.bincount(pockets[mine][side[other]], minlength=count + 1)
    return faces
