"""Bias field: corrected where there is one, unchanged where there is none, the same bits each time."""

import numpy as np
import pytest
from colin import slow_field
from nilearn.datasets import load_mni152_wm_template

from ngbrain.image import Volume, check_extracted, mni152
from ngbrain.image.preprocess.bias_field import correct_bias_field, estimate_bias_field


@pytest.fixture(scope="module")
def scan():
    whole = mni152()
    return whole.volume, check_extracted(whole)


def under(volume, field):
    return Volume((volume.data * field).astype(np.float32), volume.affine)


def unevenness(ratio, where):
    return ratio[where].std() / ratio[where].mean()


def test_a_flat_average_stays_as_it_is(scan):
    assert correct_bias_field(*scan) is scan[0]


def test_a_field_is_found(scan):
    volume, brain = scan
    true = slow_field(volume.data.shape, 0.4)
    white = load_mni152_wm_template(resolution=1).get_fdata() > 0.9
    even = correct_bias_field(under(volume, true), brain).data
    left = unevenness(np.divide(even, volume.data, where=brain, out=np.ones_like(even)), white)
    print(f"uneven by {100 * unevenness(true, white):.1f} % before, {100 * left:.1f} % after")
    assert left < unevenness(true, white) / 2.5
    assert not even[~brain].any()


@pytest.mark.slow
def test_the_zero_of_grey_values_stays(scan):
    volume, brain = scan
    field = slow_field(volume.data.shape, 0.4)
    one = correct_bias_field(under(volume, field), brain).data
    raised = Volume(np.where(brain, volume.data * field, 0).astype(np.float32) * 300 + 70, volume.affine)
    assert np.allclose(correct_bias_field(raised, brain).data, 300 * one + 70, atol=1)


def test_same_bits_twice(scan):
    volume, brain = scan
    first, second = (estimate_bias_field(volume, brain) for _ in range(2))
    assert first.digest() == second.digest()
    assert first.data[brain].mean() == pytest.approx(1, abs=1e-4)
