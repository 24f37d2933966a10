"""Inserted outliers are found, also two at once; normal samples raise false alarms at the stated rate."""

import numpy as np
import pytest

from ngbrain.workflows.gate import LEAST_ROWS, LEVEL, find_outliers, qn


def drawn(random, n, m):
    values = np.exp(0.15 * random.standard_normal((n, m)))
    return {f"r{i}": {f"k{j}": float(values[i, j]) for j in range(m)} for i in range(n)}


def one_group(numbers):
    return dict.fromkeys(numbers, "")


@pytest.mark.parametrize(("n", "m", "cohorts"), [(6, 12, 400), (12, 12, 300), (31, 3, 400)])
def test_cohorts_without_outliers_seldom_raise_an_alarm(n, m, cohorts):
    alarms = 0
    for seed in range(cohorts):
        numbers = drawn(np.random.default_rng([n, seed]), n, m)
        alarms += bool(find_outliers(numbers, one_group(numbers))[1])
    assert alarms / cohorts < LEVEL + 3 * np.sqrt(LEVEL * (1 - LEVEL) / cohorts)
    assert alarms  # nor never: the limit would be further out than it has to be


def test_qn_is_the_standard_deviation_of_normal_draws(rng):
    for n in (6, 7, 12, 25, 300):
        found = np.mean([qn(3.0 * rng.standard_normal(n)) for _ in range(400 if n < 100 else 20)])
        assert found == pytest.approx(3.0, rel=0.06), n


@pytest.mark.parametrize("spoilt", [1, 2, 3])
def test_outliers_do_not_hide_one_another(rng, spoilt):
    numbers = drawn(rng, 14, 8)
    for i in range(spoilt):
        numbers[f"r{i}"]["k3"] *= 12.0 + i
    _, outliers = find_outliers(numbers, one_group(numbers))
    assert {(each.row, each.key) for each in outliers} == {(f"r{i}", "k3") for i in range(spoilt)}
    assert all(each.deviation > each.spread.limit for each in outliers)
    low, high = outliers[0].spread.bounds
    assert low < outliers[0].spread.median < high < outliers[0].value


def test_what_is_not_always_positive_is_compared_as_it_is(rng):
    values = rng.standard_normal(20)
    values[7] = -9.0
    numbers = {f"r{i}": {"k": float(value)} for i, value in enumerate(values)}
    (spread,), (outlier,) = find_outliers(numbers, one_group(numbers))
    assert not spread.logarithmic and outlier.row == "r7" and outlier.deviation < -spread.limit


def test_groups_are_judged_by_themselves(rng):
    numbers = drawn(rng, 24, 3)
    for i in range(12, 24):
        numbers[f"r{i}"]["k0"] *= 40.0
    groups = {name: "old" if int(name[1:]) >= 12 else "young" for name in numbers}
    numbers["r3"]["k0"] *= 40.0  # what would be nothing in the other group
    spreads, outliers = find_outliers(numbers, groups)
    assert [(each.row, each.key, each.spread.group) for each in outliers] == [("r3", "k0", "young")]
    assert {spread.group for spread in spreads} == {"old", "young"}


def test_no_test_is_made_of_few_rows_equal_ones_and_extremes():
    numbers = {f"r{i}": {"few": 1.0 + i, "same": 1.0, "angle": 15.0 + 0.01 * i} for i in range(LEAST_ROWS)}
    del numbers["r0"]["few"]
    numbers["r1"] |= {"few": 1e9, "same": 1e9, "angle": 1e-9}
    spreads, outliers = find_outliers(numbers, one_group(numbers), ["angle"])
    assert not outliers and not any(spread.limit for spread in spreads)
    said = {spread.key: spread.untested for spread in spreads}
    assert said["few"] == "5 rows: fewer than 6" and "same value" in said["same"] and "extreme" in said["angle"]


def test_more_numbers_move_the_limit_out(rng):
    limits = []
    for m in (1, 10, 100):
        numbers = drawn(rng, 12, m)
        limits.append(find_outliers(numbers, one_group(numbers))[0][0].limit)
    assert limits == sorted(limits) and limits[-1] > 1.5 * limits[0]
