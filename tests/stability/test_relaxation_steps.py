"""Steps much longer than relaxation times. Naive: difference rules for dH/dt = dS̄/dt - H/τ. Ours: its exact solution.

All go through the same body and the same step, H ← e H + β ΔS̄: forward Euler has e = 1 - x, β = 1 with x = Δt/τ, backward Euler
e = β = 1/(1 + x), Crank–Nicolson e = (1 - x/2)/(1 + x/2), β = 1/(1 + x/2); ours e = exp(-x), β = (1 - e)/x.
"""

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import SolverError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid import internal_variables as history
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import Branch, Maxwell, NeoHooke, Viscous, step_factors
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, continuous_retraction

SIDE, MU, BULK = 0.02, 100.0, 1e5
TIMES = 10.0 ** np.arange(-3, 4)
TAU, SHARE, DEPTH = 1.0, 4.0, 2e-4
"""Of the pressed block: relaxation time (s), relaxing over lasting modulus, depth (m)."""


def forward_euler(dt, tau):
    return 1 - dt / tau, np.ones_like(tau)


def backward_euler(dt, tau):
    return 1 / (1 + dt / tau), 1 / (1 + dt / tau)


def crank_nicolson(dt, tau):
    half = dt / tau / 2
    return (1 - half) / (1 + half), 1 / (1 + half)


def ramp_and_hold(t, ramp, tau):
    """Overstress of a branch over its modulus times the strain held, ∫ exp(-(t - s)/τ) ds/T over the ramp T."""
    return tau / ramp * -np.expm1(-np.minimum(t, ramp) / tau) * np.exp(-np.maximum(t - ramp, 0) / tau)


def sheared(branches, strain=1e-4, steps=30):
    """Mean shear stress (Pa) over its closed form of a block that is sheared evenly in two steps of 1 s, and held."""
    body = Problem(
        block((SIDE,) * 3, SIDE),
        {"tissue": Material(Viscous(NeoHooke(MU), branches), BULK)},
        {"bottom": 0},
        element="P2/P1",
    )
    along, found = ngs.GridFunction(body.fes.components[0]), []
    along.Set(ngs.CF((ngs.z, 0, 0)))
    for i in range(steps):
        body.u.vec.data = strain * min((i + 1) / 2, 1.0) * along.vec
        body.begin(1.0)
        found.append(body.tissue_forces() @ along.vec.FV().NumPy() / SIDE**3)
        body.history.finish()
    t = 1.0 + np.arange(steps)
    whole = np.minimum(t / 2, 1) + sum(ramp_and_hold(t, 2.0, tau) for tau in TIMES)
    return np.array(found) / (MU * strain * whole)


HEREDITARY = tuple(Branch(NeoHooke(MU), tau) for tau in TIMES)
FLOWING = tuple(Maxwell(NeoHooke(MU), MU * tau) for tau in TIMES)


def test_forward_euler_multiplies_the_stress_of_a_millisecond_by_a_thousand_each_step(monkeypatch):
    monkeypatch.setattr(history, "step_factors", forward_euler)
    ratio = sheared(HEREDITARY)
    print("largest stress over exact", np.abs(ratio).max())
    assert np.abs(ratio).max() > 1e80


@pytest.mark.parametrize(("branches", "error"), [(HEREDITARY, 1e-9), (FLOWING, 1e-5)], ids=["hereditary", "Maxwell"])
def test_a_millisecond_to_a_quarter_of_an_hour_at_one_step(branches, error):
    ratio = sheared(branches)
    print("largest error", np.abs(ratio - 1).max())
    assert np.abs(ratio - 1).max() < error


def held(dt):
    """Overstress during a hold of 20 even steps, over its closed form at the hold's start, and that closed form over time.

    A plate presses a block without friction, so the relaxing force is that of the lasting modulus times a number.
    """
    ramp, law = max(dt, 5.0), NeoHooke(300.0)
    drive = Drive(continuous_retraction(DEPTH, ramp, ramp + 20 * dt))
    contact = RigidContact("top", lambda x: SIDE - drive.parameter - x[2], 1e10, 2e-7)
    material = Material(Viscous(law, (Branch(NeoHooke(300.0 * SHARE), TAU),)), 1.5e6)
    body = Problem(block((SIDE,) * 3, SIDE), {"tissue": material}, {"bottom": 0}, contacts=[contact], element="P2/P1")
    elastic = Problem(body.mesh, {"tissue": Material(law, 1.5e6)}, {"bottom": 0}, contacts=[contact], element="P2/P1")
    up = ngs.GridFunction(body.fes.components[0])
    up.Set(ngs.CF((0, 0, 1)))
    rows = []

    def watch(b, at, record):
        rows.append((at.t, up.vec.FV().NumPy() @ b.contact_forces()))

    TimeStepper(elastic, drive, StepControl(ramp), 1e-3).run(watch, until=ramp)
    lasting = rows[-1][1]
    rows.clear()
    control = StepControl(dt, first=1.0, restart=1.0, growth=1.0, touch_growth=1.0, dt_max=dt, smallest=0.9)
    TimeStepper(body, drive, control, 1e-3).run(watch)
    t, force = np.array(rows)[-21:].T
    start = SHARE * ramp_and_hold(ramp, ramp, TAU)
    return (force / lasting - 1) / start, np.exp(-(t - ramp) / TAU)


@pytest.mark.parametrize("dt", [0.5, 2.5, 20.0])
def test_ours_is_at_the_closed_form_whatever_the_step(dt):
    found, exact = held(dt)
    print("largest error", np.abs(found - exact).max())
    assert np.abs(found - exact).max() < 0.02


def test_forward_euler_dies_beyond_two_relaxation_times(monkeypatch):
    monkeypatch.setattr(history, "step_factors", forward_euler)
    found, exact = held(0.5)
    assert np.abs(found - exact).max() < 0.3
    with pytest.raises(SolverError):
        held(2.5)


def test_crank_nicolson_rings(monkeypatch):
    monkeypatch.setattr(history, "step_factors", crank_nicolson)
    found, _ = held(20.0)
    print(found)
    assert np.all(found[1:] * found[:-1] < 0)  # more and less than at rest, in turns
    assert found[1] < -1.3 and abs(found[-1]) > 0.03  # the exact overstress is 2e-9 of the start's after one step


def test_backward_euler_forgets_slowly(monkeypatch):
    monkeypatch.setattr(history, "step_factors", backward_euler)
    found, exact = held(2.5)
    print(found[1] / exact[1])
    assert np.all(np.diff(found) < 1e-9) and found[1] > 2.5 * exact[1]  # round-off in the end


def test_the_rules_are_those_of_the_equation():
    # First and second order: else the pairs above would fail for a reason of their own.
    x = np.array([1e-3])
    exact_e, exact_beta = step_factors(x, np.ones(1))
    for rule, order in ((forward_euler, 1), (backward_euler, 1), (crank_nicolson, 2)):
        e, beta = rule(x, np.ones(1))
        assert abs(e - exact_e) < x ** (order + 1) and abs(beta - exact_beta) < x
