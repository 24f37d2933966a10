"""Gauss-Newton on waves and fields: published cases without and with noise, from both starts; its steps; what it refuses."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import InputError, SolverError
from ngbrain.inverse.elastography.assembly import convergence_notes
from ngbrain.inverse.objective.regularisation import total_variation
from ngbrain.inverse.optimise.gauss_newton import GaussNewton
from ngbrain.inverse.optimise.kkt import _column_scale
from ngbrain.inverse.optimise.regularisation_weight import DiscrepancyPrinciple, FixedWeights
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.result import Status


def uniform(inversion, **options):
    return GaussNewton(inversion.reduced, **options).descend(inversion.start)


def from_waves(inversion, **options):
    return GaussNewton(inversion.reduced, **options).from_waves(inversion.start, inversion.waves)


def errors(name, noise, search, nodes=None, seed=0):
    inversion = Phantom.from_name(name, nodes).simulate_measurements(noise, seed).inversion()
    return list(inversion.errors(search(inversion).x).values())


CLEAN = [
    ("CV-G", uniform, (0.00045, 0.00465)),
    ("CV-G", from_waves, (0.00045, 0.00465)),
    ("NE-G", from_waves, (0.01,)),
    ("CE-B", from_waves, (0.05,)),
    ("TI", uniform, (0.01, 0.04, 0.04)),
    ("TI", from_waves, (0.01, 0.04, 0.04)),
]
NOISY = [
    ("CV-G", uniform, (0.015, 0.07)),
    ("CV-G", from_waves, (0.015, 0.07)),
    ("NE-G", from_waves, (0.03,)),
    ("CE-B", from_waves, (0.06,)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "search", "most"), CLEAN)
def test_published_cases_without_noise(name, search, most):
    assert np.all(np.array(errors(name, 0.0, search)) <= most)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "search", "most"), NOISY)
def test_published_cases_with_noise(name, search, most):
    assert np.all(np.array(errors(name, 0.01, search)) <= most)


COARSE = [
    ("CV-G", uniform, 0.0, (0.00045, 0.00465)),
    ("CV-G", from_waves, 0.0, (0.00045, 0.00465)),
    ("NE-G", from_waves, 0.0, (0.01,)),
    ("CE-B", from_waves, 0.0, (0.05,)),
    ("CV-G", uniform, 0.01, (0.02, 0.08)),
    ("NE-G", from_waves, 0.01, (0.03,)),
    ("CE-B", from_waves, 0.01, (0.06,)),
]


@pytest.mark.parametrize(("name", "search", "noise", "most"), COARSE)
def test_coarse_cases(name, search, noise, most):
    assert np.all(np.array(errors(name, noise, search, 25 if name == "CE-B" else 19)) <= most)


def small(noise=0.01, **options):
    return Phantom.from_name("CV-G", 9).simulate_measurements(noise).inversion(**options)


def test_ends_at_a_minimum():
    """The gradient vanishes there, and none of ten random steps lowers J."""
    inversion = small()
    found = uniform(inversion, policy=FixedWeights())
    gradient, random = inversion.reduced.evaluate(found.x).gradient(), np.random.default_rng(0)
    start = np.linalg.norm(inversion.reduced.evaluate(inversion.start).gradient())
    assert found.converged and np.linalg.norm(gradient) < 1e-3 * start
    assert found.objective == pytest.approx(inversion.reduced.value(found.x), rel=1e-9)
    steps = 0.01 * random.normal(size=(10, len(found.x)))
    assert all(inversion.reduced.value(found.x + step) > found.objective for step in steps)


def test_no_step_goes_up():
    """Far from the truth with a weak regulariser, where full steps raise J."""
    inversion = small(weight=1e-2, start={"storage": 3e3, "loss": 3e3})
    search, x = GaussNewton(inversion.reduced, FixedWeights()), inversion.start
    values = [inversion.reduced.value(x)]
    for _ in range(6):
        found = search.descend(x, max_iterations=1)
        x = found.x
        values.append(found.objective)
    assert np.all(np.diff(values) <= 1e-8 * values[0])


def test_a_step_that_overshoots_is_halved():
    """Two halves, one twice too soft: few full steps lower J, and each of six iterations finds a step that does."""
    inversion = Phantom.from_name("CE-B", 9).simulate_measurements(0.01).inversion(weight=10.0)
    search, x, told = GaussNewton(inversion.reduced, FixedWeights()), inversion.start, []
    values = [inversion.reduced.value(x)]
    for _ in range(6):
        found = search.descend(x, max_iterations=1)
        x = found.x
        values.append(found.objective)
        told += found.history
    assert np.all(np.diff(values) < 0)
    assert max(entry.step for entry in told) < 0.05


def test_round_off_at_nodes_counts_as_not_seen():
    """At data points on nodes, basis functions of other nodes are 0 up to single or double precision."""
    matrix = sp.csr_array(np.arange(1.0, 17).reshape(4, 4) ** 2)
    exact, *rounded = (sp.csr_array(sp.diags_array([4.0, 9.0, *rest])) for rest in ([0, 0], [0, 1e-31], [4e-29, 2e-14]))
    for square in rounded:
        assert _column_scale(square, matrix) == pytest.approx(_column_scale(exact, matrix))


def test_where_waves_have_no_solution_a_step_is_halved():
    inversion = small()
    start, at, refused = inversion.start, inversion.reduced.evaluate, []
    fields = slice(0, inversion.reduced.unknowns.blocks["boundary"].start)

    def narrow(x):
        if np.abs(x - start)[fields].max() > 0.05:
            refused.append(x)
            raise SolverError("singular")
        return at(x)

    inversion.reduced.evaluate = narrow
    found = GaussNewton(inversion.reduced, FixedWeights()).descend(start, max_iterations=1)
    assert refused and 0.025 <= np.abs(found.x - start)[fields].max() <= 0.05
    assert found.history[0].step == pytest.approx(0.5 ** len(refused), rel=1e-9)


def test_an_end_says_whether_steps_or_rounds_ran_out():
    inversion, told = small(), []
    at = inversion.reduced.evaluate

    def once(x):
        if told:
            raise SolverError("singular")
        return at(x)

    inversion.reduced.evaluate = once
    stuck = GaussNewton(inversion.reduced, FixedWeights(), told.append).descend(inversion.start)
    assert stuck.status is Status.STALLED and len(stuck.history) == 1
    inversion.reduced.evaluate = at
    stopped = GaussNewton(inversion.reduced, FixedWeights()).descend(inversion.start, max_iterations=1)
    assert stopped.status is Status.STOPPED
    for end, why in (
        (stuck, "no step lowered the objective further"),
        (stopped, "more iterations may change the maps"),
    ):
        (note,) = convergence_notes(end)
        assert note.startswith(f"stopped after 1 iteration, before fields and weights converged ({why})")
    assert uniform(small()).converged and not convergence_notes(uniform(small()))


def test_both_starts_end_alike():
    one, other = small(), small()
    assert uniform(one).x == pytest.approx(from_waves(other).x, abs=0.1)


@pytest.mark.one_thread
def test_the_same_every_time():
    assert np.array_equal(uniform(small()).x, uniform(small()).x)


def test_history_is_told_and_counts():
    told, inversion = [], small()
    found = uniform(inversion, callback=told.append)
    assert told == found.history and found.count == 2 * 2 * 81
    assert found.cross_validation == pytest.approx(found.level.misfit * 324 / found.level.expected**2)
    assert all(a.cpu_s <= b.cpu_s for a, b in pairwise(told))
    assert inversion.model.solves.factorisations >= 2 * len(told)


def test_discrepancy_ends_at_its_level():
    found = uniform(
        Phantom.from_name("CV-G", 19).simulate_measurements(0.02).inversion(), policy=DiscrepancyPrinciple()
    )
    assert found.level.ratio == pytest.approx(1, abs=0.1)


def test_edges_by_total_variation():
    measured = Phantom.from_name("CE-B", 25).simulate_measurements(0.01)
    smooth = measured.inversion()
    edged = measured.inversion(lambda space, x: total_variation(space, x, 0.024))
    worse, better = (i.errors(from_waves(i).x)["youngs"] for i in (smooth, edged))
    assert better < worse


def test_another_model_is_refused():
    reduced = small().reduced
    with pytest.raises(InputError, match="WaveModel"):
        GaussNewton(Reduced(object(), reduced.misfit, reduced.unknowns, {}, {}))
