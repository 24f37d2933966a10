"""Decisions, corrections by whole runs, numerical bounds and shares of the variance."""

import numpy as np
import pytest

from ngbrain.surgery.twin.comparison import compare, correct, summarise, variance_shares
from ngbrain.surgery.twin.credibility import conclusion, evidence, thresholds
from ngbrain.surgery.twin.prior import Prior, Uncertain

KEY = "mps_p95"
NONE = {"a": {KEY: np.empty(0)}, "b": {KEY: np.empty(0)}}


def logs(difference, own=0.05, count=1000):
    """Two plans with a common part of .5 and own parts."""
    drawn = np.random.default_rng(0).normal(size=(count, 3)) * [0.5, own, own]
    return {"a": {KEY: drawn[:, 0] + drawn[:, 1]}, "b": {KEY: drawn[:, 0] + drawn[:, 2] + difference}}


def decided(difference, moved=None):
    (found,) = compare(logs(difference), NONE, moved or {}, [KEY])
    return found


def test_a_difference_beyond_what_is_not_known_is_decided_either_way_and_a_small_one_open():
    assert decided(0.3).decision == "a" and decided(-0.3).decision == "b" and decided(0.05).decision == "open"
    assert decided(0.3).ratio_median == pytest.approx(np.exp(-0.3), rel=0.01)
    # own parts of .05 each: the logarithm of the ratio has a standard deviation of .0707
    low, high = decided(0.0).ratio_interval_95
    assert np.log(high / low) == pytest.approx(2 * 1.96 * 0.0707, rel=0.05)


def test_a_difference_that_another_mesh_can_turn_round_is_open():
    far = {"a": {KEY: 0.0}, "b": {KEY: 0.2}}
    alike = {"a": {KEY: 0.2}, "b": {KEY: 0.2}}
    assert decided(0.3, far).decision == "open" and decided(0.3, alike).decision == "a"
    assert decided(0.3, far).numerical_factor == pytest.approx(np.exp(0.2))


def test_whole_runs_shift_and_widen_the_linearised_draws():
    many = {"a": {KEY: np.zeros(4000)}}
    residual = np.array([0.1, 0.3, 0.2, 0.4])
    found = correct(many, {"a": {KEY: residual + 1.0}}, {"a": {KEY: np.ones(4)}})["a"][KEY]
    assert found.mean() == pytest.approx(0.25, abs=0.01)
    assert found.std() == pytest.approx(residual.std() * np.sqrt(5 / 3), rel=0.03)


def test_what_residuals_of_two_plans_have_in_common_stays_in_common():
    many = {"a": {KEY: np.zeros(500)}, "b": {KEY: np.zeros(500)}}
    residual = np.array([-0.5, 0.2, 0.6])
    whole = {"a": {KEY: residual}, "b": {KEY: residual + 0.1}}
    zero = {"a": {KEY: np.zeros(3)}, "b": {KEY: np.zeros(3)}}
    found = correct(many, whole, zero)
    assert np.ptp(found["b"][KEY] - found["a"][KEY]) < 1e-12


def test_the_numerical_error_widens_an_interval_as_a_bound():
    values = np.log(np.linspace(1, 2, 1001))
    plain, wide = (summarise(values, 1.5, moved)["interval_95"] for moved in (None, np.log(1.1)))
    assert wide[0] == pytest.approx(plain[0] / 1.1) and wide[1] == pytest.approx(plain[1] * 1.1)


def test_shares_of_the_variance_add_up_by_source():
    patient = Prior(
        tuple(
            Uncertain(name, source, 0.0, sd)
            for name, source, sd in (("x", "one", 0.3), ("y", "two", 0.1), ("z", "two", 0.2))
        )
    )
    drawn = patient.draws(1024)
    shares = variance_shares(drawn.sum(axis=1), drawn, patient.sources, 0.3 * np.sign(drawn[:, 0]))
    # .09 and .05 of the linear parts, .09 beyond them
    assert shares["two"] == pytest.approx(0.05 / 0.23, abs=0.02) and shares["one"] == pytest.approx(
        0.09 / 0.23, abs=0.02
    )
    assert sum(shares.values()) == pytest.approx(1)


def test_the_conclusion_names_plan_and_measure():
    assert conclusion([decided(0.3)]) == ["a and b: a is lower in 95th percentile of the maximum principal strain."]
    assert "open is" in conclusion([decided(0.0)])[0] and "larger than the difference" in conclusion([decided(0.0)])[0]


def test_thresholds_have_species_and_numbers_of_animals():
    found = thresholds()
    assert {(t["species"], t["n"]) for t in found if t["measure"] == "peak_pressure_mmHg"} == {("rat", 6)}
    assert {t["species"] for t in found if t["measure"] == KEY} == {"guinea pig"}


def test_empty_categories_of_credibility_are_named():
    assert [row["factor"] for row in evidence(False, False, False) if row["tests"] == "none"] == [
        "Validation of the mechanics",
        "Validation of the stiffness",
        "Coverage of intervals and correctness of decisions",
        "Relevance to the context of use",
    ]
