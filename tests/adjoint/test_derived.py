"""Dose, time above a threshold, amplitude and phase: closed forms, Taylor rates, transposes."""

import ngsolve as ngs
import numpy as np
import pytest
from optimiser_models import waves
from scipy.interpolate import PchipInterpolator

from ngbrain.adjoint.check import dot, taylor
from ngbrain.adjoint.derived import Amplitude, Derived, Dose, Phase, TimeAbove
from ngbrain.adjoint.reduced import Reduced
from ngbrain.adjoint.time_curve import Interpolation, TimeCurve, monotone_slopes
from ngbrain.errors import InputError
from ngbrain.forward import Material, Problem, RigidContact, RunModel
from ngbrain.forward.observables import Force, patch_pressure
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import LogTransform, ParameterFields, Unknown
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.materials import NeoHooke, Prony
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

SIDE, GRID = 0.02, np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0])


def pressed():
    """A relaxing block under a plate that presses and stops: pressure and force over time."""
    drive = Drive(ToolMotion("press", (0.0, 2.0, 8.0), (0.0, 1e-3, 1e-3)))
    plate = RigidContact("top", lambda x: SIDE - drive.parameter - x[2], 1e8, 2e-5)
    mu, g = ngs.Parameter(1000.0), ngs.Parameter(0.5)
    tissue = Material(Prony(NeoHooke(mu), [g], [3.0]), 1e6)
    body = Problem(block((SIDE,) * 3, SIDE), {"tissue": tissue}, {"bottom": 0}, contacts=[plate], element="P2/P1")
    seen = [patch_pressure(plate), Force("bottom", (0, 0, 1))]
    return RunModel(body, drive, GRID, {"mu": mu, "g": g}, seen)


def check(of, theta, direction, rng, first=0.01, second=True):
    there = of.evaluate(theta)
    w = rng.normal(size=there.data.shape) / np.abs(there.data).max(axis=0)
    if np.iscomplexobj(there.inner.data):  # by symmetry some hardly move, where neither has a slope
        size = np.abs(there.inner.data)
        w = np.where(size > 0.05 * size.max(), rng.normal(size=size.shape), 0.0)
    assert dot(there.jvp, there.vjp(w), direction, w) < 1e-9
    assert there.gradient(w) == pytest.approx(there.vjp(w), rel=1e-7, abs=1e-9 * np.abs(there.vjp(w)).max())
    rates = taylor(lambda t: float(np.sum(w * of.evaluate(t).data)), there.gradient(w), theta, direction, 3, first)
    assert np.all(np.abs(rates - 2) < 0.15), rates
    if second:
        size = np.concatenate([np.full(p.stop - p.start, np.abs(theta[p]).max()) for p in of.model.blocks.values()])
        there = of.evaluate(theta)
        rates = taylor(
            lambda t: of.evaluate(t).gradient(w) * size, lambda d: there.hvp(w, d) * size, theta, direction, 3, first
        )
        assert np.all(np.abs(rates - 2) < 0.15), rates


@pytest.mark.parametrize("quantity", [Amplitude(), Phase()], ids=lambda q: q.name)
def test_amplitude_and_phase_of_waves(quantity, rng):
    model = waves()
    theta = model.theta
    direction = theta * rng.uniform(-1, 1, len(theta))
    check(Derived(model, quantity), theta, direction, rng, first=0.02)
    data = model.evaluate(theta).data
    assert quantity.value(data) == pytest.approx({"amplitude": np.abs, "phase": np.angle}[quantity.name](data))


def test_dose_and_time_above_of_a_run(rng):
    model = pressed()
    theta = model.theta
    direction = theta * np.array([1.0, -0.4])
    pressure = model.evaluate(theta).data[:, 0]
    check(Derived(model, Dose(model.times)), theta, direction, rng, second=False)
    above = TimeAbove(model.times, 0.8 * pressure.max(), 0.1 * pressure.max())
    check(Derived(model, above), theta, direction, rng, second=False)
    with pytest.raises(InputError, match="second derivatives"):
        Derived(model, above).evaluate(theta).hvp(np.ones(2), direction)


