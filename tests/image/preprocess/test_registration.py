"""Registration of the template: an initial guess is refined, and replaced by a search if it does not fit."""

import numpy as np
import pytest
from resampled_scans import rotation
from scipy import ndimage

from ngbrain.image.preprocess import registration as module
from ngbrain.image.preprocess.registration import align, downsample, normalise_locally
from ngbrain.image.read.template import mni152
from ngbrain.image.read.volume import Volume


@pytest.fixture
def searches(monkeypatch):
    """Number of searches."""
    seen, found = [], module._search_candidates
    monkeypatch.setattr(module, "_search_candidates", lambda *given: seen.append(1) or found(*given))
    return seen


def off(affine):
    """Largest displacement (m) of the corners of a brain by a map."""
    corners = np.array(list(np.ndindex(2, 2, 2))) * [0.14, 0.17, 0.13] - [0.07, 0.1, 0.05]
    return np.linalg.norm(corners @ affine[:3, :3].T + affine[:3, 3] - corners, axis=1).max()


@pytest.mark.slow
def test_a_start_that_is_near_is_improved_and_another_is_not_believed(searches):
    template = mni152().volume
    head = downsample(template, 2e-3)
    near = np.eye(4)
    near[:3, :3] = rotation(5, np.array([0.6, 0.0, 0.8]))
    near[:3, 3] = [6e-3, -5e-3, 4e-3]
    found = align(head, template, near)
    assert off(near) > 10e-3 > 1e-3 > off(found.affine) and not searches
    far = np.eye(4)
    far[:3, 3] = [90e-3, 0.0, 0.0]
    assert off(align(head, template, far).affine) < 1e-3 and searches


def test_places_to_begin_at_are_of_every_size():
    """Products with the largest template, which also covers the scalp, are larger everywhere, for example for spin echoes."""
    template, size, affine = mni152().volume, 0.84, np.diag([4e-3, 4e-3, 4e-3, 1.0])
    affine[:3, 3] = [-0.12, -0.14, -0.09]
    air = Volume(np.zeros((60, 68, 40), np.float32), affine)
    brain = template.interpolate(air.to_world(np.argwhere(air.data == 0)) / size).reshape(air.data.shape)
    away = 4 * ndimage.distance_transform_edt(brain < 0.05)
    data = np.select([(away >= 6) & (away < 20), away > 0, brain > 0.4], [2.5, 0.05, 0.7 + 0.1 * brain], 0.5)
    coarse = normalise_locally(downsample(Volume(data.astype(np.float32), affine), 8e-3))
    starts = module._search_candidates(coarse, module._template_variants(template)[0], module._TURNS)
    sizes = [np.cbrt(np.linalg.det(start[:3, :3])) for start in starts]
    assert np.allclose(np.unique(np.round(sizes, 6)), module._SIZES)
    assert min(off(start @ np.diag([1 / size, 1 / size, 1 / size, 1])) for start in starts) < 25e-3
