"""Plans compared by draws: what they have in common cancels where draws are common, and hides a difference where they are not.

Plan A presses 6 % less than plan B, whatever the patient: both press in proportion to the patient's level of stiffness, of which
one standard deviation is a factor of 2, as of published moduli. Six whole runs of each plan.
"""

import numpy as np

from ngbrain.surgery.twin.comparison import compare
from ngbrain.surgery.twin.prior import Prior, Uncertain

PATIENT = Prior((Uncertain("level", "level", 0.0, np.log(2.0)), Uncertain("own", "own", 0.0, 0.01)))
KEY = "peak_pressure_mmHg"
RUNS = 6


def pressures(own_seed):
    """ln pressure of both plans in six draws; the second plan's from draws of its own where a seed is given."""
    first = PATIENT.draws(RUNS)
    second = first if own_seed is None else PATIENT.draws(RUNS, own_seed)
    a = np.log(20.0) + first @ [1.0, 1.0]
    b = np.log(20.0 / 0.94) + second @ [1.0, -1.0]
    return {"a": {KEY: a}, "b": {KEY: b}}


def test_common_draws_find_the_plan_that_presses_less():
    logs = pressures(None)
    (found,) = compare(logs, logs, {}, [KEY])
    assert found.decision == "a" and found.first_lower == RUNS
    assert 0.9 < found.ratio_interval_95[0] < 0.94 < found.ratio_interval_95[1] < 1


def test_draws_of_its_own_for_each_plan_can_reverse_the_choice():
    ratios = np.array([(logs["a"][KEY] - logs["b"][KEY]).mean() for logs in map(pressures, range(1, 41))])
    assert np.sum(ratios > 0) >= 4, "the mean of six runs says that b presses less"
    common = pressures(None)
    assert (common["a"][KEY] - common["b"][KEY]).mean() < -0.04
