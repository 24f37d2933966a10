"""Newton's method where a step leads out of what has forces."""

import numpy as np
import pytest

from ngbrain.solvers.newton import Newton, _broyden


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


def test_steps_without_a_new_factor_are_those_of_broydens_good_update(rng):
    """For a linear system it ends within twice as many steps as there are unknowns (Gay 1979, 10.1137/0716047)."""
    n = 4
    matrix, load = np.eye(n) + 0.3 * rng.uniform(-1, 1, (n, n)), rng.uniform(-1, 1, n)
    weights = np.full(n, 3.0)  # the same for all, so that they say nothing of directions
    x = np.zeros(n)
    step = load.copy()  # by the old factor, which is that of the unit matrix
    chain, left = [], []
    for _ in range(2 * n):
        chain.append((step, float(np.sqrt(weights @ step**2))))
        x = x + step
        v = load - matrix @ x
        left.append(np.linalg.norm(v))
        step, contraction = _broyden(chain, v, weights)
        if len(chain) == 1:
            assert contraction == pytest.approx(np.sqrt(weights @ v**2) / chain[0][1])
    assert left[-1] < 1e-6 * left[0]
