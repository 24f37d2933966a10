"""A gradient through time is that of one grid of times, tightly converged; pairs with steps left free and with loose ones."""

import ngsolve as ngs
import numpy as np
import pytest
from relaxing_blocks import SIDE, plate

from ngbrain.adjoint.check import taylor
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Force
from ngbrain.forward.sensitivity.transient.replay import TIGHT, accepted_times
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import ErrorControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import NeoHooke, Prony
from ngbrain.mesh import block
from ngbrain.solvers.newton import Newton
from ngbrain.surgery.protocols import Drive, ToolMotion

HOLD = ToolMotion("hold", (0.0, 4.0, 20.0), (0.0, 2e-3, 2e-3))
START, TAU = np.array([1000.0, 0.6, 8.0]), np.array([0.0, 0.0, 1.0])
CONTROL = ErrorControl(2e-3, touch=0.5)


def pressed():
    p = {name: ngs.Parameter(value) for name, value in zip(("mu", "g", "tau"), START, strict=True)}
    drive = Drive(HOLD)
    tissue = Material(Prony(NeoHooke(p["mu"]), [p["g"]], [p["tau"]]), 1e6)
    return (
        Problem(block((SIDE,) * 3, SIDE), {"tissue": tissue}, {"bottom": 0}, contacts=[plate(drive)], element="P2/P1"),
        drive,
        p,
    )


def stepped(theta):
    """Times of steps that choose their length by their error, and the force at the end."""
    body, drive, p = pressed()
    for parameter, value in zip(p.values(), theta, strict=True):
        parameter.Set(value)
    body.history.reset()
    seen = Force("top", (0, 0, 1)).on(body)
    transient = TimeStepper(body, drive, CONTROL, 1e-3, Newton(rtol=1e-10, max_iter=80))
    grid = accepted_times(transient)
    return grid, float(seen.value()[0])


def rates(force, slope, first=2e-4):
    return taylor(force, slope, START, START * TAU, steps=4, first=first)


def replayed(grid, newton=TIGHT):
    body, drive, p = pressed()
    return RunModel(body, drive, grid, p, [Force("top", (0, 0, 1))], times=[20.0], newton=newton, states=False)


def slope_of(of):
    return of.evaluate(START).gradient(np.ones((1, 1)))


def test_on_one_grid_the_gradient_has_its_rate():
    of = replayed(stepped(START)[0])
    slope = slope_of(of)
    found = rates(lambda x: float(of.evaluate(x).data[0, 0]), slope)
    print(found)
    assert np.all((found > 1.9) & (found < 2.1))


def test_loose_steps_spoil_it():
    of = replayed(stepped(START)[0], Newton(rtol=1e-3, xtol=1e-2))
    slope = slope_of(of)
    assert slope == pytest.approx(
        slope_of(replayed(of.replay.grid)), rel=1e-4
    )  # the gradient is right, what it is of is rough
    found = rates(lambda x: float(of.evaluate(x).data[0, 0]), slope)
    print(found)
    assert np.min(found) < 1.3


def test_steps_that_are_free_move_with_what_is_differentiated():
    slope = slope_of(replayed(stepped(START)[0]))
    found = rates(lambda x: stepped(x)[1], slope, first=2e-3)
    print(found)
    assert found[-1] < 1.4


def test_where_a_step_more_is_taken_there_is_no_gradient():
    """Between two times that differ by 1e-4 of themselves, on either side of where a step falls away."""
    low, high = 3.0, 8.0

    def run(tau):
        return stepped(np.where(TAU > 0, tau, START))

    more = len(run(low)[0])
    assert more != len(run(high)[0])
    while high - low > 1e-4 * low:
        middle = (low + high) / 2
        low, high = (middle, high) if len(run(middle)[0]) == more else (low, middle)
    (grid, before), (_, after) = run(low), run(high)
    of = replayed(grid)
    forces = [float(of.evaluate(np.where(TAU > 0, tau, START)).data[0, 0]) for tau in (low, high)]
    slope = of.evaluate(np.where(TAU > 0, low, START)).gradient(np.ones((1, 1)))[2]
    free, held = (after - before) / (high - low) / slope, (forces[1] - forces[0]) / (high - low) / slope
    print(low, free, held)
    assert abs(held - 1) < 1e-3 and abs(free - 1) > 0.5
