"""JAX's own check of derivatives, ours, and its transformations."""

import sys

import numpy as np
import pytest
from optimiser_models import MODULUS

from ngbrain.adjoint.check import taylor
from ngbrain.errors import InputError, MissingExtra
from ngbrain.interop.jax import function

SIZE = 1e3
"""1/m: displacements are of size one in mm."""


def same(a, b):
    np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12 * np.abs(b).max())


@pytest.fixture
def scaled(jax, waves):
    """ln of the moduli (9,) ↦ waves in mm, by JAX's functions around ours."""
    f, held = function(waves, waves.theta), waves.theta[waves.blocks["boundary"]]
    return lambda x: SIZE * f(jax.numpy.concatenate([MODULUS * jax.numpy.exp(x), held]))


@pytest.mark.parametrize("compiled", [False, True], ids=["plain", "jit"])
def test_value_and_gradient_are_the_states(jax, waves, around, compiled):
    theta, w = around(waves, waves.evaluate(waves.theta).data)
    state = waves.evaluate(theta)
    data, gradient = state.data, state.gradient(w)
    f = function(waves, waves.theta)

    def weighed(x):
        y = f(x)
        return (w.conj() * y).sum().real, y

    both = jax.value_and_grad(weighed, has_aux=True)
    (_, y), slope = (jax.jit(both) if compiled else both)(jax.numpy.array(theta))
    same(y, data)
    same(slope, gradient)


def test_rates(jax, scaled, rng):
    x, dx = 0.1 * rng.normal(size=9), rng.normal(size=9)
    target = rng.normal(size=(1, 25, 2)) + 1j

    @jax.jit
    def loss(x):
        return (abs(scaled(x) - target) ** 2).sum()

    rates = taylor(lambda x: float(loss(x)), np.array(jax.grad(loss)(x)), x, dx)
    assert np.all(np.abs(rates - 2) < 0.1)


def test_check_grads(jax, scaled, rng):
    from jax.test_util import check_grads

    check_grads(scaled, (0.1 * rng.normal(size=9),), order=1, modes=["rev"], atol=1e-6, rtol=1e-6, eps=1e-5)


def test_real_data(jax, real, rng):
    from jax.test_util import check_grads

    f = function(real, np.zeros(8))
    assert f(np.zeros(8)).dtype == np.float64
    check_grads(f, (0.1 * rng.normal(size=8),), order=1, modes=["rev"], atol=1e-6, rtol=1e-6, eps=1e-5)


def test_vmap(jax, waves, around):
    thetas = np.array([around(waves, waves.evaluate(waves.theta).data)[0] for _ in range(3)])
    states = [(s.data, s.gradient(2 * s.data)) for s in map(waves.evaluate, thetas)]
    f = function(waves, waves.theta)

    def loss(x):
        y = f(x)
        return (abs(y) ** 2).sum(), y

    slopes, y = jax.jit(jax.vmap(jax.grad(loss, has_aux=True)))(thetas)
    for k, (data, gradient) in enumerate(states):
        same(y[k], data)
        same(slopes[k], gradient)


def test_objective(jax, inversion, rng):
    start = inversion.unknowns.start
    x = start + 0.1 * rng.normal(size=start.size)
    point = inversion.evaluate(x)
    value, gradient = point.value, point.gradient()
    J = function(inversion, start)
    found, slope = jax.jit(jax.value_and_grad(lambda x: 3 * J(x)))(x)
    assert found.shape == () and float(found) == pytest.approx(3 * value, rel=1e-12)
    same(slope, 3 * gradient)
    rates = taylor(lambda x: float(J(x)), gradient, x, rng.normal(size=x.size), first=1e-3)
    assert np.all(np.abs(rates - 2) < 0.1)


def test_one_solve_for_value_and_gradient(jax, waves):
    f = function(waves, waves.theta)
    theta = 1.1 * waves.theta
    jax.jit(jax.grad(lambda x: (abs(f(x)) ** 2).sum()))(theta).block_until_ready()
    assert (waves.solves.factorisations, waves.solves.adjoint) == (1 + 1, 1)  # one for the shape of the data


def test_no_solution_is_not_a_number(jax, real):
    f = jax.jit(jax.value_and_grad(lambda x: function(real, np.zeros(8))(x).sum()))
    value, slope = f(np.ones(8))
    assert np.isnan(value) and np.all(np.isnan(slope))
    value, slope = f(np.zeros(8))
    assert np.isfinite(value) and np.all(np.isfinite(slope))


def test_single_precision_is_refused(jax, real):
    f = function(real, np.zeros(8))
    with pytest.raises(InputError, match=r"x is float32 of shape \(8,\); wanted: float64 of shape \(8,\)"):
        f(np.zeros(8, np.float32))
    with pytest.raises(InputError, match=r"x is float64 of shape \(9,\)"):
        jax.jit(f)(np.zeros(9))
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(InputError, match=r"jax_enable_x64 is False; wanted: jax\.config\.update"):
            function(real, np.zeros(8))
    finally:
        jax.config.update("jax_enable_x64", True)


def test_missing_package_is_named(monkeypatch, real):
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(MissingExtra, match=r'jax is not installed; get it with: pip install "ngbrain\[interop\]"'):
        function(real, np.zeros(8))
