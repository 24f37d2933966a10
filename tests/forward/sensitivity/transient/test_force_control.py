"""Derivatives of runs with a tool of given force: by that force, and by all that a body is made of, once and twice."""

import numpy as np
import pytest
from force_models import AGAIN, GRID, HELD, checked, forced, weighed

from ngbrain.adjoint.check import taylor
from ngbrain.errors import InputError
from ngbrain.forward.contact.force_control import PrescribedForce
from ngbrain.forward.observables import Force
from ngbrain.forward.sensitivity.contact_work import ContactForms
from ngbrain.forward.sensitivity.transient.friction_step import FrictionStep
from ngbrain.forward.sensitivity.transient.replay import accepted_times
from ngbrain.forward.sensitivity.transient.run_linearisation import RunLinearisation
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper

CASES = {
    "plane strain": {},
    "penalty alone": {"share": 0.0, "law": "elastic"},
    "friction": {"rubs": True},
    "friction, still": {"rubs": True, "along": 0.0, "program": AGAIN},
    "mass, Maxwell": {"mass": True, "law": "Maxwell"},
    "friction, mass": {"rubs": True, "mass": True, "law": "elastic"},
    "friction, pressure, Maxwell": {"rubs": True, "pushed": True, "law": "Maxwell"},
    "axisymmetric": {"kind": "axisymmetric", "rubs": True, "law": "elastic"},
    "quadrilaterals": {"kind": "quadrilaterals", "pushed": True},
    "space": {"kind": "space", "n": 1},
    "pressed again": {"program": AGAIN},
}
FAST = ("plane strain", "friction", "mass, Maxwell", "quadrilaterals", "pressed again")


@pytest.mark.parametrize("case", [pytest.param(case, marks=[] if case in FAST else pytest.mark.slow) for case in CASES])
def test_rates_once_and_twice(case, rng):
    rates, twice, apart, uneven = checked(forced(**CASES[case]), rng)
    print(case, rates, twice, apart, uneven)
    assert rates == pytest.approx([2, 2], abs=0.1) and twice == pytest.approx([2, 2], abs=0.1)
    assert apart < 1e-7 and uneven < 1e-8


@pytest.mark.parametrize("case", [{}, {"program": AGAIN}, {"rubs": True}])
def test_the_plate_exerts_what_it_is_asked_for(case):
    """In the plane the force is the normal force, and friction's along where the plate goes aside by half of its way."""
    of = forced(seen=[Force("top")], **case)
    there = of.evaluate(of.theta)
    across, down = there.jacobian[of.blocks["force"]][0].T
    times, parts = case.get("program", HELD)
    asked = np.interp(GRID[1:], times, parts)
    assert -down + 0.5 * across * bool(case.get("rubs")) == pytest.approx(asked, abs=1e-6)
    others = [i for name, where in of.blocks.items() if name != "force" for i in range(where.start, where.stop)]
    if not case.get("rubs"):
        sizes = of.theta[others, None]
        assert np.abs(there.jacobian[others, :, 1] * sizes).max() < 1e-6


def test_it_replays_what_time_stepping_does():
    of = forced()
    rows, seen = [], Force("bottom").on(of.body)
    stepper = TimeStepper(of.body, of.replay.motion, StepControl(0.5), 1e-3)
    step = stepper.step
    stepper.step = lambda: (step(), rows.append(seen.value()))[0]
    grid = accepted_times(stepper)
    again = RunModel(of.body, of.replay.motion, grid, of.parameters, [Force("bottom")])
    assert again.evaluate(again.theta).data == pytest.approx(np.array(rows), rel=1e-4, abs=1e-5) and len(rows) > 4


def test_steps_that_are_solved_again_give_the_same(rng):
    of, other = forced(program=AGAIN), forced(program=AGAIN)
    other.replay._store_states = False
    w, _ = weighed(of, rng)
    assert other.evaluate(of.theta).gradient(w) == pytest.approx(of.evaluate(of.theta).gradient(w), rel=1e-6)


def free_border(patch):
    """What is felt does not change with the tissue."""
    patch.setattr(ContactForms, "tool_force_state_gradient", lambda self: np.zeros(self._body.fes.ndof))


def free_force(patch):
    """The force asked for stays."""
    patch.setattr(PrescribedForce, "gradient", lambda self, t, parameter: 0.0)


def forgotten_way(patch):
    """Friction does not see where the plate was when the step began."""
    back = FrictionStep.adjoint_gradients
    patch.setattr(
        FrictionStep,
        "adjoint_gradients",
        lambda self, a, m: ((f := back(self, a, m))[0] * ([1] * self._n + [0]), *f[1:]),
    )


BUGS = {free_border: {}, free_force: {}, forgotten_way: {"rubs": True}}


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.__name__)
def test_a_bug_lowers_the_rate(bug, monkeypatch, rng):
    bug(monkeypatch)
    of = forced(**BUGS[bug])
    start = of.theta.copy()
    w, value = weighed(of, rng)
    rates = taylor(value, of.evaluate(start).gradient(w), start, 0.7 * start, first=5e-3, steps=2)
    assert np.all(rates < 1.3), rates


def test_a_way_that_stays_lowers_that_of_second_derivatives(monkeypatch, rng):
    changes = RunLinearisation._changes_backwards

    def still(self, direction):
        for step, x, before in changes(self, direction):
            yield step, np.append(x[:-1], 0.0), before

    monkeypatch.setattr(RunLinearisation, "_changes_backwards", still)
    _, twice, _, _ = checked(forced(), rng)
    assert np.all(twice < 1.3), twice


def test_what_is_not_derived_is_refused():
    with pytest.raises(InputError, match="motion is a force that returns after it was zero"):
        forced(rubs=True, program=AGAIN)
    of = forced()
    with pytest.raises(InputError, match="motion is PrescribedForce; wanted: the PrescribedForce among"):
        other = PrescribedForce((0.0, 8.0), (0.0, 1.0), away=-1e-3, nudge=1e-6)
        RunModel(of.body, other, GRID, {"mu": of.parameters["mu"]}, [Force("bottom")])
    with pytest.raises(InputError, match=r"parameters\.way is the motion's own parameter"):
        RunModel(of.body, of.replay.motion, GRID, {"way": of.replay.motion.parameter}, [Force("bottom")])
