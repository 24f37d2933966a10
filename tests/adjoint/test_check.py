"""The Taylor test passes right derivatives and fails wrong ones."""

import numpy as np
import pytest

from ngbrain.adjoint.check import taylor

X, DX = np.array([0.7, -1.2, 0.4]), np.array([0.5, 0.3, -0.8])


def f(x):
    return float(np.exp(x[0]) * np.sin(x[1]) + x[2] ** 3)


GRADIENT = np.array([np.exp(X[0]) * np.sin(X[1]), np.exp(X[0]) * np.cos(X[1]), 3 * X[2] ** 2])


def test_right_gradient_has_rate_two():
    assert np.all(np.abs(taylor(f, GRADIENT, X, DX) - 2) < 0.1)


@pytest.mark.parametrize("wrong", [-GRADIENT, 1.001 * GRADIENT, GRADIENT * [1, 0, 1]])
def test_wrong_gradient_falls_to_rate_one(wrong):
    assert taylor(f, wrong, X, DX, steps=8)[-1] < 1.2


def test_a_product_serves_for_vector_functions():
    rates = taylor(lambda x: x**2, lambda dx: 2 * X * dx, X, DX)
    assert np.all(np.abs(rates - 2) < 1e-3)
