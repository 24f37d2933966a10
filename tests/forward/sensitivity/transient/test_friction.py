"""Derivatives of runs in which walls stick and slide: by what tissue, contact and friction are made of."""

import numpy as np
import pytest
from friction_blocks import VALUES, Sliding, model

from ngbrain.adjoint.check import taylor
from ngbrain.errors import InputError
from ngbrain.forward.observables import Force
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.transient.friction_step import FrictionStep
from ngbrain.forward.sensitivity.transient.run_model import RunModel

GRID = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 8.0)
CASES = {
    "plane strain": {},
    "axisymmetric": {"kind": "axisymmetric"},
    "quadrilaterals": {"kind": "quadrilaterals", "n": 2},
    "space": {"kind": "space", "n": 1, "grid": GRID[:5]},
    "Maxwell": {"law": "Maxwell", "n": 2},
    "elastic": {"law": "elastic"},
    "penalty alone": {"share": 0.0},
}

FAST = ("plane strain", "space", "Maxwell")


def made(case):
    return model(**{"grid": GRID, **CASES[case]})


def weighed(of, there, rng):
    """Weights of all that is not nothing, and their sum with the data at other parameters."""
    w = rng.normal(size=there.data.shape) / (np.abs(there.data).max(axis=0) + 1e-2 * np.abs(there.data).max())
    return w, lambda theta: float(np.sum(w * of.evaluate(theta).data))


def along(of, name):
    direction = np.zeros(of.size)
    direction[of.blocks[name]] = VALUES[name]
    return direction


@pytest.mark.parametrize("case", [pytest.param(case, marks=[] if case in FAST else pytest.mark.slow) for case in CASES])
def test_gradients_are_those_of_differences(case, rng):
    """By every parameter; points that begin to slide between the ends of a difference bend it a little."""
    of = made(case)
    start, there = of.theta.copy(), of.evaluate(of.theta)
    w, value = weighed(of, there, rng)
    gradient, whole = there.gradient(w), np.abs(there.gradient(w) * start).max()
    for name in of.blocks:
        direction = along(of, name)
        there = of.evaluate(start)
        assert np.sum(w * there.jvp(direction)) == pytest.approx(gradient @ direction, rel=1e-7), name
        difference = (value(start + 1e-3 * direction) - value(start - 1e-3 * direction)) / 2e-3
        print(case, name, difference, gradient @ direction)
        assert difference == pytest.approx(gradient @ direction, rel=5e-3, abs=1e-4 * whole), name


@pytest.mark.parametrize("name", ["mu", "g", "tau", "friction", "penalty"])
def test_rates(name, rng):
    of = made("plane strain")
    start, there = of.theta.copy(), of.evaluate(of.theta)
    w, value = weighed(of, there, rng)
    rates = taylor(value, there.gradient(w), start, along(of, name), first=2e-3, steps=3)
    print(name, rates)
    assert rates[1] == pytest.approx(2, abs=0.1), rates


def test_full_slide_has_the_slope_of_coulombs_law():
    """F_t = μN: what friction changes in the tangential force, but for what it changes in the normal one, is N."""
    of = model(GRID, friction=0.05, seen=[Force("top")])
    there = of.evaluate(of.theta)
    direction = np.zeros(of.size)
    direction[of.blocks["friction"]] = 1.0
    change = there.jvp(direction)
    late = 4  # at 3 s all of the top has slid by 2 mm
    tangential, normal = there.data[late]
    assert tangential == pytest.approx(-0.05 * normal, rel=1e-5)
    assert change[late, 0] == pytest.approx(-normal - 0.05 * change[late, 1], rel=1e-5)


def forgotten_end(patch):
    """The slip that a step leaves does not change with where it ends."""
    patch.setattr(FrictionStep, "carried_state_gradient", lambda self, weights: np.zeros(self.body.fes.ndof))


