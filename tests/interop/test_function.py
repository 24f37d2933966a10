"""One solve for one θ, whoever asks; never a State that is out of date."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from optimiser_models import waves as fresh

from ngbrain.adjoint.check import taylor
from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import ConvergenceError, InputError
from ngbrain.interop.function import DataFunction, ObjectiveFunction, function
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import ridge


def same(a, b):
    np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12 * np.abs(b).max())


def test_model_and_objective_are_told_apart(waves, inversion):
    assert isinstance(function(waves), DataFunction) and isinstance(function(inversion), ObjectiveFunction)


def test_one_solve_for_one_theta(waves):
    f, theta = function(waves), waves.theta
    y = f.value(theta)
    f.jvp(theta, theta), f.vjp(theta, y), f.value(theta.copy())
    assert waves.solves.factorisations == waves.solves.forward == 1 and waves.solves.adjoint == 1


def test_two_functions_of_a_model_share_its_solve(waves, inversion):
    f, g, theta = function(waves), function(waves), waves.theta
    g.vjp(theta, f.value(theta))
    assert waves.solves.factorisations == 1
    x = inversion.unknowns.start + 0.1
    before, objective, data = inversion.model.solves.factorisations, function(inversion), function(inversion.model)
    data.value(inversion.unknowns.theta(x)), objective.value(x), objective.vjp(x, 1.0)
    assert inversion.model.solves.factorisations == before + 1


def test_value_is_a_copy(waves):
    f, theta = function(waves), waves.theta
    y = f.value(theta)
    truth = y.copy()
    y[:] = 0
    same(f.value(theta), truth)


def test_theta_changed_in_place_is_another_one(waves):
    f, theta = function(waves), waves.theta
    before = f.value(theta)
    theta *= 1.5
    assert np.linalg.norm(f.value(theta) - before) > 0.01 * np.linalg.norm(before)


@pytest.mark.parametrize("of_two", [False, True], ids=["one function", "two functions"])
def test_earlier_theta_is_solved_again(waves, around, of_two):
    f = function(waves)
    other = function(waves) if of_two else f
    theta, w = around(waves, f.value(waves.theta))
    f.value(theta)
    other.value(1.3 * theta)
    same(f.vjp(theta, w), fresh().evaluate(theta).gradient(w))


def test_model_asked_by_others_is_asked_again(waves, around):
    f = function(waves)
    theta, w = around(waves, f.value(waves.theta))
    f.value(theta)
    waves.evaluate(1.3 * theta)
    same(f.vjp(theta, w), fresh().evaluate(theta).gradient(w))


def test_failed_solve_leaves_nothing_behind(real):
    f, theta = function(real), np.zeros(8)
    y = f.value(theta)
    with pytest.raises(ConvergenceError):
        f.value(theta + 1)
    with pytest.raises(ConvergenceError):
        f.vjp(theta + 1, y)
    same(f.value(theta), y)


class Moving:
    """Each State reads θ where the model has it now, and takes its time."""

    def evaluate(self, theta):
        self.now = np.array(theta)
        time.sleep(0.002)
        return self

    @property
    def data(self):
        return self.now.copy()

    def gradient(self, w):
        time.sleep(0.002)
        return w * self.now


def test_threads_get_their_own_answers():
    f, found = function(Moving()), {}

    def ask(number):
        found[number] = [f.vjp(np.full(3, float(number)), np.ones(3)) for _ in range(10)]

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number in range(3):
        assert np.all(np.array(found[number]) == number)


def test_objective_is_that_of_the_reduced(inversion, rng):
    x = inversion.unknowns.start + 0.1 * rng.normal(size=inversion.unknowns.start.size)
    f, point, dx = function(inversion), inversion.evaluate(x), rng.normal(size=x.size)
    value, gradient, product = point.value, point.gradient(), point.product(dx)
    same(f.value(x), value)
    same(f.vjp(x, 2.0), 2 * gradient)
    same(f.jvp(x, dx), gradient @ dx)
    same(f.product(x, dx), product)


def test_second_derivatives(real, waves, inversion, rng):
    f, x, w, dx = function(real), 0.1 * rng.normal(size=8), rng.normal(size=10), rng.normal(size=8)
    rates = taylor(lambda x: f.vjp(x, w), lambda d: f.hvp(x, w, d), x, dx)
    assert np.all(np.abs(rates - 2) < 0.1)
    J, x = function(inversion), inversion.unknowns.start + 0.1
    dx = rng.normal(size=x.size)
    same(J.hvp(x, 2.0, dx), 2 * inversion.evaluate(x).hessian(dx))
    f, theta = function(waves), waves.theta
    w, dx = rng.normal(size=f.value(theta).shape) + 0j, theta * rng.normal(size=theta.size)
    same(f.hvp(theta, w, dx), waves.evaluate(theta).hvp(w, dx))


def test_second_derivatives_are_refused_where_there_are_none():
    flat = SimpleNamespace(evaluate=lambda theta: SimpleNamespace(data=theta))
    with pytest.raises(InputError, match="second derivatives"):
        function(flat).hvp(np.ones(1), np.ones(1), np.ones(1))


def test_objective_follows_the_weights(inversion):
    x = inversion.unknowns.start + 0.1
    f = function(inversion)
    before = float(f.value(x))
    regular = inversion.regular(x)
    inversion.weights = {name: 3 * weight for name, weight in inversion.weights.items()}
    assert float(f.value(x)) - before == pytest.approx(2 * regular, abs=1e-12 * before) and regular > 1e-8 * before
    same(f.vjp(x, 1.0), inversion.evaluate(x).gradient())


def test_unknown_that_only_a_regulariser_sees(real):
    """θ stays, J does not."""
    basis = sp.csr_array(np.eye(8, 9))
    fields = ParameterFields(
        np.zeros(8), {"theta": slice(0, 8)}, {"theta": Unknown(np.zeros(9), ScaledTransform(), basis)}
    )
    f = function(Reduced(real, LeastSquares(np.ones(10), 1.0), fields, {"theta": ridge(np.zeros(9))}, {"theta": 1.0}))
    x = np.zeros(9)
    before = float(f.value(x))
    x[-1] = 2.0
    assert float(f.value(x)) == pytest.approx(before + 2.0) and real.solved == 1


def test_rates(waves, inversion, around, rng):
    f = function(waves)
    theta, w = around(waves, f.value(waves.theta))
    dx = theta * rng.normal(size=theta.size)
    rates = taylor(f.value, lambda d: f.jvp(theta, d), theta, dx, first=1e-3)
    assert np.all(np.abs(rates - 2) < 0.1)
    rates = taylor(lambda x: float(np.sum(np.conj(w) * f.value(x)).real), f.vjp(theta, w), theta, dx, first=1e-3)
    assert np.all(np.abs(rates - 2) < 0.1)
    J, x = function(inversion), inversion.unknowns.start + 0.1
    assert np.all(np.abs(taylor(J.value, J.vjp(x, 1.0), x, rng.normal(size=x.size), first=1e-3) - 2) < 0.1)