def test_dose_and_time_above_of_the_cubic_of_a_report(rng):
    """The curve of a retraction's report, which bends at events, with derivatives; slopes of it are scipy's."""
    model = pressed()
    theta = model.theta
    direction, cubic = theta * np.array([1.0, -0.4]), (Interpolation.MONOTONE_CUBIC, [0.0, 2.0, 8.0])
    data = model.evaluate(theta).data
    dose, peak = Dose(model.times, *cubic), data[:, 0].max()
    check(Derived(model, dose), theta, direction, rng, second=False)
    check(Derived(model, TimeAbove(model.times, 0.8 * peak, 0.1 * peak, *cubic)), theta, direction, rng, second=False)
    curve = TimeCurve(GRID, [0.0, *data[:, 0]], [0.0, 2.0, 8.0])
    assert dose.value(data)[0] == curve.integral() != Dose(model.times).value(data)[0]
    narrow = TimeAbove(model.times, 0.8 * peak, 1e-3 * peak, *cubic)
    assert narrow.value(data)[0] == pytest.approx(narrow.raw(data)[0], rel=0.01)
    assert narrow.raw(data)[0] == curve.above(0.8 * peak)[0]
    with pytest.raises(InputError, match="second derivatives"):
        dose.vjp_derivative(data, np.ones(2), data)


@pytest.mark.parametrize("n", [2, 3, 9])
def test_slopes_of_a_monotone_cubic(n, rng):
    """Scipy's to the last digits, also where values turn or an end would overshoot; their changes by differences."""
    for _ in range(20):
        t, values = np.cumsum(rng.uniform(0.1, 1, n)), rng.normal(size=n)
        slopes, change = monotone_slopes(t, values)
        assert slopes == pytest.approx(PchipInterpolator(t, values).derivative()(t), rel=1e-9, abs=1e-12)
        direction = rng.normal(size=n)
        ahead, behind = (monotone_slopes(t, values + h * direction)[0] for h in (1e-6, -1e-6))
        assert change @ direction == pytest.approx((ahead - behind) / 2e-6, rel=1e-5, abs=1e-6)


def test_a_ramp_in_closed_form():
    times = np.linspace(0.0, 10.0, 41)[1:]
    ramp = 2.0 * times[:, None]
    assert Dose(times).value(ramp) == pytest.approx([100.0])
    assert TimeAbove(times, 5.0, 1e-3).raw(ramp) == pytest.approx([7.5])
    narrow, wide = (TimeAbove(times, 5.0, width).value(ramp)[0] for width in (0.01, 1.0))
    assert narrow == pytest.approx(7.5, abs=1e-6) and wide == pytest.approx(
        (np.logaddexp(0, 15) - np.logaddexp(0, -5)) / 2
    )
    held = np.full((40, 1), 6.0)
    assert TimeAbove(times, 5.0, 0.01).value(held) == pytest.approx([10.0 - 0.25 * 5 / 6], rel=1e-6)
    for bad in ([0.0, 1.0], [2.0, 1.0]):
        with pytest.raises(InputError, match="times"):
            Dose(bad)
    with pytest.raises(InputError, match="width"):
        TimeAbove(times, 5.0, 0.0)


def test_a_modulus_from_a_dose():
    """As data of an inversion: twice the dose is nearly twice the modulus."""
    model = pressed()
    theta = model.theta
    dose = Derived(model, Dose(model.times))
    wanted = dose.evaluate(theta * [1.5, 1.0]).data
    unknowns = ParameterFields(theta, model.blocks, {"mu": Unknown(theta[model.blocks["mu"]], LogTransform())})
    reduced = Reduced(dose, LeastSquares(wanted, 0.01 * wanted), unknowns, {}, {})
    found = levenberg_marquardt(reduced, unknowns.start)
    assert unknowns.theta(found.x)[model.blocks["mu"]] == pytest.approx([1500.0], rel=1e-4)
