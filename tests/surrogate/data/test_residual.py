"""True maps have no residual, wrong ones do; other boundary conditions are detected at the edges."""

import ngsolve as ngs
import numpy as np
import pytest
from algebraic_operator import few, noisy

from ngbrain.surrogate.data.dataset import DENSITY, FINE, SIDES, sample, solve_displacement
from ngbrain.surrogate.data.random_fields import family
from ngbrain.surrogate.data.residual import compression_residual, wave_residual

UNIT = DENSITY * (2 * np.pi * 50 * SIDES["waves"]) ** 2
PUSH = (1e-3, 5e-4)


def driven(drive, poisson=0.3, across=51, name="gaussian_width"):
    """Displacement with 1 % of noise and G/ρω²L² of a lossy square at 50 Hz."""
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, FINE),), indexing="ij")
    fine = (6e3 + 1e3j) * family(name)(np.random.default_rng(1), x, y)
    u = solve_displacement(fine, 50.0, poisson, drive, across)
    return noisy(u[None], 0.01)[0], fine[:: FINE // (across - 1), :: FINE // (across - 1)] / UNIT


@pytest.mark.parametrize("poisson", [0.3, 0.4999])
@pytest.mark.parametrize("across", [51, 101])
def test_right_maps_have_no_residual_whatever_the_pressure(poisson, across):
    u, modulus = driven({"top": PUSH}, poisson, across)
    right = wave_residual(u, modulus)[0]
    assert right < 0.015
    for wrong in (np.full_like(modulus, np.median(modulus)), modulus[::-1], modulus.real, 1.3 * modulus):
        assert wave_residual(u, wrong)[0] > 5 * right


def test_a_wave_too_stiff_by_a_factor():
    """For a plane wave A = αM, so that r = |α - 1|/√(α² + 1)."""
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, 81),), indexing="ij")
    k = 11.0
    wave = np.exp(-1j * k * (0.6 * x + 0.8 * y))[..., None] * [0.8, -0.6]
    for factor in (0.5, 1.2, 3.0):
        found = wave_residual(wave, np.full((81, 81), factor / k**2))[0]
        assert found == pytest.approx(abs(factor - 1) / np.hypot(factor, 1), abs=2e-3)


def test_each_edge_may_be_the_one_that_is_shaken():
    u, modulus = driven({"top": PUSH})
    first = wave_residual(u, modulus)[1]
    assert first < 0.03
    assert wave_residual(u[::-1] * [1, -1], modulus[::-1])[1] == pytest.approx(first)
    aside = wave_residual(u.transpose(1, 0, 2)[..., ::-1], modulus.T)
    assert aside == pytest.approx(wave_residual(u, modulus))


def half(way):
    step = 1 / (1 + ngs.exp((ngs.x - SIDES["waves"] / 2) / 0.006))
    return ngs.CF(tuple(part * step for part in way))


@pytest.mark.parametrize(
    "drive",
    [
        {"top": PUSH, "bottom": (0, 0)},
        {"top": PUSH, "bottom": (-1e-3, -5e-4)},
        {"top": PUSH, "bottom": PUSH},
        {"top": half(PUSH)},
    ],
    ids=["clamped opposite", "opposed", "both", "half an edge"],
)
def test_another_way_of_driving_shows_at_the_edges_alone(drive):
    u, modulus = driven(drive)
    inside, edges = wave_residual(u, modulus)
    assert inside < 0.02 and edges > 0.15


def test_right_and_wrong_maps_of_compression():
    data = few("compression", "validation")
    for i in (0, 5):
        u, nu = noisy(data.displacement[[i]], 0.01)[0] / SIDES["compression"], data.poisson[i]
        right, plates = compression_residual(u, data.storage[i], nu)
        assert right < 0.02 and plates < 1.4
        assert compression_residual(u, 7 * data.storage[i], nu)[0] == pytest.approx(right)  # the level is no matter
        for wrong in (np.ones_like(data.storage[i]), data.storage[i][::-1, ::-1], data.storage[i - 1]):
            assert compression_residual(u, wrong, nu)[0] > 3 * right


@pytest.mark.parametrize("noise", [0.005, 0.03])
def test_plates_are_as_even_as_the_noise_lets_them_be(noise):
    one = sample("compression", "gaussian_width", 0, "test", 0, 51)
    u = noisy(one.displacement[None], noise)[0] / SIDES["compression"]
    assert compression_residual(u, one.storage, one.poisson)[1] == pytest.approx(1.1, abs=0.3)


def test_a_plate_that_tilts():
    one = sample("compression", "gaussian_width", 0, "test", 0, 41)
    tilted = (
        one.displacement / SIDES["compression"]
        + 2e-3 * np.linspace(0, 1, 41)[None, :, None] * np.linspace(0, 1, 41)[:, None, None]
    )
    plain = compression_residual(one.displacement / SIDES["compression"], one.storage, one.poisson)
    assert compression_residual(tilted, one.storage, one.poisson)[1] > 10 * plain[1] + 0.1
