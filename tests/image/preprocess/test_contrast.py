"""Brightness of tissues in skull-stripped brains with little contrast between grey and white matter."""

import numpy as np
import pytest
from population import individual

from ngbrain.image.preprocess.contrast import TISSUES, measure_contrast
from ngbrain.image.read.volume import Volume


def bare(seed, **given):
    """A synthetic skull-stripped brain on voxels of 3 mm, and the alignment of the template."""
    head = individual(seed, 3.0, **given)
    brain = head.tissues.volume.data > 0
    return Volume(np.where(brain, head.stored.data, 0), head.stored.affine), head.affine


@pytest.mark.parametrize("seed", range(24, 28))
def test_the_dark_around_a_brain_does_not_make_its_cortex_brighter_than_white_matter(seed):
    """Such contrast occurs in spin echoes, T1s of small children, and beside tumours."""
    seen = measure_contrast(*bare(seed, contrast=0.1, field=0.1))
    print(seen)
    assert seen.order == TISSUES and seen.step > 0.6
