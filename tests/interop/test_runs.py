"""Runs through time, with data of two dimensions, through the faces."""

import numpy as np
import pytest
from relaxing_blocks import model, weights

from ngbrain.interop import jax as to_jax
from ngbrain.interop import torch as to_torch
from ngbrain.interop import umbridge as to_umbridge


def same(a, b):
    """As far as Newton's method goes: each answer is of a run of its own."""
    np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8 * np.abs(b).max())


@pytest.fixture(scope="module")
def run():
    return model("relaxing")


@pytest.fixture
def right(run, rng):
    """θ, data there, weights and the gradient."""
    theta = run.theta
    there = run.evaluate(theta)
    w = weights(there.data, rng)
    return theta, there.data, w, there.gradient(w)


def test_torch(torch, run, right):
    theta, data, w, gradient = right
    x = torch.tensor(theta, requires_grad=True)
    y = to_torch.function(run)(x)
    (torch.from_numpy(w) * y).sum().backward()
    same(y.detach().numpy(), data)
    same(x.grad.numpy(), gradient)


def test_jax(jax, run, right):
    theta, data, w, gradient = right
    f = to_jax.function(run, theta)
    slope = jax.jit(jax.grad(lambda x: (w * f(x)).sum()))(theta)
    same(f(theta), data)
    same(slope, gradient)


def test_umbridge(umbridge, run, right):
    theta, data, w, gradient = right
    served = to_umbridge.model(run, theta)
    assert served.get_output_sizes() == [data.size] and served.supports_apply_hessian()
    same(served([theta.tolist()])[0], data.ravel())
    same(served.gradient(0, 0, [theta.tolist()], w.ravel().tolist()), gradient)
    second = run.evaluate(theta).hvp(w, theta)
    same(served.apply_hessian(0, 0, 0, [theta.tolist()], w.ravel().tolist(), theta.tolist()), second)
