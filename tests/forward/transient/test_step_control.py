"""Steps by their error: how it is measured, that looking changes nothing, how few steps it takes, restart, bad input."""

from dataclasses import dataclass

import numpy as np
import pytest
from plate_contact import PRESS, run

from ngbrain.errors import InputError
from ngbrain.forward.transient.step_control import ErrorControl, StepControl, StepperProgress
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import Branch, Maxwell, NeoHooke, Ogden, Viscous

LAWS = {
    "Maxwell": Viscous(Ogden(300.0, -12.0), (Maxwell(Ogden(700.0, -15.0), 2100.0), Maxwell(NeoHooke(500.0), 1e5))),
    "hereditary": Viscous(Ogden(300.0, -12.0), (Branch(Ogden(700.0, -15.0), 3.0), Branch(NeoHooke(500.0), 200.0))),
}
HALF_AN_HOUR = ((0, 4, 1800), (0, 3e-3, 3e-3))


@pytest.mark.one_thread
@dataclass(frozen=True)
class Looking(StepControl):
    """Looks at the error and does nothing about it."""

    def check_step(self, body, before, at):
        body.half_step_error(before)
        return ""


@pytest.mark.parametrize("law", LAWS)
def test_looking_at_the_error_changes_no_bit(law, make_body, plate):
    ends = []
    for control in (StepControl, Looking):
        drive = plate(*PRESS)
        transient, rows = run(make_body(LAWS[law], [drive.contact()]), drive, control(1.0, dt_max=10))
        ends.append((rows, transient.problem.x))
    assert all(np.array_equal(one, other) for one, other in zip(*ends, strict=True))


@pytest.mark.parametrize("law", LAWS)
def test_the_error_of_a_step_falls_with_its_third_power(law, make_body, rng):
    """On a straight path from a state with some memory."""
    body = make_body(LAWS[law])
    free = body.weights > 0
    start, way = (np.where(body.is_u & free, 3e-4, 0.0) * rng.standard_normal(body.fes.ndof) for _ in range(2))
    found = []
    for dt in (0.4, 0.2, 0.1, 0.05):
        body = make_body(LAWS[law])
        body.begin(0.1)
        body.residual(start)
        body.history.finish()
        body.begin(dt)
        body.residual(start + dt * way)
        change, size = body.half_step_error(start)
        found.append(change)
        assert 0 < change < 0.05 * size
    rates = np.log2(np.array(found[:-1]) / found[1:])
    assert np.all(rates > 2.5), (found, rates)


def pressed(make_body, plate, control):
    """Peak force of half an hour, and where the run stands."""
    drive = plate(*HALF_AN_HOUR)
    transient, rows = run(make_body(LAWS["Maxwell"], [drive.contact()]), drive, control)
    return rows[:, 1].max(), transient.progress


@pytest.mark.slow
def test_half_an_hour_takes_few_steps(make_body, plate):
    """Even steps take fifteen times as many and are less exact, steps chosen beforehand a good half more."""
    peak, fine = pressed(make_body, plate, ErrorControl(1e-6, touch=0.01))
    mine, at = pressed(make_body, plate, ErrorControl(1e-3, touch=0.1))
    chosen, before = pressed(make_body, plate, StepControl(1.0))
    even, plodding = pressed(make_body, plate, StepControl(4.0, first=1.0, restart=1.0, growth=1.0, dt_max=4.0))
    assert abs(mine / peak - 1) < 3.2e-4 < abs(chosen / peak - 1) < 1e-3 < abs(even / peak - 1)
    assert at.steps < 30 and before.steps > 1.5 * at.steps and plodding.steps > 15 * at.steps and fine.steps > 100
    assert at.t == 1800 and at.dt > 200


def test_a_step_that_is_too_inexact_is_taken_again(make_body, plate):
    drive = plate(*HALF_AN_HOUR)
    control = ErrorControl(1e-4, touch=2.0)
    transient = TimeStepper(make_body(LAWS["Maxwell"], [drive.contact()]), drive, control, 1e-3)
    transient.run(lambda *_: None, until=4.0)
    at = transient.progress
    assert at.rejected > 0 and at.t == 4.0 and at.steps > 6


def test_no_step_is_longer_than_asked_for_while_it_pushes(make_body, plate):
    drive = plate(*HALF_AN_HOUR)
    control = ErrorControl(0.1, touch=0.1, longest=400.0, pushing=0.5)
    _, rows = run(make_body(LAWS["Maxwell"], [drive.contact()]), drive, control)
    steps = np.diff(rows[:, 0])
    pushed = rows[1:, 0] <= 4.0
    room = 1 + 1e-9  # by which a step may be stretched to end at an event; differences of times are far more exact
    assert 0.4 < steps[pushed].max() <= 0.5 * room and 100 < steps[~pushed].max() <= 400 * room


@pytest.mark.parametrize(("rate", "dt"), [(1.0, 2.0), (-1.0, 1.0), (0.0, 4.0)])
def test_a_body_in_touch_withdraws_in_half_as_long_steps(rate, dt):
    at = StepperProgress(dt=1.0, touching=True, rested=False, factor=4.0)
    assert ErrorControl(0.1, touch=0.1, pushing=2.0).propose_step(at, lambda ahead: rate * ahead) == dt


@pytest.mark.parametrize(("rate", "dt"), [(1.0, 1.5), (-1.0, 0.75), (10.0, 0.15), (-10.0, 0.075), (0.0, 4.0)])
def test_no_step_goes_further_than_asked_for_and_half_as_far_as_it_withdraws(rate, dt):
    at, control = (
        StepperProgress(dt=1.0, touching=True, rested=False, factor=4.0),
        ErrorControl(0.1, touch=0.1, max_travel=1.5),
    )
    assert control.propose_step(at, lambda ahead: rate * ahead) == pytest.approx(dt)
    assert control.halve().max_travel == 0.75


def test_the_first_step_goes_no_further_either():
    control = ErrorControl(0.1, touch=0.1, max_travel=0.02)
    assert control.propose_step(StepperProgress(touching=True), lambda ahead: 1.0 * ahead) == pytest.approx(0.02)
    assert control.propose_step(StepperProgress(touching=False), lambda ahead: 1.0 * ahead) == 0.1


@pytest.mark.one_thread
def test_a_run_by_its_error_goes_on_with_the_same_bits(make_body, plate):
    def made():
        drive = plate(*HALF_AN_HOUR)
        return TimeStepper(make_body(LAWS["Maxwell"], [drive.contact()]), drive, ErrorControl(1e-3, touch=0.1), 1e-3)

    whole, half, other = made(), made(), made()
    whole.run(lambda *_: None)
    half.run(lambda *_: None, until=20.0)
    other.restore(half.checkpoint())
    other.run(lambda *_: None)
    assert np.array_equal(other.problem.x, whole.problem.x) and other.progress.steps == whole.progress.steps


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"tolerance": 0.0}, "tolerance"),
        ({"tolerance": 2.0}, "tolerance"),
        ({"touch": 1e-5}, "ErrorControl"),
        ({"longest": 0.01}, "0 <"),
        ({"pushing": 0.01}, "0 <"),
        ({"max_travel": 0.0}, "ErrorControl.max_travel"),
    ],
)
def test_bad_input(values, name):
    with pytest.raises(InputError, match=name):
        ErrorControl(**({"tolerance": 1e-3, "touch": 0.1} | values))
