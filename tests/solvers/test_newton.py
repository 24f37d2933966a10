"""Newton's method where a step leads out of what has forces."""

import numpy as np
import pytest

from ngbrain.solvers.newton import Newton


class Locking:
    """A spring without forces from x = 1 on, R = 2x/(1 - x²) - f; its determinant is fine everywhere."""

    weights = np.ones(1)

    def __init__(self, load):
        self.load = load

    def residual(self, x):
        force = 2 * x / (1 - x**2) if abs(x[0]) < 1 else np.full(1, np.nan)
        return force - self.load, float(abs(force[0]) + self.load)

    def factorise(self, x, r=None):
        stiffness = 2 * (1 + x[0] ** 2) / (1 - x[0] ** 2) ** 2
        return lambda b: b / stiffness

    def min_det(self, x):
        return 1.0


def test_a_step_into_a_state_without_forces_is_shortened():
    x, record = Newton().solve(Locking(10.0), np.zeros(1))
    assert record.converged and 2 * x[0] / (1 - x[0] ** 2) == pytest.approx(10.0, rel=1e-6)


def test_a_step_that_always_leads_there_is_a_failure_that_says_so():
    x, record = Newton(min_damping=0.9).solve(Locking(10.0), np.zeros(1))
    assert not record.converged and x[0] == 0 and "no finite forces" in record.reason


def test_so_is_a_start_there():
    _, record = Newton().solve(Locking(10.0), np.full(1, 2.0))
    assert record.reason == "the residual is not finite"
