"""Intervals under transforms: closed forms of the log-normal, quantiles, bounds."""

import numpy as np
import pytest
from scipy.stats import lognorm, norm

from ngbrain.errors import InputError
from ngbrain.inverse.objective.parameters import BoundedTransform, LogTransform, ScaledTransform
from ngbrain.inverse.uncertainty.interval import CredibleInterval

CENTRE, DEVIATION = np.array([0.0, 1.0, 8.0]), np.array([0.05, 0.4, 1.2])


@pytest.mark.parametrize("level", [0.68, 0.95])
def test_log_normal(level):
    exact, band = (
        lognorm(DEVIATION, scale=np.exp(CENTRE)),
        CredibleInterval.from_gaussian(CENTRE, DEVIATION, LogTransform(), level),
    )
    assert band.value == pytest.approx(exact.median())
    assert band.deviation == pytest.approx(exact.std(), rel=1e-6)
    assert exact.cdf(band.low) == pytest.approx(0.5 - level / 2) and exact.cdf(band.high) == pytest.approx(
        0.5 + level / 2
    )


def test_between_bounds(rng):
    transform = BoundedTransform(1.0, 3.0)
    band, drawn = (
        CredibleInterval.from_gaussian(CENTRE, DEVIATION, transform),
        transform.value(CENTRE + DEVIATION * rng.normal(size=(100_000, 3))),
    )
    assert np.all((band.low > 1) & (band.low < band.value) & (band.value < band.high) & (band.high < 3))
    assert np.mean((drawn > band.low) & (drawn < band.high), axis=0) == pytest.approx([0.95] * 3, abs=0.003)
    assert band.deviation == pytest.approx(drawn.std(axis=0), rel=0.05)  # few draws are far from the bound


def test_a_falling_change_of_variable_turns_the_ends():
    band = CredibleInterval.from_gaussian(CENTRE, DEVIATION, ScaledTransform(-2.0), 0.68)
    reach = 2 * norm.ppf(0.84) * DEVIATION
    assert band.low == pytest.approx(-2 * CENTRE - reach) and band.high == pytest.approx(-2 * CENTRE + reach)
    assert band.deviation == pytest.approx(2 * DEVIATION)


def test_draws(rng):
    band = CredibleInterval.from_samples(0.0, rng.normal(size=(100_000, 2)) * [1, 3])
    assert band.low == pytest.approx([-1.96, -5.88], rel=0.03) and band.deviation == pytest.approx([1, 3], rel=0.01)


@pytest.mark.parametrize("level", [0, 1, 95])
def test_no_probability(level):
    with pytest.raises(InputError, match="level"):
        CredibleInterval.from_gaussian(CENTRE, DEVIATION, level=level)
