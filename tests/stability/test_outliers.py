"""Gross errors at 2 % of the points, as large as the waves. Naive: squares count them as noise. Ours: they are found and left out.

The published CV-G on half of its points with 1 % noise: without gross errors G' is 1.5 % off; with them 6.8 %, and the noise
is said to be 23 %; found and left out 1.5 and 1 %.
"""

import numpy as np
import pytest
from corrupted_waves import spoiled

from ngbrain.inverse.data.outliers import remove_outliers
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.phantoms.benchmark import Phantom


@pytest.fixture(scope="module")
def data():
    return spoiled(Phantom.from_name("CV-G", 25).simulate_measurements(0.01).data(), 0.02, 1.0, seed=3)[0]


def error(found):
    return found.answers["storage"]["relative_l2_error"]


def test_naive_gross_errors_become_noise(data):
    naive = invert(data, noise=0.01, uniform=False, regulariser="smooth", drop_outliers=False)
    assert error(naive) > 0.04 and naive.noise > 0.1


def test_left_out_they_do_no_harm(data):
    ours = invert(remove_outliers(data), noise=0.01, uniform=False, regulariser="smooth")
    assert error(ours) < 0.02 and ours.noise == pytest.approx(0.01)
    assert np.isfinite(ours.maps["storage"]).all()


@pytest.mark.slow
def test_what_is_missed_next_to_a_jump_is_no_noise_by_huber():
    """CV-B on half of its points, 14 of 26 found: squares: G' 6 % off and noise of 7 %; Huber's misfit: 5.3 and 1 %."""
    data = spoiled(Phantom.from_name("CV-B", 25).simulate_measurements(0.01).data(), 0.02, 1.0, seed=3)[0]
    common = {"noise": 0.01, "uniform": False, "regulariser": "smooth"}
    squares, huber = (invert(remove_outliers(data), **common, misfit=kind) for kind in ("squares", "huber"))
    assert squares.noise > 0.03 and huber.noise == pytest.approx(0.01)
    assert error(huber) < 0.95 * error(squares)
