"""Time stepping: closed forms, order in time, unilateral contact, restart, rejected steps."""

import numpy as np
import pytest
from plate_contact import PRESS, Failing, run

from ngbrain.errors import ContactError, ConvergenceError, InvertedElementError
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import Branch, Maxwell, NeoHooke, Ogden, Viscous
from ngbrain.result import Status
from ngbrain.solvers.newton import Newton


def test_steps_land_on_events_and_nothing_pulls(make_body, plate):
    drive = plate(*PRESS)
    _, rows = run(make_body(contacts=[drive.contact()]), drive, StepControl(1.0, dt_max=10))
    t, f, gap = rows.T
    assert {4.0, 40.0, 44.0, 60.0} <= set(t)
    pressed = (t > 0) & (t <= 40)
    assert np.all(f[pressed] > 0) and np.all(np.diff(f[(t >= 4) & (t <= 40)]) < 0)
    away = gap > 0
    assert away.any() and np.all(np.abs(f[away]) < 1e-12)
    assert np.all(f >= -1e-12)


def test_a_step_is_second_order_in_time(make_body, plate):
    law = Viscous(NeoHooke(300.0), (Branch(NeoHooke(700.0), 3.0),))
    forces = []
    for dt in (2.0, 1.0, 0.5, 0.0625):
        drive = plate((0, 4), (0, 3e-3))
        body = make_body(law, [drive.contact()])
        control = StepControl(dt, first=1.0, touch_growth=1.0)
        forces.append(run(body, drive, control)[1][-1, 1])
    errors = np.abs(np.array(forces[:-1]) / forces[-1] - 1)
    rates = np.log2(errors[:-1] / errors[1:])
    assert errors[0] < 0.02 and np.all(rates > 1.7), (errors, rates)


def test_forces_are_proportional_to_the_moduli_if_all_of_them_are(make_body, plate):
    """Three times as stiff in every branch, in bulk and in contact, with the same times: what needs no run of its own."""
    found = []
    for factor in (1.0, 3.0):
        branches = (
            Maxwell(Ogden(700.0 * factor, -15.0), 2100.0 * factor),
            Branch(NeoHooke(500.0 * factor), 200.0),
        )
        drive = plate((0, 4, 40), (0, 2e-3, 2e-3))
        body = make_body(
            Viscous(Ogden(300.0 * factor, -12.0), branches), [drive.contact(1e8 * factor)], bulk=1.5e6 * factor
        )
        found.append(run(body, drive, StepControl(2.0, dt_max=10))[1])
    (soft, stiff) = found
    assert soft[:, 1].max() > 0.1
    assert np.array_equal(soft[:, 0], stiff[:, 0]) and stiff[:, 1] == pytest.approx(3 * soft[:, 1], rel=1e-5)


def test_a_step_that_fails_is_cut_and_the_next_starts_as_short(make_body, plate):
    drive = plate(*PRESS)
    transient = TimeStepper(make_body(contacts=[drive.contact()]), drive, StepControl(1.0), 1e-3)
    transient.run(lambda *_: None, until=4.0)
    transient.newton = Failing(at=(0, 1))
    transient.step()
    at = transient.progress
    assert at.rejected == 2 and at.dt == pytest.approx(1 / 9)
    transient.step()
    assert at.dt == pytest.approx(1 / 9)


def test_a_step_that_failed_twice_begins_where_the_body_stands(make_body, plate):
    drive = plate(*PRESS)
    transient = TimeStepper(make_body(contacts=[drive.contact()]), drive, StepControl(1.0), 1e-3)
    transient.run(lambda *_: None, until=2.0)
    transient.newton = Failing(at=(0, 1, 2))
    stood = transient.problem.x.copy()
    transient.step()
    ahead = [np.abs(guess - stood).max() for guess in transient.newton.begun]
    assert ahead[0] > 3 * ahead[1] * (1 - 1e-9) > 1e-4 and ahead[2:] == [0, 0]


def test_a_step_that_keeps_failing_ends_the_run(make_body, plate):
    drive = plate(*PRESS)
    transient = TimeStepper(make_body(contacts=[drive.contact()]), drive, StepControl(1.0), 1e-3)
    transient.run(lambda *_: None, until=4.0)
    for status, error in ((Status.STALLED, ConvergenceError), (Status.INVERTED, InvertedElementError)):
        transient.newton = Failing(at=tuple(range(99)), why="given up", status=status)
        with pytest.raises(error, match="given up"):
            transient.step()


