"""Pointwise noise: noisy points have less weight, in the plane, in space and in zones; misfits have their expected value."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import grid, shear_waves, waves

from ngbrain.inverse.data.quality import (
    noise_deviation,
    noise_for_misfit,
    octahedral_shear_strain,
    rms_noise,
    total_noise,
)
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.elastography.invert_3d import invert_in_space
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.problem.discretisation import discretise
from ngbrain.inverse.problem.voxel_lattice import build_lattice
from ngbrain.inverse.subzones.partition import cut_zones, zone_data
from ngbrain.inverse.subzones.zone_result import problem_digest
from ngbrain.report.pages.parameters import facts


def phantom(name, nodes=13):
    return Phantom.from_name(name, nodes).simulate_measurements().data()


def inverted(data, noise=None):
    """Relative L2 error of the modulus, and the inversion."""
    data = data if noise is None else replace(data, noise=noise)
    found = invert(data, uniform=False, regulariser="smooth")
    name = "youngs" if "youngs" in found.maps else "storage"
    return found.answers[name]["relative_l2_error"], found


@pytest.mark.parametrize(
    ("name", "noisier"), [("CE-G", "half"), pytest.param("CV-G", "half", marks=pytest.mark.slow), ("CE-G", "border")]
)
def test_noisy_points_count_less(name, noisier):
    """Half of them, or the border, ten times noisier than the rest: with the rms for all, errors are a third larger or more."""
    data = phantom(name)
    many = np.random.default_rng(0).random(len(data.points)) < 0.5 if noisier == "half" else data.border
    noise = np.where(many, 0.1, 0.01)
    one, each = [], []
    for seed in (1, 2):
        spoilt = data.with_noise(noise, seed)
        error, found = inverted(spoilt)
        assert 0.85 < found.checks["misfit_over_expected"] < 1.15 and not any(
            "misfit" in note for note in found.warnings
        )
        each.append(error)
        one.append(inverted(spoilt, rms_noise(data, noise))[0])
    assert np.mean(each) < 0.77 * np.mean(one)
    assert found.noise_found == pytest.approx(rms_noise(data, noise), rel=0.1)
    assumed = found.to_dict()["noise"]
    assert assumed["assumed"] == pytest.approx(rms_noise(data, noise)) and assumed["range"] == pytest.approx(
        [0.01, 0.1]
    )
    assert ", 1.00 % to 10.0 % by point" in dict(facts(found.to_dict()))["Noise, including model error"]


def test_weights_are_those_of_the_points():
    """Weights at the points of the mask; the model error applies to all of them."""
    data = phantom("CE-G", 9)
    mask = np.arange(81) != 40
    spoilt = data.with_noise(noise := np.where(np.arange(81) % 3, 0.003, 0.03), 1)
    found = invert(
        replace(spoilt, noise=np.where(mask, noise, np.nan), mask=mask, dirichlet=None),
        uniform=False,
        regulariser="smooth",
        model_error=0.004,
    )
    np.testing.assert_allclose(found.noise[mask], np.hypot(noise, 0.004)[mask])
    assert found.to_dict()["noise"]["assumed"] == pytest.approx(np.sqrt(np.mean(found.noise[mask] ** 2)))
    sigma = np.hypot(noise, 0.004)[mask, None] * found.data.rms / np.sqrt(2)
    np.testing.assert_allclose(found.final_state.reduced.misfit.sigma, sigma)
    assert np.nansum(np.abs(found.arrays()["residual"]) ** 2) == pytest.approx(found.starts[-1].misfit)


def test_no_level_is_below_that_of_exact_data():
    np.testing.assert_allclose(total_noise(np.array([1e-4, 0.03]), 2e-3, 0.04), [np.hypot(1e-4, 0.04), 0.05])
    np.testing.assert_allclose(total_noise(np.array([1e-4, 0.03]), 2e-3), [2e-3, 0.03])
    assert total_noise(1e-4, 2e-3) == 2e-3


def test_uniform_fields_start_with_the_points_weights_too():
    data = phantom("CV-G", 9).with_noise(np.where(np.arange(81) % 2, 5e-5, 0.02), 0)
    found = invert(data, regulariser="smooth")
    rows = {row.name: row for row in found.starts}
    assert rows["uniform"].misfit == pytest.approx(rows["both"].misfit, rel=0.05)


def test_one_more_error_explains_the_misfit():
    data = phantom("CV-G", 5)
    noise = np.where(np.arange(25) % 2, 0.1, 0.01)
    more = noise_for_misfit(data, noise, 3.0)
    assert np.mean(more**2 / noise**2) == pytest.approx(3.0) and np.ptp(more**2 - noise**2) < 1e-12
    back = noise_for_misfit(data, more, 0.01, noise)
    np.testing.assert_array_equal(back, noise)
    assert noise_for_misfit(data, 0.02, 0.25) == pytest.approx(0.01)


def test_strain_over_noise_takes_the_points_own():
    data = phantom("CV-G", 13)
    assert octahedral_shear_strain(data, np.full(169, 0.02)).median == pytest.approx(
        octahedral_shear_strain(data, 0.02).median
    )
    noisy = np.where(np.arange(169) % 3 < 2, 0.02, 0.2)
    assert (
        octahedral_shear_strain(data, noisy).median > 2 * octahedral_shear_strain(data, rms_noise(data, noisy)).median
    )


@pytest.mark.slow
def test_weights_in_space(monkeypatch):
    monkeypatch.setattr("ngbrain.inverse.elastography.invert_3d.APPROACH", 2)
    points = grid(8, 8, 8, spacing=3e-3)
    data = waves(points, shear_waves(points, 2500 + 500j), poisson=None, bulk=2e5)
    noise = np.where(points[:, 0] > 0.01, 0.04, 0.01)
    noisy = replace(data.with_noise(noise, 0), mask=points[:, 2] < 0.02, dirichlet=None)
    found = invert_in_space(noisy, discretise(noisy, order=2), max_iterations=1)
    np.testing.assert_allclose(
        found.final_state.reduced.misfit.sigma, noise_deviation(noisy, noise)[:, found.final_state.problem.inside]
    )
    assert found.checks["bulk_change_over_noise"] > 0 and np.array_equal(found.noise, noise)


def test_zones_have_their_points_noise():
    points = grid(30, 8, 8)
    data = waves(points, shear_waves(points, 2500 + 500j), poisson=None, bulk=2e5)
    data = replace(data, noise=0.01 + 1e-5 * np.arange(len(points)))
    cells = build_lattice(data, "P3")
    zones = cut_zones(data, cells, [4, 4, 4], [1, 1, 1])
    assert len(zones) > 1
    for zone in zones:
        own, chosen = zone_data(data, zone)
        np.testing.assert_array_equal(own.noise, data.noise[chosen])
        np.testing.assert_allclose(noise_deviation(own, own.noise), noise_deviation(data, data.noise)[:, chosen])
        other, _ = zone_data(data, zone, 0.02)
        assert other.noise == 0.02 and problem_digest(own, zone.cells) != problem_digest(other, zone.cells)
