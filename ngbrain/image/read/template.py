"""The MNI152 template: the average brain that nilearn ships, and its tissue maps."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ngbrain.errors import require
from ngbrain.image.read.resampling import resample_to_ras
from ngbrain.image.read.volume import Scan, Volume


def mni152() -> Scan:
    """The average brain that nilearn ships: ICBM 2009a nonlinear symmetric, 1 mm, skull-stripped.

    nilearn divides its 8-bit values by the largest, so that they range from 0 to 1 in 225 steps; the background is exactly 0.
    The brain stem ends at the lowest slice.

    Raises
    ------
    MissingExtra
        nilearn is not installed.

    Examples
    --------
    >>> mni152().volume.data.shape
    (197, 233, 189)
    """
    template = _mni152()
    return replace(template, volume=Volume(template.volume.data.copy(), template.volume.affine.copy()))


def template_map(name: str) -> tuple[np.ndarray, np.ndarray]:
    """A map of the MNI152 template that nilearn ships, as its loaders read it.

    The file is read directly, as importing nilearn's loaders (with scikit-learn and pandas) takes longer.

    Parameters
    ----------
    name : str
        "t1", or "gm" or "wm" for the share of grey or white matter.

    Returns
    -------
    data, affine : numpy.ndarray
        float32, divided by the maximum; (4, 4), from voxels to m.

    Raises
    ------
    MissingExtra
        nilearn is not installed.
    """
    folder = Path(str(require("nilearn", "mri").__file__)).parent / "datasets" / "data"
    image = require("nibabel", "mri").load(folder / f"mni_icbm152_{name}_tal_nlin_sym_09a_converted.nii.gz")
    data = np.asarray(image.dataobj).astype(np.float32)
    return data / data.max(), np.diag([1e-3, 1e-3, 1e-3, 1]) @ image.affine


@lru_cache(maxsize=1)
def _mni152() -> Scan:
    data, affine = template_map("t1")
    name = "MNI152 T1 (average of 152 people, brain-extracted)"
    return Scan(resample_to_ras(Volume(data, affine)), affine, data.shape, name)
