"""The template in a head that nods, with neck and shoulders. Naive: from one start it fits a wrong place. Ours: finds it."""

import numpy as np
import pytest
from resampled_scans import rotation
from scipy import ndimage
from scipy.optimize import minimize

from ngbrain.image import Volume, mni152
from ngbrain.image.preprocess.registration import align

STEP = 4e-3  # m


@pytest.fixture(scope="module")
def template():
    """Grey values of MNI152 on voxels of 4 mm."""
    volume = mni152().volume
    data = ndimage.zoom(volume.data, 0.25, order=1, grid_mode=True, mode="nearest")
    affine = volume.affine @ np.diag(np.append(np.array(volume.data.shape) / data.shape, 1.0))
    return Volume(data.astype(np.float32), affine)


@pytest.fixture(scope="module")
def truth():
    """From the template to a head of 0.9 times its size, nodding by 25 degrees, off the middle of the scanner."""
    place = np.eye(4)
    place[:3, :3] = 0.9 * rotation(-25.0, np.array([1.0, 0.0, 0.0]))
    place[:3, 3] = [0.012, -0.03, 0.05]
    return place


@pytest.fixture(scope="module")
def head(template, truth):
    """The brain with bone and scalp around it, on a neck and shoulders that are as bright, in the field of a coil."""
    shape = (64, 72, 84)
    affine = np.diag([STEP, STEP, STEP, 1.0])
    affine[:3, 3] = -STEP * np.array([32, 36, 54])
    points = (np.indices(shape).reshape(3, -1).T @ affine[:3, :3].T + affine[:3, 3]) @ np.linalg.inv(truth)[:3, :3].T
    points += np.linalg.inv(truth)[:3, 3]
    brain = template.interpolate(points).reshape(shape)
    away = 4 * ndimage.distance_transform_edt(brain < 0.15)
    scalp, (x, y, z) = (away > 9) & (away <= 17), 1e3 * points.T.reshape(3, *shape)
    neck = (np.hypot(x, y + 40) < 60) & (z < -60) & (away > 17)
    shoulders = (z < -110) & (np.hypot(x / 2, y + 40) < 75)
    picture = np.where(scalp | neck | shoulders, 0.9, brain)
    picture = picture * np.exp(-(affine[2, 2] * np.arange(shape[2]) + affine[2, 3]) / 0.15)  # brightest at the neck
    return Volume((picture + np.random.default_rng(2).normal(0, 0.03, shape)).astype(np.float32), affine)


def off(place, truth):
    """Largest distance (m) between where two maps take the corners of the brain."""
    corners = 0.07 * np.array([[x, y, z, 1 / 0.07] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]).T
    return np.linalg.norm(((place - truth) @ corners)[:3], axis=0).max()


def test_naive_registration_from_one_start_ends_elsewhere(head, template, truth):
    points = template.to_world(np.argwhere(ndimage.binary_dilation(template.data > 0.1, iterations=2)))[::8]
    values = template.interpolate(points)
    middle = points.mean(axis=0)
    bright = head.to_world(np.argwhere(head.data > head.data.mean()))

    def place(p):
        turn = np.eye(4)
        for axis in range(3):
            step = np.eye(4)
            step[:3, :3] = rotation(np.degrees(p[axis]), np.eye(3)[axis])
            turn = step @ turn
        turn[:3, :3] *= np.exp(p[3])
        turn[:3, 3] = bright.mean(axis=0) + 0.1 * p[4:] - turn[:3, :3] @ middle
        return turn

    def unlike(p):
        to = place(p)
        seen = head.interpolate(points @ to[:3, :3].T + to[:3, 3])
        seen = seen - seen.mean()
        return -float(seen @ (values - values.mean())) / (
            np.linalg.norm(seen) * np.linalg.norm(values - values.mean()) + 1e-9
        )

    found = minimize(unlike, np.zeros(7), method="Powell", options={"maxiter": 20})
    error = off(place(found.x), truth)
    print(f"{1e3 * error:.0f} mm off, correlation {-found.fun:.2f}")
    assert error > 30e-3


def test_ours_finds_it(head, template, truth):
    found = align(head, template)
    print(f"{1e3 * off(found.affine, truth):.1f} mm off, likeness {found.likeness:.2f}")
    assert off(found.affine, truth) < 4e-3
