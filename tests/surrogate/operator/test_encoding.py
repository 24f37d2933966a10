"""Input channels: exact derivatives of polynomials, the modulus of uniform tissue, noise estimates."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from ngbrain.errors import InputError
from ngbrain.surrogate.data.dataset import sample, solve_displacement
from ngbrain.surrogate.operator.derivatives import derivative_matrix, partial_derivative
from ngbrain.surrogate.operator.encoding import (
    FLAT,
    GRAIN,
    add_noise,
    estimate_jump,
    estimate_noise,
    modality,
    remove_affine,
)


@pytest.mark.parametrize("n", [26, 51, 64])
def test_derivatives_of_polynomials_are_exact_up_to_the_edges(n):
    x = np.linspace(0, 1, n)
    for order, exact in ((0, x**5), (1, 5 * x**4), (3, 60 * x**2)):
        assert np.abs(derivative_matrix(n, 0.1, order) @ x**5 - exact).max() < 1e-7 * 60


@pytest.mark.parametrize(("n", "half", "order", "degree"), [(51, 0.1, 1, 5), (64, 0.08, 2, 5), (26, 0.03, 0, 3)])
def test_derivatives_are_those_of_savitzky_and_golay(n, half, order, degree):
    """Of data that no polynomial fits, beside SciPy's filter, the ends included."""
    window = 2 * max(round(half * (n - 1)), (degree + 1) // 2) + 1
    expected = savgol_filter(np.eye(n), window, degree, order, delta=1 / (n - 1), axis=0, mode="interp")
    found = derivative_matrix(n, half, order, degree)
    assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max()


def test_partial_derivatives_know_their_axes():
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, 51),), indexing="ij")
    assert np.allclose(partial_derivative(x**2 * y**3, 0.1, 1, 2), 2 * x * 6 * y)
    assert np.allclose(partial_derivative(1j * x**2 * y, 0.1, 2, 0), 2j * y)


@pytest.mark.parametrize("poisson", [0.3, 0.499])
def test_a_uniform_square_tells_its_modulus(poisson):
    """The estimate by the curl is independent of ν, in units of ρω²L²."""
    shear = 6e3 * (1 + 0.2j)
    u = solve_displacement(np.full((5, 5), shear), 50.0, poisson, {"top": (1e-3, 0)}, 51)
    found = modality("waves").features(u[None], np.array([poisson]))[0, :, 5:-5, 5:-5]
    unit = modality("waves").unit(np.zeros((1, 2, 2)), np.array([50.0]), 1000.0, 0.12)[0]
    assert np.median(np.abs(found[12] - np.log(abs(shear) / unit))) < 0.01
    assert np.median(np.abs(found[13] - np.angle(shear))) < 0.01


def test_features_mean_the_same_on_every_grid():
    """A field without noise on 51 and 101 points; the difference is due to windows of whole points."""
    one = sample("waves", "sinc", 0, "test", 0, 101)
    fine = modality("waves").features(one.displacement[None], np.array([one.poisson]))[:, :-1, ::2, ::2]
    coarse = modality("waves").features(one.displacement[None, ::2, ::2], np.array([one.poisson]))[:, :-1]
    off = np.sqrt(((fine - coarse) ** 2).mean(axis=(0, 2, 3)) / (coarse**2).mean(axis=(0, 2, 3)))
    assert np.median(off) < 0.05 and off.max() < 0.3


def test_moduli_and_amplitudes_have_no_units():
    """Twice the size, half the frequency, any amplitude and phase: the same channels up to the phase."""
    shear = np.full((5, 5), 5e3 + 500j)
    u = solve_displacement(shear, 60.0, 0.3, {"top": (1e-3, 0)}, 31)
    twice = solve_displacement(shear, 30.0, 0.3, {"top": (7e-3j, 0)}, 31, side=0.24)
    first, second = (modality("waves").features(each[None], np.array([0.3])) for each in (u, twice))
    assert np.allclose(first[:, 12:24], second[:, 12:24], atol=1e-4)


@pytest.mark.parametrize("name", ["waves", "compression"])
@pytest.mark.parametrize("sigma", [0.01, 0.05, 0.15])
def test_noise_is_found(name, sigma):
    u = sample(name, "inclusions", 0, "test", 1, 51).displacement[None]
    random = np.random.default_rng(1)
    a, b = random.standard_normal((2, *u.shape))
    rms = np.sqrt((np.abs(remove_affine(u)) ** 2).mean(axis=(1, 2), keepdims=True))
    noise = (a + 1j * b) / np.sqrt(2) if name == "waves" else a
    assert estimate_noise(u + sigma * rms * noise)[0] == pytest.approx(sigma, rel=0.1)
    assert estimate_noise(u)[0] < 0.003


