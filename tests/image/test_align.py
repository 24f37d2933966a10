"""A place that was found before is improved, not searched for again; one that does not fit is."""

import numpy as np
import pytest
from regridded import rotation

from ngbrain.image import align as module
from ngbrain.image.align import align, thinned
from ngbrain.image.volume import mni152


@pytest.fixture
def searches(monkeypatch):
    """How often places were searched for."""
    seen, found = [], module._found
    monkeypatch.setattr(module, "_found", lambda *given: seen.append(1) or found(*given))
    return seen


def off(affine):
    """By how much (m) a map moves the corners of a brain."""
    corners = np.array(list(np.ndindex(2, 2, 2))) * [0.14, 0.17, 0.13] - [0.07, 0.1, 0.05]
    return np.linalg.norm(corners @ affine[:3, :3].T + affine[:3, 3] - corners, axis=1).max()


def test_a_start_that_is_near_is_improved_and_another_is_not_believed(searches):
    template = mni152().volume
    head = thinned(template, 2e-3)
    near = np.eye(4)
    near[:3, :3] = rotation(5, np.array([0.6, 0.0, 0.8]))
    near[:3, 3] = [6e-3, -5e-3, 4e-3]
    found = align(head, template, near)
    assert off(near) > 10e-3 > 1e-3 > off(found.affine) and not searches
    far = np.eye(4)
    far[:3, 3] = [90e-3, 0.0, 0.0]
    assert off(align(head, template, far).affine) < 1e-3 and searches
