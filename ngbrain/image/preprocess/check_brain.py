"""Check that a scan is a complete, skull-stripped brain."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.read.resampling import border_value
from ngbrain.image.read.volume import Scan

_WANTED = "a brain-extracted T1 (e.g. from HD-BET, SynthStrip or BET), exactly constant around the brain, of at most 2.2 litres"
_MOST = 2.2  # litres
_LITRE = 1e-3  # m³
_TOP = 70e-3  # m below the vertex: without neck and face, a head consists of concentric layers
_DEEPEST = 35  # mm
_CUT = 500e-6  # m²; the side of a complete brain has up to 250 mm² within 1 mm, the cut brain stem 150 mm²
_SIDES = (("left", "right"), ("back", "front"), ("bottom", "top"))


def check_extracted(scan: Scan) -> np.ndarray:
    """Brain mask (nx, ny, nz) over `scan.volume` of a skull-stripped scan.

    It is the largest connected component that differs from the background, without specks and with its holes filled. The
    background is the most common value of the border.

    Raises
    ------
    InputError
        The skull is still there: the background is not exactly constant, the volume exceeds 2.2 litres, or there is a dark band
        (bone) beneath a bright one (scalp). Or the field of view cuts the brain, or it has less than 0.7 litres.

    Examples
    --------
    >>> from ngbrain.image import mni152
    >>> scan = mni152()
    >>> f"{check_extracted(scan).sum() * scan.volume.voxel_volume * 1e3:.2f} litres"
    '1.89 litres'
    """
    mask, more = foreground_mask(scan)
    if more:
        raise InputError("image", more, _WANTED, scan.source)
    check_whole(scan, mask)
    return mask


def foreground_mask(scan: Scan) -> tuple[np.ndarray, str]:
    """Mask (nx, ny, nz) of what differs from the background, and the reason why it is not a skull-stripped brain: "" if there is
    none.

    >>> from ngbrain.image import mni152
    >>> foreground_mask(mni152())[1]
    ''
    """
    volume = scan.volume
    background, share = border_value(volume)
    other = volume.data != background
    if share < 0.5:
        of_border = f"its commonest value, {background:g}, has {100 * share:.0f} % of the border"
        return other, f"without a constant background: {of_border}"
    mask = np.zeros_like(other)
    if other.any():
        box = ndimage.find_objects(other.astype(np.uint8))[0]
        if _has_dark_band(volume.data[box], other[box], background, volume.spacing):
            return other, "a head with its skull"
        mask[box] = _largest(other[box])
    litres = mask.sum() * volume.voxel_volume / _LITRE
    return mask, f"a head of {litres:.2f} litres" if litres > _MOST else ""


def check_whole(scan: Scan, mask: np.ndarray) -> None:
    """Check that a brain is complete.

    Parameters
    ----------
    scan : Scan
        The scan.
    mask : numpy.ndarray
        (nx, ny, nz) mask of the brain.

    Raises
    ------
    InputError
        The field of view cuts the brain, or it has less than 0.7 litres.
    """
    litres = mask.sum() * scan.volume.voxel_volume / _LITRE
    if sides := _cut_sides(scan, mask):
        found = f"cut off at the {' and the '.join(sides)} of the brain"
        raise InputError("image", found, "the whole brain in the field of view", scan.source)
    if litres < 0.7:
        raise InputError("image", f"a brain of {litres:.2f} litres", "a whole adult brain, at least 0.7", scan.source)


def _has_dark_band(data: np.ndarray, other: np.ndarray, background: float, spacing: np.ndarray) -> bool:
    """Whether grey values fall and rise again towards the inside, as from scalp through bone to brain."""
    solid = ndimage.binary_opening(other)
    slices = np.flatnonzero(solid.sum(axis=(0, 1)) * spacing[0] * spacing[1] > 100e-6)
    if not len(slices):
        return False
    top = slice(max(slices[-1] - round(_TOP / spacing[2]), 0), slices[-1] + 1)
    # Slice by slice: bone that was set to the background is connected to the outside only below.
    inside = np.stack([ndimage.binary_fill_holes(flat) for flat in np.moveaxis(solid[:, :, top], 2, 0)], axis=2)
    grey = data[:, :, top]
    around = np.pad(inside, ((1, 1), (1, 1), (0, 1)))  # not below, where the head continues
    depth = ndimage.distance_transform_edt(around, sampling=1e3 * spacing)[1:-1, 1:-1, :-1]
    shell = np.ceil(depth).astype(int)  # 1: less than 1 mm deep
    shells = range(1, min(_DEEPEST, shell.max()) + 1)
    profile = np.array([np.median(grey[shell == s]) for s in shells if (shell == s).any()])
    profile -= min(background, np.percentile(grey[inside], 1))
    brightest_without = np.maximum.accumulate(profile)
    brightest_within = np.maximum.accumulate(profile[::-1])[::-1]
    # Heads: below 0.3, with air and bone cut off at any grey value; brains, with up to 4 mm too much left: above 0.9.
    return bool((profile < 0.7 * np.minimum(brightest_without, brightest_within)).any())


def _largest(other: np.ndarray) -> np.ndarray:
    """The largest connected component after an opening that removes specks and threads, with its holes filled."""
    pieces, count = ndimage.label(ndimage.binary_opening(other))
    if not count:
        return np.zeros_like(other)
    piece = pieces == np.bincount(pieces.ravel())[1:].argmax() + 1
    return ndimage.binary_fill_holes(ndimage.binary_dilation(piece) & other)


def _cut_sides(scan: Scan, mask: np.ndarray) -> list[str]:
    """Names of the sides where the brain touches the field of view of the file over more than `_CUT`."""
    step = scan.volume.spacing.mean()
    to_file = np.linalg.solve(scan.file_affine, scan.volume.affine)
    stored = to_file[:3, :3] @ np.argwhere(mask).T + to_file[:3, 3:]
    names = []
    for axis, size in enumerate(scan.file_shape):
        along = scan.file_affine[:3, axis]
        world = np.abs(along).argmax()
        for beyond, way in ((stored[axis] + 0.5, -1), (size - 0.5 - stored[axis], 1)):
            # The number of voxels within one step of the face gives the area.
            if (beyond * np.linalg.norm(along) < step).sum() * step**2 > _CUT:
                names.append(_SIDES[world][int(way * along[world] > 0)])
    return names
