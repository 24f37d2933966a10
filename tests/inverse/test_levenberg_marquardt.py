"""Levenberg and Marquardt: the minimum of Gauss-Newton, by a matrix and without; damping where steps are too long."""

import numpy as np
import pytest
import scipy.sparse as sp

from ngbrain.errors import ConvergenceError, SolverError
from ngbrain.inverse.curvature import Curvature, Metric
from ngbrain.inverse.gauss_newton import GaussNewton
from ngbrain.inverse.levenberg_marquardt import Dense, levenberg_marquardt
from ngbrain.inverse.phantoms import Phantom
from ngbrain.inverse.weights import Given


def small(**options):
    return Phantom.named("CV-G", 7).measured(0.02).inversion(**options)


@pytest.mark.parametrize("dense", [0, 1000])
def test_the_same_minimum_as_gauss_newton(dense):
    inversion = small()
    wanted = GaussNewton(inversion.reduced, Given()).descend(inversion.start)
    found = levenberg_marquardt(small().reduced, inversion.start, Given(), dense=dense)
    assert found.converged and found.value == pytest.approx(wanted.value, rel=1e-4)
    fields = slice(0, inversion.reduced.unknowns.blocks["boundary"].start)
    assert found.x[fields] == pytest.approx(wanted.x[fields], abs=0.02)


def test_matrix_and_traces_are_those_of_the_products():
    inversion = small()
    point = inversion.reduced.at(inversion.start)
    metric = Metric.of(point)
    dense, free = Dense(point, metric), Curvature(point, metric)
    x = np.random.default_rng(0).normal(size=len(inversion.start))
    assert dense.apply(x) == pytest.approx(free.apply(x), rel=1e-8)
    assert dense.matrix @ dense.solve(x) == pytest.approx(x, rel=1e-6, abs=1e-6)
    estimates = [free.determined(np.random.default_rng(seed)) for seed in range(20)]
    assert dense.determined(None) == pytest.approx(np.mean(estimates), rel=0.05)


def test_damping_gets_through_where_full_steps_do_not():
    """Almost no regulariser and a far start: some steps fail, none is taken that goes up."""
    inversion = small(weight=1e-2, start={"storage": 3e3, "loss": 3e3})
    found = levenberg_marquardt(inversion.reduced, inversion.start, Given(), rounds=25)
    falls = [i.misfit for i in found.history]
    assert (
        np.all(np.diff(falls) < 0)
        and falls[-1] < 0.5 * falls[0]
        and found.value < inversion.reduced.value(inversion.start)
    )


def test_nowhere_to_go_from_where_the_data_fit():
    inversion = small()
    inversion.reduced.misfit.measured = inversion.reduced.at(inversion.start).state.data
    try:
        found = levenberg_marquardt(inversion.reduced, inversion.start, Given())
    except ConvergenceError:
        return
    assert found.x == pytest.approx(inversion.start, abs=1e-6)


def test_what_nothing_holds_is_said():
    with pytest.raises(SolverError, match="neither regularisers nor data hold some unknown"):
        Metric(sp.csr_array(np.diag([1.0, 0.0])))
