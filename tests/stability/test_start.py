"""A bad rim: at 6 % of the points at the mask's border the wave is off by .3 of its rms. Naive: one least-squares sum over all
points, which the rim decides, as third derivatives of a smooth field are worst there. Ours: a weighted median of the points.

Anti-plane waves in a slab of 8 slices, G* = 2.0 + 0.8i kPa, 2 % noise. Sum over all points: G' off by more than 20 % (on a real
slice repeated 8 times it came out negative); median: within 5 %, G'' within 15 %.

Errors with a grain of a few pixels, as images have, in one slice at four frequencies. Naive: the median of |G| by Helmholtz, whose
denominator is |∇²u|², so that errors count as softness; on a living slice it was .3 kPa where each frequency has 2.7 to 4, and
elements for such waves had 200 000 unknowns. Ours: 1/G, whose denominator is |u|².
"""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import grid, wave_number, waves
from scipy import ndimage

from ngbrain.inverse.data.direct_inversion import helmholtz, uniform_modulus
from ngbrain.inverse.data.smoothing import fit_smooth_field
from ngbrain.inverse.elastography.invert import invert
from ngbrain.io.waves import WaveData

G = 2000 + 800j


def slab(shape, share=0.06, size=0.3):
    """Waves from two sides with motion through the slab, in a disc of tissue, errors at its rim; and which points are wrong."""
    points = grid(*shape, spacing=2.5e-3)
    middle = points.mean(axis=0)
    mask = np.linalg.norm((points - middle)[:, :2], axis=1) < 0.48 * np.ptp(points[:, 0])
    k, x, y = wave_number(G), points[:, 0], points[:, 1]
    u = np.zeros((1, len(points), 3), complex)
    u[0, :, 2] = 1e-5 * (np.exp(-1j * k * x) + 0.7 * np.exp(-1j * k * (np.ptp(y) - y)))
    data = waves(points, u, poisson=None, bulk=2.2e9, mask=mask).with_noise(0.02, seed=1)
    rng = np.random.default_rng(0)
    wrong = data.border & (rng.random(len(points)) < share)
    error = rng.normal(size=(2, wrong.sum())) / np.sqrt(2)
    u = data.displacement.copy()
    u[0, wrong, 2] += size * data.rms[0, 0, 2] * (error[0] + 1j * error[1])
    return replace(data, displacement=u), wrong


def sum_over_all_points(data):
    field, stretch = fit_smooth_field(data), data.density * (2 * np.pi * data.frequency[0]) ** 2
    q, bent = field.curl()[0, data.mask], field.curl_laplacian()[0, data.mask]
    return -stretch * np.sum(np.abs(q) ** 2) / np.sum(np.conj(q) * bent)


def test_a_bad_rim_decides_a_sum_but_no_median():
    data, _ = slab((40, 36, 8))
    naive, ours = sum_over_all_points(data), uniform_modulus(data).value
    print(naive, ours)
    assert abs(naive.real / G.real - 1) > 0.2
    assert ours.real == pytest.approx(G.real, rel=0.05) and ours.imag == pytest.approx(G.imag, rel=0.15)


def grainy_slice(size, grain, frequencies=(30.0, 40.0, 50.0, 60.0)):
    """Anti-plane waves with errors of `size` rms, Gaussian noise through a Gaussian filter of `grain` pixels."""
    points, loads = grid(64, 56, spacing=2.5e-3), []
    mask = np.linalg.norm(points - points.mean(axis=0), axis=1) < 0.48 * np.ptp(points[:, 0])
    for f in frequencies:
        k, x, y = wave_number(G, f), points[:, 0], points[:, 1]
        loads.append(np.exp(-1j * k * x) + 0.7 * np.exp(-1j * k * (np.ptp(y) - y)))
    u = 1e-5 * np.array(loads)[..., None]
    data = WaveData(
        points, u, list(frequencies), 1000.0, "isotropic", "viscoelastic", motion="anti_plane", mask=mask
    ).with_noise(0.02, seed=0)
    rng, u = np.random.default_rng(1), data.displacement.copy()
    for load, rms in enumerate(data.rms[:, 0, 0]):
        real, imag = (ndimage.gaussian_filter(rng.normal(size=data.grid.shape), grain) for _ in range(2))
        error = data.grid.flat(real + 1j * imag)
        u[load, :, 0] += size * rms * error / np.sqrt(np.mean(np.abs(error) ** 2))
    return replace(data, displacement=u)


def test_errors_with_a_grain_are_softness_to_helmholtz_alone():
    data = grainy_slice(0.3, 1.5)
    naive, ours = np.median(np.abs(helmholtz(data)[data.mask])), uniform_modulus(data).value
    print(naive, ours)
    assert naive < 0.5 * abs(G)
    assert ours.real == pytest.approx(G.real, rel=0.1)


@pytest.mark.slow
def test_the_inversion_from_there_holds():
    data, wrong = slab((24, 22, 8))
    found = invert(data)
    modulus = found.maps["storage"] + 1j * found.maps["loss"]
    assert np.isfinite(modulus[data.mask & ~data.border]).any()
    print(np.nanmedian(modulus.real), np.nanmedian(modulus.imag), found.checks, wrong.sum(), found.warnings)
    assert np.nanmedian(modulus.real) == pytest.approx(G.real, rel=0.1)
    assert np.nanmedian(modulus.imag) == pytest.approx(G.imag, rel=0.2)
    assert any("gross errors" in note for note in found.warnings)
