"""The synthetic heads of `population`: all different, reproducible by number, with valid labels."""

import numpy as np
from population import CSF, GREY, VENTRICLE, WHITE, individual


def test_no_two_are_alike_and_each_has_the_labels_it_should():
    one, other = individual(0, 4.0), individual(1, 4.0)
    assert set(np.unique(one.tissues.volume.data)) == {0, CSF, GREY, WHITE, VENTRICLE}
    assert {2, 3, 4, 7, 8, 16, 41, 42, 43, 46, 47} < set(np.unique(one.parts.data))
    assert not (one.parts.data[one.tissues.volume.data == CSF] > 0).any()  # no fluid in sulci
    assert np.abs(one.affine - other.affine).max() > 1e-3
    again = individual(0, 4.0)
    assert np.array_equal(again.stored.data, one.stored.data)
