"""Deep grey matter (thalamus, caudate, putamen and pallidum), by position and by edges of the grey values."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ngbrain.errors import require
from ngbrain.image.preprocess import mni_landmarks

_EDGE = 0.7  # mm, over which grey values are smoothed for their edges
_WITHIN = np.array([[-45.0, -60.0, -45.0], [45.0, 60.0, 45.0]])  # mm of the template, around all nuclei


def segment_nuclei(grey: np.ndarray, matter: np.ndarray, to: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Segment the four nuclei of both sides.

    They are nearly as bright as white matter, so that grey values alone label them as white. Watersheds from their centres,
    given by the template, and from their surroundings meet at the edges between them (Beucher & Meyer 1993).

    Parameters
    ----------
    grey : numpy.ndarray
        (nx, ny, nz) grey values after bias-field correction.
    matter : numpy.ndarray
        (nx, ny, nz) mask of grey and white matter.
    to : numpy.ndarray
        (4, 4), from voxel indices to points of the MNI152 template in mm.
    size : numpy.ndarray
        (3,) voxel size in mm.

    Returns
    -------
    numpy.ndarray
        (nx, ny, nz) mask.
    """
    flood = require("skimage.segmentation", "mri").watershed
    found = np.zeros(grey.shape, bool)
    ends = _WITHIN[np.array(list(np.ndindex(2, 2, 2))), range(3)]
    ends = (ends - to[:3, 3]) @ np.linalg.inv(to[:3, :3]).T
    low, high = np.floor(ends.min(axis=0)).astype(int), np.ceil(ends.max(axis=0)).astype(int) + 1
    box = tuple(slice(max(a, 0), max(b, 0)) for a, b in zip(low, high, strict=True))
    matter = matter[box]
    if not matter.any():
        return found
    points = (np.argwhere(matter) + [axis.start for axis in box]) @ to[:3, :3].T + to[:3, 3]
    marks, far = np.zeros(len(points), np.uint8), np.ones(len(points), bool)
    for number, nucleus in enumerate(mni_landmarks.NUCLEI.values(), 2):
        radius = nucleus.radius(points)
        marks[radius < nucleus.core] = number
        far &= radius > nucleus.reach
    marks[far] = 1
    everywhere = np.ones(matter.shape, np.uint8)
    everywhere[matter] = marks
    edges = ndimage.gaussian_gradient_magnitude(grey[box].astype(np.float32), _EDGE / size)
    found[box] = ndimage.binary_opening(flood(edges, everywhere) > 1)
    return found
