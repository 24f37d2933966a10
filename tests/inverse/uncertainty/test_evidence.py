"""Model evidence: in closed form, and for truths that are smooth or have a step."""

import numpy as np
import pytest
from planewaves import grid, shear_waves, waves
from scipy.stats import multivariate_normal

from ngbrain.errors import InputError
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.uncertainty.credible_maps import uncertainty
from ngbrain.inverse.uncertainty.evidence import best_prior, evidence


def test_the_probability_of_data_and_the_variances_that_it_is_largest_at(rng):
    parts = [each @ each.T for each in rng.normal(size=(2, 40, 60))]
    y = rng.multivariate_normal(np.zeros(40), np.eye(40) + 0.3 * parts[0] + 2.0 * parts[1])

    def probability(s):
        alike = 0.25 * np.log(s[0] / s[1]) ** 2
        return multivariate_normal(cov=np.eye(40) + s[0] * parts[0] + s[1] * parts[1]).logpdf(y) - alike

    found, best = evidence(parts, y)
    assert found == pytest.approx(probability(best) + 20 * np.log(2 * np.pi), rel=1e-9)
    assert all(probability(best) > probability(best * near) for near in ([1.1, 1], [0.9, 1], [1, 1.1], [1, 0.9]))


@pytest.fixture(scope="module")
def smooth_truth():
    """An inversion with H1, in the elements of the data."""
    return invert(Phantom.from_name("CV-G", 17).simulate_measurements(0.01).data(), uniform=False, regulariser="smooth")


def test_gaussian_fields_take_the_place_of_h1_where_the_truth_is_smooth(smooth_truth):
    found, bars = smooth_truth, uncertainty(smooth_truth)
    assert bars.found.regulariser == "matern" and any("correlated over" in note for note in bars.found.warnings)
    for name in ("storage", "loss"):
        assert bars.interval(name).value == pytest.approx(bars.found.maps[name], rel=1e-9)
        assert bars.found.answers[name]["relative_l2_error"] < found.answers[name]["relative_l2_error"]
    assert bars.found.checks["misfit_over_expected"] < 1.1
    # Their end is one of its own: error bars of it are the same.
    again = uncertainty(bars.found, prior="own")
    assert again.interval("loss").deviation == pytest.approx(bars.interval("loss").deviation, rel=0.1)


def test_the_prior_of_the_inversion_if_asked(smooth_truth):
    assert uncertainty(smooth_truth, prior="own").found is smooth_truth
    with pytest.raises(InputError, match="prior is 'owm'; wanted: did you mean 'own'"):
        uncertainty(smooth_truth, prior="owm")


def test_the_level_of_uniform_tissue_is_not_taken_for_known():
    """Gaussian fields of zero variance would fit best, with an exact mean: the prior of the inversion is kept."""
    points = grid(12, 12, spacing=4e-3)
    data = waves(points, shear_waves(points, 2500 + 500j, 30.0), (30.0,), poisson=0.4).with_noise(0.01, seed=0)
    found = invert(data, uniform=False, regulariser="smooth")
    bars = uncertainty(found)
    assert bars.found is found and bars.mean("storage").deviation > 2


def test_total_variation_stays_where_the_truth_has_a_step():
    found = invert(Phantom.from_name("CV-B", 17).simulate_measurements(0.01).data(), uniform=False, regulariser="edges")
    bars = uncertainty(found)
    assert bars.found is found
    middles = {name: float(bars.posterior.x[bars.posterior.blocks[name]].mean()) for name in ("storage", "loss")}
    assert best_prior(bars.posterior, bars.problem.space, middles) is None
