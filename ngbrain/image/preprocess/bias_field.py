"""Bias-field estimation and correction (N4)."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import require
from ngbrain.image.read.resampling import border_value
from ngbrain.image.read.volume import Volume

_MEAN, _STEP = 4e-3, 6e-3  # m, width of the averaging, and spacing of the points of the fit
_ROUNDS = (50, 50)  # iterations with 1 and 2 spline spans per side; 4 spans (some 45 mm) remove anatomy
_LEAST = 0.025  # standard deviation of the field in white matter below which it may be anatomy
_BRIGHT = 0.65  # quantile of the grey values of a brain above which they are white matter


def estimate_bias_field(volume: Volume, mask: np.ndarray) -> Volume:
    """Estimate the bias field of a scan: a smooth factor with mean 1 over a mask.

    N4 by SimpleITK, on one thread, so that the same image gives the same field: splines are fitted repeatedly to the change of
    the log grey values by histogram sharpening. Outside the mask the splines are extrapolated, within the range of the field on
    the mask. Grey values are relative to the background; if the background is brighter than the dark end of the mask, zero is
    set below that.

    Parameters
    ----------
    volume : Volume
        The scan.
    mask : numpy.ndarray
        (nx, ny, nz) mask of the brain.

    Returns
    -------
    Volume
        float32 field.

    Raises
    ------
    MissingExtra
        SimpleITK is not installed.

    References
    ----------
    Tustison et al. 2010, doi:10.1109/TMI.2010.2046908.

    Examples
    --------
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
    inside = mask[box] & (grey > 0)  # for the logarithm
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
    whole = _resample(logs.astype(np.float64), at)
    whole = np.exp(whole - np.log(np.exp(whole[mask]).mean()))
    return Volume(whole.astype(np.float32), volume.affine)


def correct_bias_field(volume: Volume, mask: np.ndarray) -> Volume:
    """Divide a scan by its bias field, unless the field is nearly flat.

    The field is flat if it varies over white matter, the brightest third of the mask, by less than 2.5 % (standard deviation).
    Its correction would then remove anatomical contrast: 1.4 % in an average of many heads, in which bias fields cancel. The
    zero of the grey values (see `estimate_bias_field`) is kept, and so is an exactly constant background.

    Parameters
    ----------
    volume : Volume
        The scan.
    mask : numpy.ndarray
        (nx, ny, nz) mask of the brain.

    Returns
    -------
    Volume
        float32.

    Raises
    ------
    MissingExtra
        SimpleITK is not installed.
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
    """Grey value of the zero signal."""
    dark, middle = np.quantile(volume.data[mask], [0.001, 0.5])
    background, _ = border_value(volume)
    return float(background) if background <= dark else float(dark - 0.25 * (middle - dark))


def _resample(values: np.ndarray, at: list[np.ndarray]) -> np.ndarray:
    """Resample values by linear interpolation, one axis after another; constant beyond the ends."""
    for axis, where in enumerate(at):
        size = values.shape[axis]
        matrix = ndimage.map_coordinates(
            np.eye(size), np.meshgrid(np.arange(size), where.clip(0, size - 1), indexing="ij"), order=1
        )
        values = np.moveaxis(np.tensordot(values, matrix, (axis, 0)), -1, axis)
    return values
