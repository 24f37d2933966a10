"""Bodies at large strain through every face: derivatives of both orders, and parameters that no equilibrium has."""

import numpy as np
import pytest
import scipy.sparse as sp
from equilibria import SIDE, model, tight
from scipy.optimize import minimize
from statics import square

from ngbrain.adjoint.check import taylor
from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import SolverError
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Force
from ngbrain.forward.sensitivity.static_model import LoadCase, PrescribedDisplacement, StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.interop import jax as to_jax
from ngbrain.interop import torch as to_torch
from ngbrain.interop import umbridge as to_umbridge
from ngbrain.interop.function import function
from ngbrain.interop.scipy import Objective
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import ridge
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.materials import NeoHooke, Ogden


@pytest.fixture(scope="module")
def tissue():
    """Two moduli and two exponents of Ogden's law, and a bulk modulus; data of size one."""
    return model(Ogden, "number", "P2/P1")


@pytest.fixture(scope="module")
def units(tissue):
    """θ, and the data there: what both are measured in."""
    return tissue.theta, np.abs(tissue.evaluate(tissue.theta).data)


def test_rates_of_both_orders(tissue, units, rng):
    (theta, unit), f = units, function(tissue)
    w, dx = rng.normal(size=len(unit)) / unit, theta * rng.uniform(-1, 1, size=len(theta))
    value, slope = lambda x: float(w @ f.value(x)), f.vjp(theta, w)
    assert np.all(np.abs(taylor(value, slope, theta, dx, steps=3) - 2) < 0.1)
    change = f.hvp(theta, w, dx)
    rates = taylor(lambda x: theta * f.vjp(x, w), lambda _: theta * change, theta, dx, steps=3)
    assert np.all(np.abs(rates - 2) < 0.1)


@pytest.mark.filterwarnings("ignore:.torch.jit.script:DeprecationWarning")
def test_torch(torch, tissue, units):
    theta, unit = map(torch.from_numpy, units)
    f, x = to_torch.function(tissue), torch.zeros(len(theta), dtype=torch.float64, requires_grad=True)

    def scaled(x):
        return f(theta * torch.exp(0.1 * x)) / unit

    assert torch.autograd.gradcheck(scaled, (x,), eps=1e-5, atol=1e-7, rtol=1e-4, check_forward_ad=True)
    assert torch.autograd.gradgradcheck(scaled, (x,), eps=1e-4, atol=1e-6, rtol=1e-3)


def test_jax(jax, tissue, units, rng):
    from jax.test_util import check_grads

    theta, unit = units
    f = to_jax.function(tissue, theta)

    def scaled(x):
        return f(theta * jax.numpy.exp(0.1 * x)) / unit

    check_grads(jax.jit(scaled), (0.1 * rng.normal(size=len(theta)),), order=1, modes=["rev"], eps=1e-4)


def test_umbridge(umbridge, tissue, units, rng):
    theta, unit = units
    served = to_umbridge.model(tissue, theta)
    w, v = rng.normal(size=len(unit)) / unit, theta * rng.normal(size=len(theta))
    there = tissue.evaluate(theta)
    gradient, second = there.gradient(w), there.hvp(w, v)
    assert served.supports_apply_hessian()
    assert served.gradient(0, 0, [theta.tolist()], w.tolist()) == pytest.approx(gradient, rel=1e-9)
    assert served.apply_hessian(0, 0, 0, [theta.tolist()], w.tolist(), v.tolist()) == pytest.approx(second, rel=1e-7)


@pytest.fixture
def pressed():
    """J of how far a square is pressed together (a part of its height), by the force that .35 take; beyond about .8 it folds."""
    body = Problem(
        square(2, size=SIDE),
        {".*": Material(NeoHooke(1e3), 5e4)},
        {"bottom": 0, "top": (0, -0.35 * SIDE)},
        element="P2/P1",
    )
    of = StaticModel([LoadCase(body, [Force("top")])], {"top": PrescribedDisplacement(body, "top")}, tight(body))
    truth = of.theta
    data = of.evaluate(truth).data
    part = sp.csr_array((truth / 0.35)[:, None])
    fields = ParameterFields(truth, of.blocks, {"top": Unknown(0.01, ScaledTransform(), part)})
    misfit = LeastSquares(data, 0.01 * np.abs(data).max())
    return Reduced(of, misfit, fields, {"top": ridge(fields.start)}, {"top": 1e-6})


@pytest.mark.parametrize("method", ["L-BFGS-B", "trust-ncg"])
def test_first_step_folds_the_body_over_and_is_taken_back(pressed, method):
    J = Objective(pressed)
    hessp = {"hessp": J.hessp} if method == "trust-ncg" else {}
    found = minimize(J.fun, pressed.unknowns.start, jac=J.jac, method=method, **hessp)
    assert J.failures > 0 and found.success
    assert found.x == pytest.approx(0.35, rel=1e-5)


def test_a_step_held_back_by_folds_is_not_taken_for_convergence(pressed):
    """Damped until the body does not fold, steps are short: at .25 they were taken for the end."""
    found = levenberg_marquardt(pressed, pressed.unknowns.start)
    assert found.converged and found.x == pytest.approx(0.35, rel=1e-3)


def test_huge_value_for_a_fold_is_taken_for_convergence(pressed):
    """The naive way does not move at all, and says that it is done."""

    def naive(x):
        try:
            point = pressed.evaluate(x)
        except SolverError:
            return 1e30, np.zeros_like(x)
        return point.value, point.gradient()

    found = minimize(naive, pressed.unknowns.start, jac=True, method="L-BFGS-B")
    assert found.success and found.x == pytest.approx(0.01)
