"""BFGS, L-BFGS and Newton-CG: known minima, the metric that whitens, and J of an inversion."""

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse as sp

from ngbrain.adjoint.check import dot
from ngbrain.errors import ConvergenceError, InputError
from ngbrain.inverse.optimise.gauss_newton import GaussNewton
from ngbrain.inverse.optimise.gauss_newton_hessian import GaussNewtonHessian, Metric
from ngbrain.inverse.optimise.quasi_newton import (
    bfgs,
    bfgs_iterations,
    l_bfgs,
    line_search,
    newton_cg,
    update_inverse_hessian,
)
from ngbrain.inverse.optimise.regularisation_weight import FixedWeights
from ngbrain.inverse.phantoms.benchmark import Phantom


def rosenbrock(x):
    return scipy.optimize.rosen(x), scipy.optimize.rosen_der(x)


def test_descent_on_a_curved_valley():
    *_, (number, x, value) = bfgs_iterations(rosenbrock, np.array([-1.2, 1.0, 0.7]))
    assert x == pytest.approx(np.ones(3), abs=1e-6) and value < 1e-12 and number < 100


def test_descent_on_a_quadratic(rng):
    root = rng.normal(size=(5, 5))
    matrix = root @ root.T + np.eye(5)
    *_, (number, x, _) = bfgs_iterations(lambda x: (0.5 * x @ matrix @ x, matrix @ x), rng.normal(size=5))
    assert number < 100 and np.abs(x).max() < 1e-6


def test_update_satisfies_the_secant_and_stays_positive(rng):
    inverse, change, bend = np.eye(4), rng.normal(size=4), rng.normal(size=4)
    bend *= np.sign(change @ bend)
    update_inverse_hessian(inverse, change, bend)
    assert inverse @ bend == pytest.approx(change) and np.linalg.eigvalsh(inverse)[0] > 0
    assert np.allclose(inverse, inverse.T)


def test_update_without_curvature_is_left_out(rng):
    inverse, change = np.eye(4), rng.normal(size=4)
    update_inverse_hessian(inverse, change, -change)
    assert np.array_equal(inverse, np.eye(4))


def test_line_search_turns_back_where_there_is_no_value():
    def beyond_one(a):
        return ((a - 0.4) ** 2, np.array([2 * (a - 0.4)])) if a < 0.9 else (np.inf, np.zeros(1))

    step, value, _ = line_search(beyond_one, 0.16, np.array([-0.8]), np.ones(1))
    assert 0 < step < 0.9 and value < 0.16


def test_line_search_uphill_finds_nothing():
    assert line_search(lambda a: (1 + a, np.ones(1)), 1.0, np.array([-1.0]), np.ones(1)) is None


def test_metric(rng):
    matrix = sp.random_array((30, 30), density=0.1, rng=rng)
    matrix = sp.csr_array(matrix @ matrix.T + sp.diags_array(rng.uniform(1, 2, 30)))
    metric, xi, g = Metric(matrix), rng.normal(size=30), rng.normal(size=30)
    assert matrix @ metric.solve(g) == pytest.approx(g)
    assert metric.unwhiten(xi) @ matrix @ metric.unwhiten(xi) == pytest.approx(xi @ xi)
    assert dot(metric.unwhiten, metric.whiten_gradient, xi, g) < 1e-12


def small():
    return Phantom.from_name("CV-G", 7).simulate_measurements(0.02).inversion()


@pytest.mark.parametrize("search", [bfgs, l_bfgs, newton_cg])
def test_the_same_minimum_as_gauss_newton(search):
    inversion = small()
    wanted = GaussNewton(inversion.reduced, FixedWeights()).descend(inversion.start)
    found = search(small().reduced, inversion.start, FixedWeights(), max_inner_iterations=400, max_iterations=4)
    assert found.objective == pytest.approx(wanted.objective, rel=2e-3)
    fields = slice(0, inversion.reduced.unknowns.blocks["boundary"].start)
    assert found.x[fields] == pytest.approx(wanted.x[fields], abs=0.03)


def test_weights_follow_the_data():
    inversion = Phantom.from_name("CV-G", 7).simulate_measurements(0.01).inversion(weight=1e5)
    found = newton_cg(inversion.reduced, inversion.start)
    assert found.weights["storage"] < 1e4 and found.level.ratio < 2 and found.history[0].weights["storage"] == 1e5


@pytest.mark.one_thread
def test_nowhere_to_go_from_the_minimum_of_nothing():
    inversion = small()
    inversion.reduced.misfit.measured = inversion.reduced.evaluate(inversion.start).state.data
    with pytest.raises(ConvergenceError, match="no step"):
        l_bfgs(inversion.reduced, inversion.start)


def test_a_misfit_without_a_level_is_refused():
    reduced = small().reduced
    reduced.misfit = object()
    with pytest.raises(InputError, match="misfit"):
        l_bfgs(reduced, reduced.unknowns.start)


def test_traces_by_conjugate_gradients():
    inversion = small()
    reduced, x = inversion.reduced, inversion.start
    curvature = GaussNewtonHessian(reduced.evaluate(x), Metric.from_point(reduced.evaluate(x)))
    H = np.array([curvature.apply(e) for e in np.eye(len(x))])
    exact = len(x) - np.trace(reduced.regular_matrix(x) @ np.linalg.inv(H))
    random = np.random.default_rng(0)
    assert np.mean([curvature.effective_parameters(random) for _ in range(30)]) == pytest.approx(exact, rel=0.05)
