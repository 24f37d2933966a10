"""Noise in direct inversion. Naive: with the 7-point Laplacian finer sampling makes it worse. Ours: a smooth field does not care.

A plane wave along an axis in space, G = -Σ ρω² (∇²u)*·u / Σ |∇²u|² over all points. With n points per wavelength, x = 2π/n and
complex noise of variance σ² per value, the 7-point Laplacian answers

    G/G₀ = x² (s + 6σ²)/(s² + 42σ²),    s = 2 - 2 cos x,

too stiff for few points and far too soft for many.
"""

import numpy as np
import pytest
from planewaves import FREQUENCY, RHO, grid, waves

from ngbrain.inverse.data.direct_inversion import helmholtz
from ngbrain.inverse.data.smoothing import fit_splines

SPACING, SHAPE = 2e-3, (36, 24, 24)
# Points per wavelength, noise, and G/G₀ of a computation that is not ours, with noise of its own.
TABLE = [(6, 0.0, 1.097), (6, 0.05, 1.006), (10, 0.02, 0.933), (15, 0.02, 0.658), (20, 0.01, 0.703), (20, 0.02, 0.376)]
TABLE += [(20, 0.05, 0.098), (30, 0.02, 0.107), (30, 0.05, 0.024)]


def noisy(ppw, sigma):
    points = grid(*SHAPE, spacing=SPACING)
    shear = RHO * (ppw * SPACING * FREQUENCY) ** 2
    u = np.zeros(points.shape, complex)
    u[:, 1] = 1e-5 * np.exp(-2j * np.pi * points[:, 0] / (ppw * SPACING))
    u[:, 0] = u[:, 2] = np.nan
    return waves(points, u, rheology="elastic").with_noise(sigma, seed=1), shear


def naive(data):
    """Modulus by least squares over all inner points, ∇²u by the 7-point formula."""
    u = data.grid.box(data.displacement[0, :, 1])
    middle = (slice(1, -1),) * 3
    laplacian = -6 * u[middle]
    for axis in range(3):
        for step in (-1, 1):
            laplacian = laplacian + np.roll(u, step, axis)[middle]
    laplacian /= SPACING**2
    right = -data.density * (2 * np.pi * data.frequency[0]) ** 2 * u[middle]
    return (np.vdot(laplacian, right) / np.vdot(laplacian, laplacian)).real


@pytest.mark.parametrize(("ppw", "sigma", "published"), TABLE)
def test_naive_differences_amplify_noise(ppw, sigma, published):
    data, shear = noisy(ppw, sigma)
    x = 2 * np.pi / ppw
    s = 2 - 2 * np.cos(x)
    expected = x**2 * (s + 6 * sigma**2) / (s**2 + 42 * sigma**2)
    found = naive(data) / shear
    print(ppw, sigma, found, expected, published)
    assert expected == pytest.approx(published, rel=5e-3, abs=2e-3) and found == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("ppw", [10, 20, 30])
@pytest.mark.parametrize("sigma", [0.02, 0.05])
def test_a_smooth_field_survives(ppw, sigma):
    data, shear = noisy(ppw, sigma)
    found = helmholtz(data, fit_splines(data), window=0.0).real / shear
    middle = (np.abs(data.points - data.points.mean(axis=0)) < 0.25 * np.ptp(data.points, axis=0)).all(axis=1)
    print(ppw, sigma, np.median(found), np.median(found[middle]), naive(data) / shear)
    assert np.median(found[middle]) == pytest.approx(1, abs=0.05)
