"""Misfits: values at the truth, for outliers and gaps; gradients and curvature."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.inverse.objective.misfit import Huber, LeastSquares


@pytest.fixture
def data(rng):
    clean = rng.normal(size=(2, 500, 2)) + 1j * rng.normal(size=(2, 500, 2))
    noisy = clean + 0.1 * (rng.normal(size=(2, 500, 2, 2)) @ [1, 1j])
    return clean, noisy


def test_the_truth_costs_half_of_the_count(data):
    misfit = LeastSquares(data[1], 0.1)
    assert 2 * misfit.value(data[0]) == pytest.approx(misfit.count, rel=0.1) and misfit.count == 4000


def test_gaps_cost_nothing(data):
    gaps = data[1].copy()
    gaps[:, :, 1] = np.nan
    misfit, axial = LeastSquares(gaps, 0.1), LeastSquares(data[1][:, :, :1], 0.1)
    assert misfit.count == 2000 and misfit.value(data[0]) == pytest.approx(axial.value(data[0][:, :, :1]))
    assert not misfit.gradient(data[0])[:, :, 1].any() and not misfit.weight(data[0])[:, :, 1].any()


@pytest.mark.parametrize("kind", [LeastSquares, lambda m, s: Huber(m, s, 1.5)])
def test_slope(kind, data, rng):
    misfit, change = kind(data[1], 0.1), rng.normal(size=(2, 500, 2)) + 1j * rng.normal(size=(2, 500, 2))
    h = 1e-6
    secant = (misfit.value(data[0] + h * change) - misfit.value(data[0] - h * change)) / (2 * h)
    assert np.sum(np.conj(misfit.gradient(data[0])) * change).real == pytest.approx(secant, rel=1e-5)


def test_huber_is_least_squares_inside_and_bounded_outside(data):
    near, far = Huber(data[1], 0.1, 100.0), Huber(data[1], 0.1, 1.0)
    assert near.value(data[0]) == pytest.approx(LeastSquares(data[1], 0.1).value(data[0]))
    assert np.abs(far.gradient(data[0])).max() <= (1 + 1e-12) / 0.1
    assert np.all(far.weight(data[0]) <= (1 + 1e-12) * near.weight(data[0]))


def test_huber_tells_the_noise_in_spite_of_outliers(data):
    spoilt = data[1].copy()
    spoilt[:, ::20] += 100.0
    squares, robust = (kind(spoilt, 0.1).weighted_squares(data[0]) / 4000 for kind in (LeastSquares, Huber))
    assert squares > 1e4 and robust == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan])
def test_no_noise_level_is_refused(sigma):
    with pytest.raises(InputError, match="sigma"):
        LeastSquares(np.ones((1, 2, 2), complex), sigma)


def test_no_threshold_is_refused():
    with pytest.raises(InputError, match="threshold"):
        Huber(np.ones((1, 2, 2), complex), 1.0, 0.0)


def test_real_data_count_once(rng):
    noise = rng.normal(size=20_000)
    for kind in (LeastSquares, Huber):
        misfit = kind(noise, 1.0)
        assert misfit.count == 20_000 and misfit.weighted_squares(np.zeros(20_000)) == pytest.approx(20_000, rel=0.03)


def test_data_that_do_not_fit_are_refused():
    """Unintended broadcasting, as of a curve (n,) with data (n, 1), is refused."""
    with pytest.raises(InputError, match=r"sigma is of shape \(4,\); wanted: one that fits data of \(3, 2\)"):
        LeastSquares(np.zeros((3, 2)), np.ones(4))
    with pytest.raises(InputError, match="measured is 6 numbers, none of them known"):
        LeastSquares(np.full((3, 2), np.nan), 1.0)
    with pytest.raises(InputError, match=r"measured is of shape \(3,\); wanted: \(3, 1\)"):
        LeastSquares(np.zeros(3), 1.0).value(np.zeros((3, 1)))
