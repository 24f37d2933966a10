"""Label maps with known volumes, areas and topology."""

import numpy as np

from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume

MM = 1e-3


def grid(half, spacing=1.0):
    """Centres (n, n, n, 3) of voxels (mm) around the origin, and the affine to m."""
    n = int(np.ceil(half / spacing))
    axis = spacing * np.arange(-n, n + 1)
    affine = np.diag([MM * spacing] * 3 + [1.0])
    affine[:3, 3] = MM * axis[0]
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1), affine


def nested(radii=(40.0, 30.0, 12.0), names=("grey", "white", "ventricles"), spacing=1.0, centre=(0.0, 0.0, 0.0)):
    """Balls in balls, the largest first."""
    points, affine = grid(radii[0] + 6, spacing)
    away = np.linalg.norm(points - np.array(centre), axis=-1)
    numbers = sum((away < r).astype(np.int32) for r in radii)
    return LabelMap(Volume(numbers, affine), dict(enumerate(names, 1)))


def turned(labels, matrix):
    """The same voxels in a rotated scanner: affine times a rotation about the origin."""
    affine = np.eye(4)
    affine[:3, :3] = matrix
    return LabelMap(Volume(labels.volume.data, affine @ labels.volume.affine), labels.names)