@pytest.mark.one_thread
def test_restart_goes_on_with_the_same_bits(make_body, plate):
    control = StepControl(1.0, dt_max=10)
    drive = plate(*PRESS)
    whole, _ = run(make_body(contacts=[drive.contact()]), drive, control)
    half_drive = plate(*PRESS)
    half = TimeStepper(make_body(contacts=[half_drive.contact()]), half_drive, control, 1e-3)
    half.run(lambda *_: None, until=10.0)
    saved = half.checkpoint()
    other_drive = plate(*PRESS)
    other = TimeStepper(make_body(contacts=[other_drive.contact()]), other_drive, control, 1e-3)
    other.restore(saved)
    other.run(lambda *_: None)
    assert np.array_equal(other.problem.x, whole.problem.x)
    assert other.progress.steps == whole.progress.steps


def test_a_run_restored_is_saved_as_it_was(make_body, plate):
    # One stopped again before its next factorisation, or followed by another protocol, has the same factors to go on from.
    drive = plate(*PRESS)

    def made():
        return TimeStepper(make_body(contacts=[drive.contact()]), drive, StepControl(1.0, dt_max=10), 1e-3)

    first, second = made(), made()
    first.run(lambda *_: None, until=10.0)
    saved = first.checkpoint()
    assert saved["factors"]
    second.restore(saved)
    np.testing.assert_equal(second.checkpoint(), saved)


def test_too_deep_a_penetration_is_rejected_and_named(make_body, plate):
    drive = plate((0, 4), (0, 4e-3))
    body = make_body(contacts=[drive.contact(penalty=1e5)])
    transient = TimeStepper(body, drive, StepControl(1.0), penetration_limit=1e-3)
    with pytest.raises(ContactError, match="penetration") as error:
        transient.run(lambda *_: None)
    assert error.value.status is Status.PENETRATION and error.value.result.converged
    assert transient.progress.rejected > 0 and body.min_gap() > -1e-3


def test_kept_and_renewed_factorisations_agree(make_body, plate):
    ends = []
    for keep in (0.0, 0.7):
        drive = plate((0, 4), (0, 2e-3))
        newton = Newton(max_contraction=keep, spare_iterations=round(9 * keep), max_factorisations=50)
        transient, rows = run(make_body(contacts=[drive.contact()]), drive, StepControl(0.5), newton=newton)
        ends.append((rows[-1, 1], transient.progress.work.factorisations))
        assert transient.progress.rejected == 0
    assert ends[0][0] == pytest.approx(ends[1][0], rel=1e-6)
    assert ends[1][1] < ends[0][1] / 3


def test_doubling_every_modulus_doubles_every_force(make_body, plate):
    results = []
    for factor in (1.0, 2.0):
        law = Viscous(Ogden(factor * 300.0, -12.0), (Branch(Ogden(factor * 700.0, -15.0), 3.0),))
        drive = plate(*PRESS)
        body = make_body(law, [drive.contact(factor * 1e8)], bulk=factor * 1.5e6)
        results.append(run(body, drive, StepControl(1.0, dt_max=10))[1][:, 1])
    assert np.allclose(results[1], 2 * results[0], rtol=1e-6, atol=1e-9)


def test_forces_after_a_step_are_those_that_balanced_in_it(plate):
    # A dashpot pulls with the flow within the step, which is gone as soon as the next one begins.
    from ngbrain.forward.common.material import Material
    from ngbrain.forward.solid.problem import Problem
    from ngbrain.mesh import block

    drive = plate((0, 4), (0, 2e-3))
    material = Material(Viscous(NeoHooke(1000.0), (Maxwell(NeoHooke(1e4), 3000.0),)), 1e6)
    body = Problem(
        block((0.02, 0.02, 0.02), 0.02),
        {"tissue": material},
        {"bottom": 0},
        contacts=[drive.contact()],
        element="P2/P1",
    )
    transient = TimeStepper(body, drive, StepControl(1.0), 1e-3)
    free = body.weights[body.is_u] > 0
    off = []
    transient.run(lambda b, at, record: off.append(np.abs((b.tissue_forces() + b.contact_forces())[free]).max()))
    assert max(off) < 1e-6 * np.abs(body.contact_forces()).max()


def test_a_hold_is_foreseen(make_body, plate):
    """In the logarithm of time, from the step before; without, the hold takes more iterations to the same forces."""
    iterations, forces = [], []
    for foreseen in (True, False):
        drive = plate((0, 4, 1800), (0, 3e-3, 3e-3))
        transient = TimeStepper(make_body(contacts=[drive.contact()]), drive, StepControl(1.0), 1e-3, Newton(rtol=1e-5))

        def watch(body, at, record, transient=transient, foreseen=foreseen):
            transient.drift = transient.drift * foreseen

        transient.run(watch, until=4.0)
        before = transient.progress.newton
        transient.run(watch)
        iterations.append(transient.progress.newton - before)
        forces.append(np.linalg.norm(transient.problem.contact_forces()))
    assert forces[0] == pytest.approx(forces[1], rel=1e-4) and iterations[0] < 0.8 * iterations[1], iterations
