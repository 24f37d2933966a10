"""The hereditary law against its integral: H(t) = ∫ exp(-(t - s)/τ) dS̄(s)."""

import numpy as np
import pytest

from ngbrain.materials import step_factors


def overstress(times, stress, tau):
    """The package's recursion over given times and branch stresses."""
    H = 0.0
    for t0, t1, s0, s1 in zip(times, times[1:], stress, stress[1:], strict=False):
        e, beta = step_factors(t1 - t0, np.array([tau]))
        H = e[0] * H + beta[0] * (s1 - s0)
    return H


@pytest.mark.parametrize("tau", [1e-3, 0.3, 10.0, 1e3])
@pytest.mark.parametrize("steps", [1, 7])
def test_ramp_and_hold_is_exact_whatever_the_step(tau, steps):
    times = np.concatenate([np.linspace(0, 2, steps + 1), np.linspace(2, 50, steps + 1)[1:]])
    stress = 3.0 * np.minimum(times, 2.0) / 2.0
    exact = 1.5 * tau * -np.expm1(-2 / tau) * np.exp(-48 / tau)
    assert overstress(times, stress, tau) == pytest.approx(exact, rel=1e-12, abs=1e-300)


def test_curved_histories_are_second_order():
    tau, exact = 2.0, None
    errors = []
    for n in (4096, 8, 16, 32):
        times = np.linspace(0, 3, n + 1)
        value = overstress(times, np.sin(times) ** 2, tau)
        exact = value if exact is None else exact
        errors.append(abs(value / exact - 1))
    rates = np.log2(np.array(errors[1:-1]) / np.array(errors[2:]))
    assert np.all(np.abs(rates - 2) < 0.15)


def test_explicit_stepping_overflows_where_this_does_not():
    # Forward Euler of dH/dt = dS/dt - H/τ grows by |1 - Δt/τ| a step; one step of 1 s meets τ from 1e-3 to 1e3 s.
    naive = 1.0
    for _ in range(150):
        naive *= 1 - 1.0 / 1e-3
    ours = 1.0
    for _ in range(150):
        ours *= step_factors(1.0, np.array([1e-3]))[0][0]
    assert abs(naive) > 1e300 and ours == 0.0
