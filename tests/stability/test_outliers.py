"""Gross errors at 2 % of the points, as large as the waves. Naive: squares count them as noise. Ours: they are found and left out.

A wrapped patch, 6 mm in radius, in a uniform square of 2 + .8i kPa: kept, G' has a median of 2.4 kPa, from .004 to 39, and G''
is lost; torn off whole, the medians are 2.00 and .80, and the answer still says that a phase is wrapped.

The published CV-G on half of its points with 1 % noise: without gross errors G' is 1.5 % off; with them 6.8 %, and the noise
is said to be 23 %; found and left out 1.5 and 1 %.
"""

from dataclasses import replace

import numpy as np
import pytest
from corrupted_waves import spoiled
from planewaves import grid, shear_waves, waves

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


@pytest.fixture(scope="module")
def wrapped():
    points = grid(24, 20)
    data = waves(points, shear_waves(points, 2000 + 800j)).with_noise(0.01, seed=1)
    u, patch = data.displacement.copy(), np.hypot(*(points - [0.02, 0.018]).T) < 0.006
    u[0, patch, 1] += 3 * data.rms[0, 0, 1]
    return replace(data, displacement=u)


def of_wrapped(data, drop):
    found = invert(data, noise=0.01, uniform=False, regulariser="smooth", drop_outliers=drop)
    return [found.answers[name]["median"] for name in ("storage", "loss")], found


@pytest.mark.slow
def test_naive_a_wrapped_patch_spoils_the_whole_map(wrapped):
    (storage, loss), found = of_wrapped(wrapped, False)
    assert storage > 2200 and loss < 400 and not found.usable
    assert np.ptp(np.quantile(found.maps["storage"], [0.1, 0.9])) > 4000


def test_a_patch_torn_off_whole_spoils_nothing(wrapped):
    medians, found = of_wrapped(wrapped, True)
    assert medians == pytest.approx([2000, 800], rel=0.01)
    (reason,) = found.reasons
    assert "phase wrapped" in reason and found.checks["torn_displacements"] == pytest.approx(26 / 960)


@pytest.mark.slow
def test_what_is_missed_next_to_a_jump_is_no_noise_by_huber():
    """CV-B on half of its points, 15 of 18 found: squares: G' 6.9 % off and noise of 2 %; Huber's misfit: 4.3 and 1 %.

    Seeds 1 to 6: squares 4.0 to 19 %, Huber's misfit 4.3 to 9.3 %.
    """
    data = spoiled(Phantom.from_name("CV-B", 25).simulate_measurements(0.01).data(), 0.02, 1.0, seed=1)[0]
    common = {"noise": 0.01, "uniform": False, "regulariser": "smooth"}
    squares, huber = (invert(remove_outliers(data), **common, misfit=kind) for kind in ("squares", "huber"))
    assert squares.noise > 0.015 and huber.noise == pytest.approx(0.01)
    assert error(huber) < 0.75 * error(squares)
