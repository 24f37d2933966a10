"""PyTorch's own check of derivatives, ours, and a network that learns a field through the solver."""

import sys

import numpy as np
import pytest
from optimiser_models import MODULUS, SIDE

from ngbrain.adjoint.check import taylor
from ngbrain.errors import ConvergenceError, InputError, MissingExtra
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveLinearisation
from ngbrain.interop.torch import function

SIZE = 1e3
"""1/m: displacements are of size one in mm."""


def same(a, b):
    np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12 * np.abs(b).max())


@pytest.fixture
def scaled(torch, waves):
    """ln of the moduli (9,) ↦ waves in mm, by PyTorch's functions around ours."""
    f, held = function(waves), torch.from_numpy(waves.theta)[waves.blocks["boundary"]]
    return lambda x: SIZE * f(torch.cat([MODULUS * torch.exp(x), held]))


def test_value_and_gradient_are_the_states(torch, waves, around):
    theta, w = around(waves, waves.evaluate(waves.theta).data)
    state = waves.evaluate(theta)
    data, gradient = state.data, state.gradient(w)
    x = torch.tensor(theta, requires_grad=True)
    y = function(waves)(x)
    (torch.from_numpy(w).conj() * y).sum().real.backward()
    same(y.detach().numpy(), data)
    same(x.grad.numpy(), gradient)


def test_rates(torch, scaled, rng):
    x, dx = torch.tensor(0.1 * rng.normal(size=9), requires_grad=True), rng.normal(size=9)
    target = torch.tensor(rng.normal(size=(1, 25, 2)) + 1j)

    def loss(x):
        return (scaled(x) - target).abs().square().sum()

    loss(x).backward()
    rates = taylor(lambda x: float(loss(torch.tensor(x))), x.grad.numpy(), x.detach().numpy(), dx)
    assert np.all(np.abs(rates - 2) < 0.1)


FORWARD = pytest.mark.filterwarnings("ignore:.torch.jit.script:DeprecationWarning")
"""PyTorch's own, the first time that it differentiates forward."""


@FORWARD
def test_gradcheck(torch, scaled, rng):
    x = torch.tensor(0.1 * rng.normal(size=9), requires_grad=True)
    assert torch.autograd.gradcheck(scaled, (x,), eps=1e-6, atol=1e-7, rtol=1e-5, check_forward_ad=True)


@FORWARD
def test_real_data(torch, real, rng):
    x = torch.tensor(0.1 * rng.normal(size=8), requires_grad=True)
    assert function(real)(x).dtype == torch.float64
    assert torch.autograd.gradcheck(function(real), (x,), check_forward_ad=True)


def test_sum_over_many_theta(torch, waves, around):
    """Backward comes to the first θ last, when the model has long moved on."""
    thetas = [around(waves, waves.evaluate(waves.theta).data)[0] for _ in range(3)]
    truth = []
    for theta in thetas:
        state = waves.evaluate(theta)
        truth.append(state.gradient(2 * state.data))
    x, f = torch.tensor(np.array(thetas), requires_grad=True), function(waves)
    torch.stack([f(each) for each in x]).abs().square().sum().backward()
    same(x.grad.numpy(), np.array(truth))


def test_objective(torch, inversion, rng):
    start = inversion.unknowns.start + 0.1 * rng.normal(size=inversion.unknowns.start.size)
    point = inversion.evaluate(start)
    value, gradient = point.value, point.gradient()
    x = torch.tensor(start, requires_grad=True)
    J = function(inversion)(x)
    (3 * J).backward()
    assert J.shape == () and J.item() == pytest.approx(value, rel=1e-12)
    same(x.grad.numpy(), 3 * gradient)
    dx = rng.normal(size=start.size)
    rates = taylor(lambda x: float(function(inversion)(torch.tensor(x))), gradient, start, dx, first=1e-3)
    assert np.all(np.abs(rates - 2) < 0.1)


