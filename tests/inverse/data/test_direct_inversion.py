"""Direct inversion and local frequency: exact for homogeneous moduli; pressure waves, masks, loads and frequencies."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import RHO, grid, pressure_wave, relative, shear_waves, waves

from ngbrain.errors import InputError
from ngbrain.inverse.data.direct_inversion import (
    _directions,
    helmholtz,
    helmholtz_of_curl,
    local_frequency,
    navier,
    uniform_modulus,
)
from ngbrain.inverse.data.moving_least_squares import moving_least_squares
from ngbrain.inverse.data.smoothing import fit_splines

G = 2000 + 800j
LARGE = 40 * G  # λ + 2G of a wave that is 6 times as long


def inner(points, width):
    return ((points > points.min(axis=0) + width) & (points < points.max(axis=0) - width)).all(axis=1)


@pytest.mark.parametrize("shape", [(30, 26), (20, 18, 16)])
def test_a_homogeneous_modulus_is_found_exactly(shape):
    points = grid(*shape)
    data = waves(points, shear_waves(points, G))
    field, core = fit_splines(data), inner(points, 5e-3)
    for found in (helmholtz(data, field), helmholtz_of_curl(data, field), helmholtz(data, field, window=4e-3)):
        assert np.abs(found[core] / G - 1).max() < 0.01 and found == pytest.approx(G, rel=0.3)
    assert np.median(helmholtz(data).real) == pytest.approx(2000, rel=1e-4)


@pytest.mark.parametrize("missing", [[], [0]])
def test_a_pressure_does_not_stiffen_the_start_in_space(missing):
    points = grid(16, 15, 14)
    data = waves(points, shear_waves(points, G) + pressure_wave(points, LARGE))
    u = data.displacement.copy()
    u[:, :, missing] = np.nan
    assert uniform_modulus(replace(data, displacement=u)).value == pytest.approx(G, rel=0.03)


@pytest.mark.parametrize("shape", [(40, 40), (24, 22, 20)])
def test_pressure_waves_are_told_apart(shape):
    points = grid(*shape)
    data = waves(points, shear_waves(points, G) + pressure_wave(points, LARGE))
    field, core = fit_splines(data), inner(points, 8e-3)
    naive = np.abs(helmholtz(data, field)[core] / G - 1)
    curl = np.abs(helmholtz_of_curl(data, field)[core] / G - 1)
    both, rest = (found[core] for found in navier(data, field, window=4e-3))
    print(np.median(naive), np.median(curl), relative(both, 0 * both + G), relative(rest, 0 * rest + LARGE - G))
    assert np.median(naive) > 0.3 and np.median(curl) < 0.01
    assert relative(both, 0 * both + G) < 0.03 and relative(rest, 0 * rest + LARGE - G) < 0.05


def test_loads_and_frequencies_are_taken_together_and_still_ones_left_out():
    points = grid(32, 32)
    u = np.stack([shear_waves(points, G, f) for f in (40.0, 60.0)])
    still = np.full((1, len(points), 2), 1e-6 + 0j)
    data = waves(points, np.r_[u, still], (40.0, 60.0, 0.0)).with_noise(0.02, seed=0)
    core = inner(points, 5e-3)
    spread = []
    for chosen in ([0, 1, 2], [0], [1]):
        one = waves(points, data.displacement[chosen], data.frequency[chosen])
        found = helmholtz(one, window=4e-3)[core]
        assert np.median(found.real) == pytest.approx(2000, rel=0.05)
        spread.append(relative(found, 0 * found + G))
    assert spread[0] < max(spread[1:])
    for what in (helmholtz, local_frequency):
        with pytest.raises(InputError, match="frequency is 0 in every load"):
            what(waves(points, still, (0.0,)))


def test_answers_are_missing_outside_the_mask_and_real_when_elastic(rng):
    points = grid(30, 30)
    mask = np.linalg.norm(points - 0.029, axis=1) < 0.026
    data = waves(points, shear_waves(points, 2000), rheology="elastic", mask=mask).with_noise(0.01, seed=0)
    for found in (helmholtz(data), navier(data)[0], local_frequency(data)):
        assert np.isnan(found[~mask]).all() and np.isfinite(found[mask]).all() and not found[mask].imag.any()
    assert np.median(helmholtz(data)[mask].real) == pytest.approx(2000, rel=0.05)


def test_one_component_is_enough_for_a_shear_wave():
    points = grid(30, 30)
    u = shear_waves(points, G)
    u[:, 0] = np.nan
    data = waves(points, u)
    assert np.median(helmholtz(data)) == pytest.approx(G, rel=1e-3)
    assert np.median(local_frequency(data)).real == pytest.approx(abs(G), rel=0.15)


def test_scattered_points(rng):
    points = rng.uniform(0, 0.06, (2500, 2))
    data = waves(points, shear_waves(points, G))
    core = inner(points, 6e-3)
    found = helmholtz(data, moving_least_squares(data, degree=4))[core]
    assert np.median(found) == pytest.approx(G, rel=5e-3) and relative(found, 0 * found + G) < 0.02
    with pytest.raises(InputError, match="scattered"):
        local_frequency(data)


@pytest.mark.parametrize("shape", [(80, 70), (40, 38, 36)])
@pytest.mark.parametrize("shear", [1500.0, 4000.0])
def test_local_frequency_of_a_travelling_wave(shape, shear):
    points = grid(*shape)
    data = waves(points, shear_waves(points, shear), rheology="elastic")
    length = np.sqrt(shear / RHO) / 50
    core = inner(points, min(length / 2, 0.02))
    for sigma in (0.0, 0.05):
        found = local_frequency(data.with_noise(sigma, seed=0))[core].real
        print(shape, shear, sigma, np.median(found), np.percentile(found, [5, 95]))
        assert np.median(found) == pytest.approx(shear, rel=0.08)


def test_local_frequency_sees_two_halves():
    points = grid(96, 40)
    x = points[:, 0] - 0.096
    k = 2 * np.pi * 50 * np.sqrt(RHO / np.where(x < 0, 1000.0, 4000.0))
    u = np.stack([0 * x, 1e-5 * np.exp(-1j * k * x)], axis=1)
    found = local_frequency(waves(points, u, rheology="elastic")).real
    left, right = (x > -0.075) & (x < -0.03), (x > 0.03) & (x < 0.075)
    assert np.median(found[left]) == pytest.approx(1000, rel=0.1)
    assert np.median(found[right]) == pytest.approx(4000, rel=0.25)


@pytest.mark.parametrize(("dim", "number", "nearest"), [(2, 6, 60.0), (3, 12, 63.4349)])
def test_directions_are_spread_evenly(dim, number, nearest):
    ways = _directions(dim)
    assert ways.shape == (number, dim) and np.allclose(np.linalg.norm(ways, axis=1), 1)
    assert ways.T @ ways == pytest.approx(number / dim * np.eye(dim), abs=1e-12)
    angles = np.degrees(np.arccos(np.clip(ways @ ways.T, -1, 1))) + 360 * np.eye(number)
    assert angles.min(axis=1) == pytest.approx(np.full(number, nearest), abs=1e-3)
