"""Levenberg-Marquardt: the minimum of Gauss-Newton, with a dense matrix and without; damping of long steps."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import ConvergenceError, SolverError
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import ParameterFields, Unknown
from ngbrain.inverse.objective.regularisation import ridge
from ngbrain.inverse.optimise.gauss_newton import GaussNewton
from ngbrain.inverse.optimise.gauss_newton_hessian import GaussNewtonHessian, Metric
from ngbrain.inverse.optimise.levenberg_marquardt import MAX_CHANGE, DenseGaussNewtonHessian, levenberg_marquardt
from ngbrain.inverse.optimise.regularisation_weight import FixedWeights
from ngbrain.inverse.phantoms.benchmark import Phantom


def small(**options):
    return Phantom.from_name("CV-G", 7).simulate_measurements(0.02).inversion(**options)


@pytest.mark.parametrize("dense", [0, 1000])
def test_the_same_minimum_as_gauss_newton(dense):
    inversion = small()
    wanted = GaussNewton(inversion.reduced, FixedWeights()).descend(inversion.start)
    found = levenberg_marquardt(small().reduced, inversion.start, FixedWeights(), max_dense=dense)
    assert found.converged and found.objective == pytest.approx(wanted.objective, rel=1e-4)
    fields = slice(0, inversion.reduced.unknowns.blocks["boundary"].start)
    assert found.x[fields] == pytest.approx(wanted.x[fields], abs=0.02)


def test_matrix_and_traces_are_those_of_the_products():
    inversion = small()
    point = inversion.reduced.evaluate(inversion.start)
    metric = Metric.from_point(point)
    dense, free = DenseGaussNewtonHessian(point, metric), GaussNewtonHessian(point, metric)
    x = np.random.default_rng(0).normal(size=len(inversion.start))
    assert dense.apply(x) == pytest.approx(free.apply(x), rel=1e-8)
    assert dense.matrix @ dense.solve(x) == pytest.approx(x, rel=1e-6, abs=1e-6)
    estimates = [free.effective_parameters(np.random.default_rng(seed)) for seed in range(20)]
    assert dense.effective_parameters(None) == pytest.approx(np.mean(estimates), rel=0.05)


def test_damping_gets_through_where_full_steps_do_not():
    """A weak regulariser and a distant initial guess: some steps fail, and no accepted step raises J."""
    inversion = small(weight=1e-2, start={"storage": 3e3, "loss": 3e3})
    found = levenberg_marquardt(inversion.reduced, inversion.start, FixedWeights(), max_iterations=25)
    falls = [i.misfit for i in found.history]
    assert (
        np.all(np.diff(falls) < 0)
        and falls[-1] < 0.5 * falls[0]
        and found.objective < inversion.reduced.value(inversion.start)
    )


def test_nowhere_to_go_from_where_the_data_fit():
    inversion = small()
    inversion.reduced.misfit.measured = inversion.reduced.evaluate(inversion.start).state.data
    try:
        found = levenberg_marquardt(inversion.reduced, inversion.start, FixedWeights())
    except ConvergenceError:
        return
    assert found.x == pytest.approx(inversion.start, abs=1e-6)


def test_what_nothing_holds_is_said():
    with pytest.raises(SolverError, match="neither regularisers nor data determine some unknown"):
        Metric(sp.csr_array(np.diag([1.0, 0.0])))


def test_what_nothing_holds_at_a_trial_is_not_counted():
    """H = diag(1 + α, 0): one regularised unknown that the data determine as well, and one that they do not determine."""
    fields = ParameterFields(np.ones(2), {"a": slice(0, 1), "b": slice(1, 2)}, {"a": Unknown(1.0), "b": Unknown(1.0)})

    def known(theta):
        return SimpleNamespace(data=theta[:1], jvp=lambda d: d[:1], vjp=None, gradient=lambda w: np.array([w[0], 0.0]))

    reduced = Reduced(
        SimpleNamespace(evaluate=known),
        LeastSquares(np.zeros(1), 1.0),
        fields,
        {"a": ridge(fields.start[:1])},
        {"a": 1.0},
    )
    dense = DenseGaussNewtonHessian(reduced.evaluate(fields.start), Metric(sp.csr_array(np.eye(2))))
    assert dense.matrix == pytest.approx(np.diag([2.0, 0.0]))
    assert dense.effective_parameters(None) == pytest.approx(0.5)
    assert dense.effective_parameters_by_block(fields.blocks, {"a": sp.csr_array([[1.0]])}, None) == pytest.approx(
        {"a": 0.5}
    )


class Blind:
    """Data that hardly depend on x: the misfit falls by round-off only, which no gradient predicts."""

    calls = 0

    def evaluate(self, theta):
        self.calls += 1
        self.data = np.array([1 - 1e-13 * self.calls])
        return self

    def gradient(self, w):
        return 1e-160 * w

    jvp = vjp = gradient


def test_a_fall_that_nothing_foretold_is_an_end():
    fields = ParameterFields(np.array([1.0]), {"theta": slice(0, 1)}, {"theta": Unknown(1.0)})
    reduced = Reduced(Blind(), LeastSquares(np.zeros(1), 1.0), fields, {"theta": ridge(fields.start)}, {"theta": 1.0})
    found = levenberg_marquardt(reduced, fields.start, FixedWeights())
    assert found.converged and found.x == pytest.approx(fields.start, abs=1e-12)


def test_no_step_changes_an_unknown_beyond_what_can_be_foretold():
    """A distant initial guess and a weak regulariser: unbounded steps would move logarithms to where the data are insensitive."""
    inversion = small(weight=1e-5, start={"storage": 2e3, "loss": 2e3})
    seen = []
    at = inversion.reduced.evaluate

    def watched(x):
        seen.append(x.copy())
        return at(x)

    inversion.reduced.evaluate = watched
    levenberg_marquardt(inversion.reduced, inversion.start, FixedWeights(), max_iterations=6)
    assert (
        max(np.abs(np.diff(seen, axis=0)).max(axis=1)) <= 2 * MAX_CHANGE
    )  # from a trial to the next one, both from one point