def test_one_solve_for_forward_and_backward(torch, waves):
    x = torch.tensor(waves.theta, requires_grad=True)
    function(waves)(x).abs().square().sum().backward()
    assert (waves.solves.factorisations, waves.solves.forward, waves.solves.adjoint) == (1, 1, 1)


def test_network_learns_a_field_through_the_solver(torch, waves):
    """Weights of a network of the places, not the moduli, are what is looked for."""
    torch.manual_seed(0)
    nodes = torch.tensor(np.array([v.point for v in waves.body.mesh.vertices])) / SIDE
    truth = MODULUS * torch.exp(0.6 * torch.tanh(3 * nodes[:, 0] - 2 * nodes[:, 1] - 0.5))
    f, held = function(waves), torch.from_numpy(waves.theta)[waves.blocks["boundary"]]
    measured = SIZE * f(torch.cat([truth, held]))
    network = torch.nn.Sequential(torch.nn.Linear(2, 8), torch.nn.Tanh(), torch.nn.Linear(8, 1))  # float32, as usual
    optimiser = torch.optim.LBFGS(network.parameters(), max_iter=80, max_eval=80, line_search_fn="strong_wolfe")

    def field():
        return MODULUS * torch.exp(network(nodes.float()).squeeze(1).double())

    def off():
        return (torch.linalg.norm(field() - truth) / torch.linalg.norm(truth)).item()

    def closure():
        optimiser.zero_grad()
        loss = (SIZE * f(torch.cat([field(), held])) - measured).abs().square().sum()
        loss.backward()
        return loss

    before = off()
    optimiser.step(closure)
    assert off() < 0.05 < 0.4 < before


def test_float32_is_refused(torch, waves):
    with pytest.raises(InputError, match=r"x\.dtype is torch.float32; wanted: torch.float64"):
        function(waves)(torch.ones(waves.size))


def test_other_devices_are_refused(torch, real):
    with pytest.raises(InputError, match=r"x\.device is meta; wanted: .* x\.cpu\(\)"):
        function(real)(torch.ones(8, dtype=torch.float64, device="meta"))


def test_functional_gradient(torch, waves, around):
    theta, _ = around(waves, waves.evaluate(waves.theta).data)
    state = waves.evaluate(theta)
    gradient = state.gradient(2 * state.data)
    f = function(waves)
    same(torch.func.grad(lambda x: f(x).abs().square().sum())(torch.tensor(theta)).numpy(), gradient)


def test_second_derivatives_of_a_model_that_has_them(torch, real, rng):
    x = torch.tensor(0.1 * rng.normal(size=8), requires_grad=True)
    assert torch.autograd.gradgradcheck(function(real), (x,))


def test_second_derivatives_of_an_objective(torch, inversion, rng):
    """Reverse over reverse: the whole Hessian."""
    start = inversion.unknowns.start + 0.1
    x, v = torch.tensor(start, requires_grad=True), rng.normal(size=start.size)
    (slope,) = torch.autograd.grad(function(inversion)(x), x, create_graph=True)
    (slope @ torch.from_numpy(v)).backward()
    same(x.grad.numpy(), inversion.evaluate(start).hessian(v))


def test_second_derivatives_are_refused_where_there_are_none(torch, monkeypatch, waves):
    monkeypatch.delattr(WaveLinearisation, "hvp")
    x = torch.tensor(waves.theta, requires_grad=True)
    (slope,) = torch.autograd.grad(function(waves)(x).abs().sum(), x, create_graph=True)
    with pytest.raises(InputError, match="second derivatives"):
        slope.sum().backward()


def test_failed_solve_is_raised(torch, real):
    with pytest.raises(ConvergenceError):
        function(real)(torch.ones(8, dtype=torch.float64))


def test_missing_package_is_named(monkeypatch, real):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtra, match=r'torch is not installed; get it with: pip install "ngbrain\[interop\]"'):
        function(real)
