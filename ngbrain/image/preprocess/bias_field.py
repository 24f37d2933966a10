"""The slow field that a receiving coil multiplies a scan with: estimated, and divided out where there is one."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import require
from ngbrain.image.read.volume import Volume, border_value

_MEAN, _STEP = 4e-3, 6e-3  # m, over which grey values are averaged, and between the points on which the field is fitted
_ROUNDS = (50, 50)  # with 1 and 2 spans of splines to a side; 4 (some 45 mm) take out anatomy
_LEAST = 0.025  # standard deviation of the field in white matter, below which it may as well be anatomy
_BRIGHT = 0.65  # quantile of the grey values in a brain above which it is white matter


def estimate_bias_field(volume: Volume, mask: np.ndarray) -> Volume:
    """The smooth factor, float32 of mean 1 over `mask` (nx, ny, nz), by which the grey values there are too bright.

    N4: splines fitted again and again to what sharpening the histogram of log grey values moves (Tustison et al. 2010,
    doi:10.1109/TMI.2010.2046908), by SimpleITK on one thread, so that the same picture gives the same field.
    Beyond the mask the field goes on as the splines do, held between its extremes on the mask. The zero of the grey
    values is that of the background; if the background is brighter than the mask's dark end, it is taken below that.

    Raises:
        MissingExtra: SimpleITK is not installed.

    >>> at = np.indices((64, 64, 64)) - 31.5
    >>> inside, white = np.linalg.norm(at, axis=0) < 30, np.linalg.norm(at, axis=0) < 24
    >>> true = 1 + 0.2 * np.sin(at[0] / 25)
    >>> scan = Volume((inside * (0.6 + 0.4 * white) * true).astype(np.float32), np.diag([1e-3, 1e-3, 1e-3, 1]))
    >>> left = estimate_bias_field(scan, inside).data / true
    >>> bool(left[inside].std() / left[inside].mean() < 0.03 < true[inside].std())
    True
    """
    sitk = require("SimpleITK", "mri")
    box = tuple(slice(max(axis.start - 2, 0), axis.stop + 2) for axis in ndimage.find_objects(mask.astype(np.uint8))[0])
    grey = (volume.data[box] - _zero(volume, mask)).astype(np.float32)
    inside = mask[box] & (grey > 0)  # their logarithm is taken
    width, shrink = (max(round(each / float(volume.spacing.mean())), 1) for each in (_MEAN, _STEP))
    shrunk = (slice(width // 2, None, shrink),) * 3
    smooth = ndimage.uniform_filter(np.where(inside, grey, 0), width)
    share = ndimage.uniform_filter(inside.astype(np.float32), width)
    few = share[shrunk] > 0.5
    image = sitk.GetImageFromArray(np.where(few, smooth[shrunk] / np.maximum(share[shrunk], 0.5), 0))
    image.SetSpacing([float(s) for s in 1e3 * shrink * volume.spacing[::-1]])
    where = sitk.GetImageFromArray(few.astype(np.uint8))
    where.CopyInformation(image)
    n4 = sitk.N4BiasFieldCorrectionImageFilter()
    n4.SetNumberOfThreads(1)
    n4.SetNumberOfWorkUnits(1)
    n4.SetMaximumNumberOfIterations(_ROUNDS)
    n4.Execute(image, where)
    logs = sitk.GetArrayFromImage(n4.GetLogBiasFieldAsImage(image))
    logs = logs.clip(logs[few].min(), logs[few].max())
    # uniform_filter of an even size is centred half a voxel below its index.
    first = width // 2 - (0.5 if width % 2 == 0 else 0.0)
    at = [(np.arange(size) - part.start - first) / shrink for size, part in zip(volume.data.shape, box, strict=True)]
    whole = _resampled(logs.astype(np.float64), at)
    whole = np.exp(whole - np.log(np.exp(whole[mask]).mean()))
    return Volume(whole.astype(np.float32), volume.affine)


def correct_bias_field(volume: Volume, mask: np.ndarray) -> Volume:
    """The picture divided by its `estimate_bias_field`, or as it is where that field is next to flat: a picture of float32.

    Flat: over white matter, the brightest third of the mask, it varies by less than 2.5 % (standard deviation). What it
    would take out then is contrast of anatomy: 1.4 % of an average of many heads, in which fields cancel.
    The zero of grey values, see `estimate_bias_field`, stays where it is, and so does an exactly constant background.

    Raises:
        MissingExtra: SimpleITK is not installed.
    """
    field = estimate_bias_field(volume, mask).data
    flat = volume.data / field
    white = mask & (flat >= np.quantile(flat[mask], _BRIGHT))
    if field[white].std() < _LEAST * field[white].mean():
        return volume
    zero, (background, _) = _zero(volume, mask), border_value(volume)
    data = np.where(volume.data == background, background, (volume.data - zero) / field + zero)
    return Volume(data.astype(np.float32), volume.affine)


def _zero(volume: Volume, mask: np.ndarray) -> float:
    """The grey value of nothing."""
    dark, middle = np.quantile(volume.data[mask], [0.001, 0.5])
    background, _ = border_value(volume)
    return float(background) if background <= dark else float(dark - 0.25 * (middle - dark))


def _resampled(values: np.ndarray, at: list[np.ndarray]) -> np.ndarray:
    """Values on a grid, by cubic splines one axis after another; beyond the ends the end's value."""
    for axis, where in enumerate(at):
        size = values.shape[axis]
        matrix = ndimage.map_coordinates(
            np.eye(size), np.meshgrid(np.arange(size), where.clip(0, size - 1), indexing="ij"), order=1
        )
        values = np.moveaxis(np.tensordot(values, matrix, (axis, 0)), -1, axis)
    return values
