"""Deep grey matter ends at the edges of the image, not at those of the template."""

import numpy as np
from colin import dice
from scipy import ndimage

from ngbrain.image.preprocess import mni_landmarks
from ngbrain.image.segment.nuclei import segment_nuclei

SIZE = np.array([1.5, 1.5, 1.5])
TO = np.diag([*SIZE, 1.0])
TO[:3, 3] = [-60, -75, -55]
SHAPE = (80, 100, 80)


def test_nuclei_end_at_their_edges_whether_they_are_larger_or_smaller_than_the_template_has_them():
    points = np.argwhere(np.ones(SHAPE, bool)) * SIZE + TO[:3, 3]
    matter = (np.linalg.norm(points / [58, 72, 52], axis=1) < 1).reshape(SHAPE)
    rng = np.random.default_rng(0)
    for scale in (0.85, 1.1):
        radius = np.min([nucleus.radius(points) for nucleus in mni_landmarks.NUCLEI.values()], axis=0)
        truth = (radius < scale).reshape(SHAPE) & matter
        picture = ndimage.gaussian_filter(np.where(truth, 0.8, 1.0) * matter, 0.4) + rng.normal(0, 0.01, SHAPE)
        found = segment_nuclei(picture, matter, TO, SIZE)
        print(f"{scale}: Dice {dice(found, truth):.3f}, {found.sum() / truth.sum():.2f} of the volume")
        assert dice(found, truth) > 0.93
        assert not (found & ~matter).any()


def test_where_there_is_no_tissue_there_are_none():
    matter = np.zeros(SHAPE, bool)
    assert not segment_nuclei(np.ones(SHAPE), matter, TO, SIZE).any()
    away = TO.copy()
    away[:3, 3] += 500
    assert not segment_nuclei(np.ones(SHAPE), ~matter, away, SIZE).any()