def correlation(noise, lag, axis):
    """Correlation of noise (batch, n, n, …) at a distance in points."""
    n = noise.shape[axis]
    one, other = (np.take(noise, np.arange(n - lag) + shift, axis) for shift in (0, lag))
    return (one * np.conj(other)).real.mean() / (np.abs(noise) ** 2).mean()


def test_grained_noise_is_as_large_as_white_noise_and_correlated_over_its_grain(rng):
    u = np.zeros((40, 51, 51, 1))
    u[...] = (np.linspace(-1, 1, 51) ** 2)[:, None, None]
    sigma = np.full(40, 0.1)
    rms = np.sqrt((remove_affine(u) ** 2).mean())
    noise = (add_noise(u, sigma, rng, np.full(40, 0.08)) - u) / (0.1 * rms)
    assert np.sqrt((noise**2).mean()) == pytest.approx(1, abs=0.02)
    assert np.abs((noise**2).mean(axis=(0, 1, 3)) - 1).max() < 0.15  # as large at the edges
    assert correlation(noise, 4, axis=2) == pytest.approx(np.exp(-1), abs=0.05)
    assert correlation(noise, 4, axis=1) == pytest.approx(np.exp(-1 / FLAT**2), abs=0.05)
    white, same = (add_noise(u, sigma, np.random.default_rng(0), grain) for grain in (None, np.zeros(40)))
    assert np.array_equal(white, same)


def test_training_sees_a_grain_in_half_of_what_ultrasound_measures_and_in_no_waves(rng):
    u = sample("compression", "sinc", 0, "test", 0, 51).displacement[None].repeat(60, axis=0)
    sigma = np.full(60, 0.02)
    noise = modality("compression").add_noise(u, sigma, rng) - u
    rough = np.array([correlation(each[None], 1, axis=2) for each in noise])
    assert 0.3 < (rough > 0.06).mean() < 0.55 and rough.max() == pytest.approx(np.exp(-((0.02 / GRAIN) ** 2)), abs=0.1)
    u = u * [1, 1j]
    one, same = (f(u, sigma, np.random.default_rng(0)) for f in (modality("waves").add_noise, add_noise))
    assert np.array_equal(one, same)


def test_grained_noise_is_found_though_not_all_of_it():
    u = sample("compression", "inclusions", 0, "test", 1, 51).displacement[None]
    found = [
        estimate_noise(add_noise(u, np.array([0.1]), np.random.default_rng(1), np.array([g])))[0] for g in (0, GRAIN)
    ]
    assert found[0] == pytest.approx(0.1, rel=0.1)
    assert found[1] == pytest.approx(0.08, rel=0.1)


@pytest.mark.parametrize("across", [26, 51, 101])
def test_a_seam_is_a_jump_and_an_edge_of_tissue_is_none(across):
    """The noise estimate, a median over the points, is insensitive to the seam."""
    one, other = (sample("waves", "inclusions", 0, "validation", i, across).displacement[None] for i in (1, 4))
    torn = one.copy()
    torn[:, :, : across // 2] = other[:, :, : across // 2] * np.linalg.norm(one) / np.linalg.norm(other)
    assert estimate_jump(torn)[0] > 4 * estimate_jump(one)[0]
    assert estimate_noise(torn)[0] < 2 * max(estimate_noise(one)[0], estimate_noise(other)[0])
    wrapped = one.copy()
    patch = slice(across // 3, across // 2)
    wrapped[:, patch, patch] += 2 * np.abs(one).max()
    assert estimate_jump(wrapped)[0] > 4 * estimate_jump(one)[0]


def test_a_component_that_hardly_moves_has_no_jumps_of_its_own(rng):
    x = np.linspace(0, 1, 51)
    u = np.zeros((1, 51, 51, 2), complex)
    u[0, :, :, 0] = np.exp(-9j * x)
    u[0, :, :, 1] = 1e-3 * (rng.standard_normal((51, 51)) + 1j * rng.standard_normal((51, 51)))
    assert estimate_jump(u)[0] < 0.005


def test_unknown_modalities_are_refused():
    with pytest.raises(InputError, match="waves"):
        modality("wave")
