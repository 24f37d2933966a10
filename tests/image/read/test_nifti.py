"""Label maps on the grid of a file: nothing is shifted, for any offset between voxel centres."""

import numpy as np
import pytest
from colin import dice
from resampled_scans import rotation

from ngbrain.image.read.nifti import resample_labels
from ngbrain.image.read.volume import Volume

MM = np.diag([1e-3, 1e-3, 1e-3, 1.0])


def ball(affine, shape, middle):
    """Two shells around a point (m), by voxel centres: label 2 within 8 mm, 1 within 12 mm."""
    points = Volume(np.zeros(shape), affine).to_world(np.indices(shape).reshape(3, -1).T)
    away = np.linalg.norm(points - middle, axis=1).reshape(shape)
    return np.select([away < 8e-3, away < 12e-3], [2, 1], 0).astype(np.uint8)


@pytest.mark.parametrize("edge, turn", [(2e-3, 0), (0.7e-3, 0), (1e-3, 0), (1.3e-3, 25)])
def test_labels_stay_where_they_are(edge, turn):
    middle = np.array([20e-3, 20e-3, 20e-3])
    labels = Volume(ball(MM, (41, 41, 41), middle), MM)
    affine = np.diag([edge, edge, edge, 1.0])
    affine[:3, :3] = rotation(turn, np.array([0.0, 0.6, 0.8])) @ affine[:3, :3]
    n = int(56e-3 / edge)
    affine[:3, 3] = middle - affine[:3, :3] @ np.full(3, n / 2) + 0.45e-3  # between voxels of 1 mm
    found = resample_labels(labels, affine, (n, n, n))
    assert found.data.dtype == np.uint8 and set(np.unique(found.data)) == {0, 1, 2}
    truth = ball(affine, found.data.shape, middle)
    for label in (1, 2):
        here = found.to_world(np.argwhere(found.data == label)).mean(axis=0)
        assert np.abs(here - middle).max() < 0.25e-3, label
        assert dice(found.data == label, truth == label) > 0.9, label


def test_voxels_on_voxels_keep_their_labels_and_beyond_the_map_is_nothing():
    rng = np.random.default_rng(0)
    labels = Volume(rng.integers(0, 5, (6, 7, 8)).astype(np.int32), MM)
    affine = np.array([[0, -1, 0, 6], [0, 0, 1, 0], [1, 0, 0, -2], [0, 0, 0, 1.0]])
    affine[:3] *= 1e-3
    affine[:3, 3] += 1e-5  # as rounded headers have it
    found = resample_labels(labels, affine, (10, 7, 7)).data
    inside = found[2:, :, :]
    for i, j, k in np.ndindex(*inside.shape):
        x, y, z = 6 - j, k, i
        wanted = labels.data[x, y, z] if 0 <= x < 6 and y < 7 and z < 8 else 0
        assert inside[i, j, k] == wanted
    assert not found[:2].any()
