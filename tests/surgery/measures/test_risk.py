"""Effect of pressure on a patient: perfusion, and bounds of the infarct probability from published counts."""

import numpy as np
import pytest

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.scene import Patient
from ngbrain.surgery.measures.dose_response import (
    COUNTS,
    dose_response_points,
    evidence,
    excludes_one_half,
    infarct_probability,
    interval,
    probability_lower_bound,
    probability_upper_bound,
    sustained_pressure,
)
from ngbrain.surgery.measures.perfusion import perfusion

NOTHING = "no bound: not sustained at 20 mmHg or more for 15 minutes, but loaded longer or more strongly than any rat"


def course(*corners):
    """Piecewise linear pressure (mmHg) through (minute, value) pairs."""
    t, p = np.array(corners, float).T
    return TimeCurve(60 * t, p, 60 * t)


def test_perfusion_of_a_patient_under_a_triangle_of_pressure():
    pressed = course((0, 0), (10, 90), (20, 0))
    found = perfusion(Patient(mean_arterial_pressure=70.0, intracranial_pressure=15.0), pressed)
    above = 2 * 60 * 10 * (90 - 60) / 90  # MAP - BRP < 10 above 60 mmHg
    assert found["s_perfusion_below_10_mmHg"] == found["longest_s_perfusion_below_10_mmHg"] == pytest.approx(above)
    assert found["min_perfusion_reserve_mmHg"] == pytest.approx(70 - 90)
    twice = course((0, 0), (10, 90), (20, 0), (30, 90), (40, 0))
    found = perfusion(Patient(mean_arterial_pressure=70.0), twice)
    assert found["s_perfusion_below_10_mmHg"] == pytest.approx(2 * above)
    assert found["longest_s_perfusion_below_10_mmHg"] == pytest.approx(above)


def test_where_the_blade_presses_less_than_the_head_the_reserve_is_that_without_it():
    found = perfusion(
        Patient(mean_arterial_pressure=70.0, intracranial_pressure=15.0), course((0, 0), (10, 12), (20, 0))
    )
    assert found["min_perfusion_reserve_mmHg"] == 55.0 and found["s_perfusion_below_10_mmHg"] == 0.0
    found = perfusion(Patient(mean_arterial_pressure=70.0), course((0, 0), (10, 12), (20, 0)))
    assert found["min_perfusion_reserve_mmHg"] == 58.0


def test_without_an_arterial_pressure_nothing_is_said():
    assert perfusion(Patient(), course((0, 0), (10, 90), (20, 0))) == {}


def test_intervals_are_exact():
    """At the ends of a Clopper-Pearson interval the tail up to the count has 2.5 %; 6 of 6 and 1 of 6 by hand."""
    low, high = interval(6, 6)
    assert low == pytest.approx(0.025 ** (1 / 6)) and high == 1.0
    low, high = interval(1, 6)
    assert 1 - (1 - low) ** 6 == pytest.approx(0.025)
    assert (1 - high) ** 6 + 6 * high * (1 - high) ** 5 == pytest.approx(0.025)
    assert interval(5, 6) == pytest.approx((1 - high, 1 - low))


def test_between_doses_only_their_order_is_used():
    (low20, high20), (low30, high30), (low40, _) = (interval(*COUNTS[dose]) for dose in (20.0, 30.0, 40.0))
    assert [(probability_lower_bound(p), probability_upper_bound(p)) for p in (0, 10, 20, 25, 30, 35, 40, 99)] == [
        (0.0, 0.0), (0.0, high20), (low20, high20), (low20, high30), (low30, high30), (low30, 1.0), (low40, 1.0), (low40, 1.0),
    ]  # fmt: skip


def test_the_pressure_that_is_held():
    ramp = course((0, 0), (10, 40), (20, 0))
    assert sustained_pressure(ramp, 600.0) == pytest.approx(20.0)
    assert sustained_pressure(ramp, 1200.0) == pytest.approx(0.0, abs=1e-6) and sustained_pressure(ramp, 1300.0) == 0.0
    assert sustained_pressure(course((0, 25), (15, 25)), 900.0) == pytest.approx(25.0)
    assert sustained_pressure(course((0, 0), (5, 40), (10, 0), (15, 40), (20, 0)), 300.0) == pytest.approx(
        20.0
    )  # not 30: in one go


def test_a_probability_is_never_a_bare_number():
    (low20, _), (_, high30), (low30, _) = interval(*COUNTS[20.0]), interval(*COUNTS[30.0]), interval(*COUNTS[30.0])

    def range_of(*corners):
        return tuple(infarct_probability(course(*corners))["infarct_probability_95"])

    assert range_of((0, 25), (15, 25)) == (low20, high30)
    assert range_of((0, 25), (60, 25)) == (low20, 1.0)  # longer than any of the animals': no end above
    assert range_of((0, 25), (5, 25)) == (0.0, high30)  # shorter: none below
    assert range_of((0, 0), (0.2, 35), (15, 33)) == (low30, 1.0)  # the way up does not count
    on_and_off = [(k, 45 * (k % 4 in (1, 2))) for k in range(60)]
    assert range_of(*on_and_off) == (0.0, 1.0)  # two minutes at a time
    assert range_of((0, 0), (60, 0)) == (0.0, 0.0)
    assert infarct_probability(course((0, 25), (60, 25)))["infarct_probability_95_at_held"] == [low20, high30]
    assert infarct_probability(course((0, 25), (5, 25)))["infarct_probability_95_at_held"] is None


def test_a_probability_is_stated_only_where_the_counts_say_which_is_more_likely():
    stated = {
        corner: excludes_one_half(infarct_probability(course((0, corner), (15, corner)))["infarct_probability_95"])
        for corner in (10, 25, 35, 45)
    }
    assert stated == {10: False, 25: False, 35: False, 45: True}  # 0 to 64, 0.4 to 99.6, 36 to 100, 54 to 100 %
    assert (
        excludes_one_half((0.0, 0.0))
        and excludes_one_half((0.0, 0.4))
        and not excludes_one_half((0.0, 1.0))
        and not excludes_one_half((0.5, 1.0))
    )


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        ([(0, 25), (15, 25)], "at least as harmful as 20 mmHg (1 of 6 rats), at most as harmful as 30 mmHg (5 of 6 rats)"),
        ([(0, 25), (60, 25)], "at least as harmful as 20 mmHg (1 of 6 rats)"),
        ([(0, 25), (5, 25)], "at most as harmful as 30 mmHg (5 of 6 rats)"),
        ([(0, 45), (15, 45)], "at least as harmful as 40 mmHg (6 of 6 rats)"),
        ([(0, 45), (5, 45)], NOTHING),
        ([(0, 0), (60, 0)], "no pressure"),
    ],
)  # fmt: skip
def test_the_counts_that_bound_a_course_are_said_in_words(corners, said):
    found = infarct_probability(course(*corners))
    assert evidence(found["pressure_held_15_min_mmHg"], max(p for _, p in corners), found["pressed_min"]) == said


def test_the_points_say_where_they_come_from():
    said = dose_response_points()
    assert "rats" in said["conditions"] and "15 minutes" in said["conditions"] and "1985" in said["source"]
    assert [(p["infarcts"], p["animals"]) for p in said["points"]] == [(1, 6), (5, 6), (6, 6)]
    assert all(low < p["infarcts"] / 6 <= high for p in said["points"] for low, high in [p["probability_95"]])
