"""Inversion from given start maps: the fields, the result, invalid maps."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.inverse.elastography.initial_guess import unknowns_from_maps
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.problem.discretisation import discretise, original_discretisation
from ngbrain.inverse.problem.properties import polar_properties
from ngbrain.inverse.problem.property_fields import build_composition
from ngbrain.inverse.problem.wave_problem import ElastographyProblem

NOISE = 0.01


@pytest.fixture(scope="module")
def data():
    return Phantom.from_name("CV-G", 15).simulate_measurements(NOISE).data()


@pytest.mark.parametrize("elements", [original_discretisation, discretise], ids=["their own", "ours"])
@pytest.mark.parametrize("sought", [None, polar_properties], ids=["moduli", "polar"])
def test_fields_have_the_values_of_the_maps(data, elements, sought):
    experiment = ElastographyProblem(data, elements(data), sought and sought(data))
    unknowns = experiment.unknowns(np.ones(1))
    truth = data.truth_views
    gaps = {
        name: np.where(np.arange(225) == 112, np.nan, values) for name, values in truth.items()
    }  # the middle is not known
    found = experiment.maps(unknowns, unknowns_from_maps(experiment, unknowns, gaps))
    for name, values in truth.items():
        off = np.abs(found[name] / values - 1)
        assert np.delete(off, 112).max() < 2e-2 and off[112] < 0.1


@pytest.fixture(scope="module")
def usual(data):
    return invert(data, regulariser="smooth")


def test_maps_lead_where_measured_waves_do_and_no_uniform_field_is_tried(data, usual):
    start = {name: 1.3 * values for name, values in data.truth_views.items()}
    found = invert(data, regulariser="smooth", start=start)
    assert found.chosen == "both" and [row.name for row in found.starts] == ["given", "both"]
    assert found.checks["converged"] and abs(found.checks["misfit_over_expected"] - 1) < 0.15
    for name, answer in usual.answers.items():
        assert found.answers[name]["relative_l2_error"] == pytest.approx(answer["relative_l2_error"], rel=0.02)
    assert found.solves.factorisations < 0.7 * usual.solves.factorisations


def test_the_fields_begin_at_the_maps(data, usual):
    near = invert(data, regulariser="smooth", start=data.truth_views)
    assert near.history[0].change < 0.5 * usual.history[0].change


@pytest.mark.parametrize(
    "maps, named",
    [
        ({}, "start is of nothing; wanted: maps of storage, loss"),
        ({"storage": np.ones(225)}, "start is of storage"),
        ({"storage": np.ones(224), "loss": np.ones(225)}, r"start storage is of shape \(224,\)"),
        ({"storage": np.ones(225), "loss": np.zeros(225)}, "start loss is 0.0; wanted: values above 0"),
        ({"storage": np.full(225, np.nan), "loss": np.ones(225)}, "start storage is known nowhere"),
    ],
)
def test_what_is_no_start(data, maps, named):
    with pytest.raises(InputError, match=named):
        invert(data, start=maps)


def the_same(found, other):
    """Assert equal results to the last bit, and equal work."""
    assert found.solves == other.solves and found.warnings == other.warnings and found.chosen == other.chosen
    assert [row.value for row in found.starts] == [row.value for row in other.starts]
    for name, values in found.maps.items():
        np.testing.assert_array_equal(values, other.maps[name])
    kept = [(each.phase, each.misfit, each.weights) for each in found.history]
    assert kept == [(each.phase, each.misfit, each.weights) for each in other.history]


@pytest.mark.one_thread
@pytest.mark.slow
def test_starts_and_regularisers_side_by_side_are_the_same_to_the_last_bit(data, caplog):
    ways = {"levels": (0.5, 1.0), "max_iterations": 4, "drop_outliers": False}
    told = []
    with_two = invert(data, **ways, executor=2, callback=told.append)
    the_same(invert(data, **ways), with_two)
    assert len(told) == len(with_two.history)
    assert "in this process" not in caplog.text  # they could be sent


@pytest.mark.one_thread
def test_an_experiment_arrives_in_another_process_as_it_is(data):
    labels = (data.points[:, 0] > data.points[:, 0].mean()).astype(int)
    labelled = replace(data, labels=labels)
    elements = discretise(labelled)
    sent = ElastographyProblem(
        labelled, elements, polar_properties(labelled), build_composition(labelled, elements, True)
    )
    arrived = pickle.loads(pickle.dumps(sent))
    np.testing.assert_array_equal(arrived.waves, sent.waves)
    theta = sent.unknowns(np.ones(1)).theta(sent.unknowns(np.ones(1)).start)
    np.testing.assert_array_equal(arrived.model.evaluate(theta).data, sent.model.evaluate(theta).data)
    assert list(arrived.model.blocks) == list(sent.model.blocks)
