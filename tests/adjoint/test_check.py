"""The Taylor test passes right derivatives and fails wrong ones, the dot test right and wrong transposes."""

import numpy as np
import pytest

from ngbrain.adjoint.check import dot, taylor

X, DX = np.array([0.7, -1.2, 0.4]), np.array([0.5, 0.3, -0.8])


def f(x):
    return float(np.exp(x[0]) * np.sin(x[1]) + x[2] ** 3)


GRADIENT = np.array([np.exp(X[0]) * np.sin(X[1]), np.exp(X[0]) * np.cos(X[1]), 3 * X[2] ** 2])


@pytest.mark.parametrize("steps", [1, 4])
def test_right_gradient_has_rate_two(steps):
    rates = taylor(f, GRADIENT, X, DX, steps)
    assert rates.shape == (steps,) and np.all(np.abs(rates - 2) < 0.1)


@pytest.mark.parametrize("wrong", [-GRADIENT, 1.001 * GRADIENT, GRADIENT * [1, 0, 1]])
def test_wrong_gradient_falls_to_rate_one(wrong):
    assert taylor(f, wrong, X, DX, steps=8)[-1] < 1.2


def test_a_product_serves_for_vector_functions():
    rates = taylor(lambda x: x**2, lambda dx: 2 * X * dx, X, DX)
    assert np.all(np.abs(rates - 2) < 1e-3)


@pytest.fixture
def waves(rng):
    """A complex J, as of waves with loss; a real direction and complex weights."""
    J = rng.normal(size=(7, 4)) + 1j * rng.normal(size=(7, 4))
    return J, rng.normal(size=4), rng.normal(size=7) + 1j * rng.normal(size=7)


def test_transposes_pass_as_functions_and_as_products(waves):
    J, dx, w = waves
    assert dot(lambda v: J @ v, lambda w: (J.T @ np.conj(w)).real, dx, w) < 1e-13
    assert dot(J @ dx, (J.T @ np.conj(w)).real, dx, w) < 1e-13


def test_wrong_transposes_fail(waves):
    J, dx, w = waves
    right = (J.T @ np.conj(w)).real
    lost = np.where(np.arange(4) == 2, 0, right)
    for wrong in (-right, 1.001 * right, (J.T @ w).real, (np.conj(J).T @ np.conj(w)).real, lost):
        assert dot(J @ dx, wrong, dx, w) > 3e-5


def test_units_of_data_and_parameters_do_not_matter(waves):
    """An error of a thousandth in what is small in its unit is not hidden by what is large."""
    J, dx, w = waves
    data, parameters = 10.0 ** np.arange(-9, 12, 3), 10.0 ** np.arange(-6, 6, 3)
    wrong = (J.T @ np.conj(w)).real * (1 + 1e-3 * (np.arange(4) == 0))
    usual = dot(J @ dx, wrong, dx, w)
    assert usual > 1e-5 and dot(data * (J @ dx), wrong / parameters, parameters * dx, w / data) == pytest.approx(usual)


def test_data_that_do_not_change(waves):
    _, dx, w = waves
    assert dot(np.zeros(7), np.zeros(4), dx, w) == 0 and dot(np.zeros(7), np.ones(4), dx, w) > 0.1
