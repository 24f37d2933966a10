"""Outliers of the displacement: detected without false alarms; missing values stay missing; bad input."""

from dataclasses import replace

import numpy as np
import pytest
from corrupted_waves import spoiled
from planewaves import grid, shear_waves, waves

from ngbrain.errors import InputError
from ngbrain.inverse.data.outliers import discontinuity_share, remove_outliers, screen_outliers, torn_displacements
from ngbrain.inverse.phantoms.benchmark import Phantom

G = 2000 + 800j


@pytest.mark.parametrize("shape", [(24, 20), (10, 9, 11)])
def test_they_are_found_and_nothing_else_is(shape):
    points = grid(*shape)
    data = waves(points, shear_waves(points, G)).with_noise(0.01, seed=1)
    bad, where = spoiled(data, 0.03, 0.5, seed=2)
    found = np.isnan(remove_outliers(bad).displacement)
    assert found[:, ~where].mean() < 0.003
    assert found[:, where].mean() > 0.9  # some are as small as noise is


@pytest.mark.parametrize(("row", "column"), [(0, 10), (5, 3), (10, 10)])
@pytest.mark.parametrize("shape", [(2, 1), (1, 3), (2, 2)])
def test_errors_side_by_side_do_not_hide_each_other(row, column, shape):
    points = grid(24, 20)
    data = waves(points, shear_waves(points, G)).with_noise(0.01, seed=1)
    patch = np.arange(480).reshape(20, 24)[row : row + shape[0], column : column + shape[1]].ravel()
    u = data.displacement.copy()
    u[:, patch] += 2 * data.rms.max()
    found = np.isnan(remove_outliers(replace(data, displacement=u)).displacement)
    assert found[:, patch].all() and found.sum() == found[:, patch].sum()


def test_where_moduli_jump_nearly_all_stays():
    data = Phantom.from_name("CV-B").simulate_measurements(0.01).data()
    assert np.isnan(remove_outliers(data).displacement).mean() < 2e-3


def test_of_good_data_every_datum_stays():
    points = grid(24, 20)
    for noise in (0.0, 0.02):
        data = waves(points, shear_waves(points, G)).with_noise(noise, seed=1)
        np.testing.assert_array_equal(remove_outliers(data).displacement, data.displacement)


def test_what_is_off_by_less_than_noise_ever_is_stays():
    points = grid(24, 20)
    data = waves(points, np.column_stack([points[:, 1], 0 * points[:, 0]])[None].astype(complex) * 1e-3)
    u = data.displacement.copy()
    u[0, 100, 0] += 1e-3 * data.rms[0, 0, 0]
    bent = replace(data, displacement=u)
    np.testing.assert_array_equal(remove_outliers(bent).displacement, u)


def test_scattered_points(rng):
    points = rng.uniform(0, 0.05, (500, 2))
    bad, where = spoiled(waves(points, shear_waves(points, G)).with_noise(0.01, seed=1), 0.02, 1.0, seed=2)
    found = np.isnan(remove_outliers(bad).displacement)
    assert found[:, where].mean() > 0.8 and found[:, ~where].mean() < 0.01


def test_what_is_not_measured_or_outside_stays_as_it_is():
    points = grid(20, 20)
    data = waves(points, shear_waves(points, G)).with_noise(0.01, seed=1)
    u, mask = data.displacement.copy(), points[:, 0] > 4e-3
    u[:, :, 1] = np.nan
    u[0, 0, 0] = 1e-3
    found = remove_outliers(replace(data, displacement=u, mask=mask, dirichlet=None))
    np.testing.assert_array_equal(found.displacement, u)


def test_too_few_points_to_tell_errors_by():
    """9 × 9 points of exact waves: the smallest spline misses 14 of 162 displacements."""
    left, notes, _ = screen_outliers(Phantom.from_name("CV-G", 9).simulate_measurements(0.0).data())
    assert left.measured.all() and "too few points" in notes[0]


def test_bad_input():
    points = grid(20, 20)
    with pytest.raises(InputError, match="far is 0"):
        remove_outliers(waves(points, shear_waves(points, G)), far=0)


ROUND = np.hypot(*(grid(24, 20) - [0.02, 0.018]).T) < 0.006
BAND = (np.arange(480) % 24 == 12) | (np.arange(480) % 24 == 13)


def patched(where, size):
    """One component of waves with 1 % of noise, off by `size` of its rms at the points `where`."""
    points = grid(24, 20)
    data = waves(points, shear_waves(points, G)).with_noise(0.01, seed=1)
    u = data.displacement.copy()
    u[0, where, 1] += size * data.rms[0, 0, 1]
    return replace(data, displacement=u)


def test_a_wrapped_patch_goes_whole():
    data = patched(ROUND, 3.0)
    torn, patches = torn_displacements(data)
    np.testing.assert_array_equal(torn[0, :, 1], ROUND)
    np.testing.assert_array_equal(torn, patches)
    left, _, share = screen_outliers(data)
    assert not torn[0, :, 0].any() and share == ROUND.sum() / 960
    assert discontinuity_share(data) > 0.02 and discontinuity_share(left) == 0


def test_a_vessel_that_divides_the_grid_goes_and_both_sides_stay(rng):
    data = patched(BAND, 2 * np.exp(2j * np.pi * rng.random(BAND.sum())))
    torn, patches = torn_displacements(data)
    assert not patches.any() and torn[0, BAND, 1].mean() > 0.9 and not torn[0, ~BAND].any()


def test_half_of_another_scan_is_no_patch():
    left = grid(24, 20)[:, 0] < 0.024
    torn, _ = torn_displacements(patched(left, 3.0))
    assert not torn.any()


@pytest.mark.parametrize("nodes", [17, 21, 25])
def test_a_wave_of_few_points_beside_the_border_is_not_torn(nodes):
    """CV-B with eight points a wavelength: u steps by its own size from row to row, without any row being off."""
    data = Phantom.from_name("CV-B", nodes).simulate_measurements(0.01).data()
    torn, patches = torn_displacements(data)
    assert not patches.any() and not torn.any()