def forgotten_slip(patch):
    """Where a step begins does not depend on the one before."""
    back = FrictionStep.adjoint_gradients
    patch.setattr(
        FrictionStep, "adjoint_gradients", lambda self, a, m: (0 * (found := back(self, a, m))[0], found[1], found[2])
    )


def kept_slip(patch):
    """Slips that are carried on whole."""
    back = FrictionStep.adjoint_gradients
    patch.setattr(FrictionStep, "adjoint_gradients", lambda self, a, m: ((found := back(self, a, m))[0], m, found[2]))


@pytest.mark.parametrize("bug", [forgotten_end, forgotten_slip, kept_slip], ids=lambda bug: bug.__name__)
def test_a_bug_lowers_the_rate(bug, monkeypatch, rng):
    bug(monkeypatch)
    of = made("plane strain")
    start, there = of.theta.copy(), of.evaluate(of.theta)
    w, value = weighed(of, there, rng)
    rates = taylor(value, there.gradient(w), start, along(of, "mu"), first=2e-3, steps=3)
    assert rates[-1] < 1.3, rates


def test_a_run_replays_what_time_stepping_does():
    """The recorded grid taken again with the whole tangent has the forces of the stepping with the symmetric one."""
    from ngbrain.forward.sensitivity.transient.replay import accepted_times
    from ngbrain.forward.transient.step_control import StepControl
    from ngbrain.forward.transient.time_stepper import TimeStepper

    of, plate = model(GRID), Sliding()
    body = of.body
    rows, seen = [], Force("top").on(body)
    stepper = TimeStepper(body, of.replay.motion, StepControl(0.5), 1e-3)
    step = stepper.step
    stepper.step = lambda: (step(), rows.append(seen.value()))[0]
    grid = accepted_times(stepper)
    again = model(grid, seen=[Force("top")])
    assert (
        again.evaluate(again.theta).data == pytest.approx(np.array(rows), rel=1e-4, abs=1e-5)
        and plate.events[-1] == grid[-1]
    )


def twice(of, rng, first=2e-3):
    """Rates of second derivatives along all parameters, and how far these are from symmetric."""
    start, there = of.theta.copy(), of.evaluate(of.theta)
    w, _ = weighed(of, there, rng)
    a, b = start * rng.uniform(0.3, 1, (2, of.size)) * rng.choice([-1, 1], (2, of.size))
    along_a, along_b = there.hvp(w, a), there.hvp(w, b)
    uneven = abs(along_a @ b - along_b @ a) / (np.abs(along_a * b).sum() + np.abs(along_b * a).sum())
    slope = lambda t: of.evaluate(t).gradient(w) * start  # noqa: E731
    return taylor(slope, lambda d: along_a * start, start, a, first=first, steps=3), uneven


@pytest.mark.parametrize("case", [pytest.param(case, marks=[] if case in FAST else pytest.mark.slow) for case in CASES])
def test_second_derivatives(case, rng):
    rates, uneven = twice(made(case), rng, 5e-4)
    print(case, rates, uneven)
    assert uneven < 1e-9 and np.sort(rates)[1] == pytest.approx(2, abs=0.1)


def test_a_slip_that_stays_lowers_their_rate(rng, monkeypatch):
    changed = FrictionStep.set_direction
    monkeypatch.setattr(FrictionStep, "set_direction", lambda self, x, y, e, theta: changed(self, x, y, 0 * e, theta))
    rates, _ = twice(made("plane strain"), rng, 5e-4)
    assert rates[-1] < 1.3, rates


def test_what_is_not_derived_is_refused():
    with pytest.raises(InputError, match=r"NodePositions; wanted: others, for a body with friction or inertia"):
        solid = model(GRID, kind="space", n=1)
        RunModel(solid.body, solid.replay.motion, GRID, {"nodes": NodePositions(solid.body.mesh)}, [Force("top")])
    with pytest.raises(InputError, match=r"shares no node with 'top', which has friction"):
        model(GRID, kind="axisymmetric", seen=[Force("left")])
