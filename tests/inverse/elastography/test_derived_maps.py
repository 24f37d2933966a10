"""Derived maps of published moduli, medians by label, errors against the truth."""

import numpy as np
import pytest
from planewaves import grid, shear_waves, waves

from ngbrain.errors import InputError
from ngbrain.inverse.elastography.derived_maps import (
    map_statistics,
    maps_from_shear,
    median_and_iqr,
    parameters_from_shear,
    relative_l2_error,
    statistics_by_label,
)
from ngbrain.materials.modulus import modulus_from_stiffness


@pytest.mark.parametrize(
    ("shear", "stiffness", "ratio"), [(1000 + 500j, 1180, 0.25), (2700 + 1200j, 3088, 0.22), (3000 + 2000j, 3936, 0.33)]
)
def test_maps_that_follow_from_a_modulus(shear, stiffness, ratio):
    maps = maps_from_shear(np.array([shear]))
    assert maps["stiffness"][0] == pytest.approx(stiffness, abs=0.5) and maps["damping_ratio"][0] == pytest.approx(
        ratio, abs=4e-3
    )
    assert maps["magnitude"][0] * np.exp(1j * maps["phase"][0]) == pytest.approx(shear)
    assert maps["storage"][0] + 1j * maps["loss"][0] == shear


def test_a_modulus_from_its_stiffness_and_damping_ratio():
    shear = np.array([1000 + 500j, 2700 + 1200j, 3000 + 0j, 2000 + 3000j])
    maps = maps_from_shear(shear)
    assert modulus_from_stiffness(maps["stiffness"], maps["damping_ratio"]) == pytest.approx(shear, rel=1e-12)
    assert np.isnan(modulus_from_stiffness(np.array([2600.0, np.nan]), np.array([0.2, 0.2]))).tolist() == [False, True]
    for stiffness, ratio, name in ((-1.0, 0.2, "stiffness"), (2600.0, [-0.1], "damping_ratio")):
        with pytest.raises(InputError, match=name):
            modulus_from_stiffness(stiffness, ratio)


def test_medians_are_of_what_is_there():
    values = np.array([1.0, 2, 3, 4, np.nan, 100])
    assert median_and_iqr(values) == {"median": 3.0, "iqr": 2.0} and median_and_iqr(values[4:5]) == {}
    assert statistics_by_label(values, np.array([1, 1, 1, 2, 3, 0])) == {
        0: {"median": 100.0, "iqr": 0.0},
        1: {"median": 2.0, "iqr": 1.0},
        2: {"median": 4.0, "iqr": 0.0},
    }


def test_answers_count_the_mask_and_know_the_truth():
    points = grid(9, 9)
    true = 2000 + 800j + 1e4 * points[:, 0]
    mask = points[:, 1] < 0.011
    data = waves(points, shear_waves(points, 2000), mask=mask, truth={"shear": true})
    found = np.where(mask, 1.2 * true.real - 1j * true.imag, np.nan)
    given = map_statistics(data, parameters_from_shear(data, found))
    assert given["storage"]["relative_l2_error"] == pytest.approx(0.2) and given["loss"][
        "relative_l2_error"
    ] == pytest.approx(2)
    assert given["storage"]["median"] == pytest.approx(np.median(1.2 * true.real[mask]))
    holes = np.where(points[:, 0] > 0, found, np.nan)
    assert "relative_l2_error" not in map_statistics(data, parameters_from_shear(data, holes))["storage"]
    assert relative_l2_error(holes, true) == np.inf
    blind = waves(points, shear_waves(points, 2000))
    assert list(map_statistics(blind, {"mu": true.real})["mu"]) == ["median", "iqr"]


def test_elastic_data_answer_with_youngs_modulus():
    points = grid(5, 5)
    by_ratio = waves(
        points, shear_waves(points, 2000), rheology="elastic", poisson=0.3, truth={"youngs": np.full(25, 2600.0)}
    )
    assert map_statistics(by_ratio, parameters_from_shear(by_ratio, np.full(25, 1000 + 0j)))["youngs"][
        "relative_l2_error"
    ] == pytest.approx(0)
    by_bulk = waves(points, shear_waves(points, 2000), rheology="elastic", poisson=None, bulk=1e4)
    assert parameters_from_shear(by_bulk, np.full(25, 3e3 + 0j))["youngs"] == pytest.approx(9e4 * 3e3 / 3.3e4)


def test_wrong_names_and_shapes_are_named():
    points = grid(5, 5)
    data = waves(points, shear_waves(points, 2000))
    for found, says in (
        ({"stiffness": np.ones(25)}, "stiffness"),
        ({"loss": np.ones(3)}, "loss"),
        ({"loss": 1j * np.ones(25)}, "real"),
    ):
        with pytest.raises(InputError, match=says):
            map_statistics(data, found)
    fibres = waves(points, shear_waves(points, 2000), symmetry="transversely_isotropic", fibre=[1.0, 0.0])
    with pytest.raises(InputError, match="symmetry"):
        parameters_from_shear(fibres, np.ones(25))
