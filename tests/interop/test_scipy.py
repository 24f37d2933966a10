"""Two ways to one minimum; failed solves are stepped back from, where a huge value in their place ends the search early."""

import numpy as np
import pytest
from scipy.optimize import minimize

from ngbrain.adjoint.check import taylor
from ngbrain.errors import ConvergenceError
from ngbrain.interop.function import function
from ngbrain.interop.scipy import Objective

SEARCHES = ["L-BFGS-B", "BFGS", "CG", "Newton-CG", "trust-ncg", "trust-krylov", "SLSQP", "TNC"]


def least(reduced, method, **options):
    J = Objective(reduced)
    hessp = {"hessp": J.hessp} if method in ("Newton-CG", "trust-ncg", "trust-krylov") else {}
    return minimize(J.fun, reduced.unknowns.start, jac=J.jac, method=method, options=options, **hessp)


def test_it_is_the_reduced(inversion, rng):
    J, x = Objective(inversion), inversion.unknowns.start + 0.1 * rng.normal(size=inversion.unknowns.start.size)
    point, p = inversion.evaluate(x), rng.normal(size=x.size)
    assert J.fun(x) == pytest.approx(point.value, rel=1e-12)
    for found, wanted in ((J.jac(x), point.gradient()), (J.hessp(x, p), point.product(p))):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


def test_rates(inversion, rng):
    J, x = Objective(inversion), inversion.unknowns.start + 0.1
    assert np.all(np.abs(taylor(J.fun, J.jac(x), x, rng.normal(size=x.size), first=1e-3) - 2) < 0.1)


def test_one_solve_for_value_gradient_and_products(inversion):
    J, x = Objective(inversion), inversion.unknowns.start + 0.1
    solves = inversion.model.solves
    J.fun(x), J.jac(x), J.hessp(x, x), J.hessp(x, x)
    assert solves.factorisations == 1 + 1 and solves.forward == 1 + 1  # one was for the data


def test_trust_region_and_line_search_find_the_same_minimum(inversion, rng):
    start = inversion.unknowns.start + 0.3 * rng.normal(size=inversion.unknowns.start.size)
    J = Objective(inversion)
    first = J.fun(start)
    newton = minimize(J.fun, start, jac=J.jac, hessp=J.hessp, method="trust-ncg", options={"gtol": 1e-8})
    bfgs = minimize(J.fun, start, jac=J.jac, method="L-BFGS-B", options={"ftol": 1e-16, "gtol": 1e-8, "maxiter": 2000})
    assert newton.fun < 1e-3 * first
    assert bfgs.fun == pytest.approx(newton.fun, rel=1e-6, abs=1e-9 * first)
    assert np.linalg.norm(bfgs.x - newton.x) < 1e-3 * np.linalg.norm(newton.x - start)


def test_first_failure_is_raised(real, risky):
    with pytest.raises(ConvergenceError):
        minimize(Objective(risky).fun, np.full(8, 1.0))


def test_failure_is_a_hill_above_what_was_solved(risky, rng):
    J, start = Objective(risky), risky.unknowns.start
    solved = [J.fun(start - step) for step in (0.1, 0.0, -0.05)]
    J.jac(start)
    x, dx = np.full(8, 1.0), rng.normal(size=8)
    high, slope = J.fun(x), J.jac(x)
    assert solved[0] > solved[1] > solved[2] and high > solved[0]
    assert J.fun(x + 0.1 * dx) == pytest.approx(high + 0.1 * slope @ dx, rel=1e-12)
    assert slope @ (x - start) > 0
    level = np.zeros(8)
    level[:2] = 1.5, -1.5 * slope[0] / slope[1]
    assert J.fun(start + level) == pytest.approx(solved[0], rel=1e-9)


def test_moduli_that_overflow_are_a_step_too_far(inversion):
    J, start = Objective(inversion), inversion.unknowns.start
    first, slope = J.fun(start), J.jac(start)
    assert first < J.fun(start + 1e3 * np.sign(slope)) < np.inf and J.failures == 1


@pytest.mark.parametrize("method", SEARCHES)
def test_failed_solves_are_stepped_back_from(real, risky, method):
    first, found = Objective(risky).fun(risky.unknowns.start), least(risky, method)
    assert real.failed > 0 and np.max(found.x) < real.cap
    assert found.fun < 1e-9 * first


def test_huge_value_for_a_failure_is_taken_for_convergence(risky):
    """The naive way: L-BFGS-B says that it is done."""
    f = function(risky)

    def naive(x):
        try:
            return float(f.value(x)), f.vjp(x, 1.0)
        except ConvergenceError:
            return 1e30, np.zeros_like(x)

    start = risky.unknowns.start
    found, first = minimize(naive, start, jac=True, method="L-BFGS-B"), naive(start)[0]
    assert found.success and found.fun > 0.5 * first
    assert least(risky, "L-BFGS-B").fun < 1e-9 * first


def test_search_without_gradients_passes_by_failures(real, risky):
    J = Objective(risky)
    found = minimize(J.fun, np.full(8, 0.55), method="Nelder-Mead", options={"maxfev": 400})
    assert real.failed > 0 and np.max(found.x) < real.cap and found.fun < 0.1 * J.fun(np.full(8, 0.55))
