"""Octahedral shear strain and its signal-to-noise ratio: closed forms and known noise."""

import numpy as np
import pytest

from ngbrain.image.mre.strain import gradient_noise, octahedral_amplitude, octahedral_strain, strain_snr


def test_octahedral_strain_of_known_states():
    stretch = np.diag([2.0, -1.0, -1.0])  # uniaxial, no change of volume: √2 times the stretch
    assert octahedral_strain(stretch) == pytest.approx(2 / 3 * np.sqrt(18))
    assert octahedral_strain(np.eye(3)) == 0
    gamma = np.zeros((3, 3))
    gamma[0, 1] = gamma[1, 0] = 0.5
    assert octahedral_strain(gamma) == pytest.approx(np.sqrt(2 / 3))
    assert octahedral_strain(gamma[:2, :2]) == pytest.approx(np.sqrt(2 / 3))
    assert octahedral_strain(np.diag([1.0, 0])) == pytest.approx(octahedral_strain(np.diag([1.0, 0, 0])))


def test_strain_over_a_period(rng):
    gradient = rng.normal(size=(6, 3, 3)) + 1j * rng.normal(size=(6, 3, 3))
    t = np.linspace(0, np.pi, 20001)[:-1]
    e = (gradient + np.swapaxes(gradient, 1, 2)) / 2
    over = octahedral_strain((e[:, None] * np.exp(1j * t)[:, None, None]).real)
    peak, mean = octahedral_amplitude(gradient)
    assert peak == pytest.approx(over.max(axis=1), rel=1e-6) and mean == pytest.approx(over.mean(axis=1), rel=1e-6)
    standing = np.array([[0, 1.0], [0, 0]])
    peak, mean = octahedral_amplitude(standing * (1 + 1j))
    assert peak == pytest.approx(np.sqrt(2 / 3) * np.sqrt(2)) and mean == pytest.approx(2 / np.pi * peak)
    circular = np.array([[0, 0, 1.0], [0, 0, 1j], [0, 0, 0]])  # the same strain all the time
    peak, mean = octahedral_amplitude(circular)
    assert peak == pytest.approx(np.sqrt(2 / 3)) and mean == pytest.approx(peak)


def test_noise_of_strain_is_what_repetition_shows(rng):
    """Propagation of errors against 4000 repetitions at a Gauss point's time of a strain well above the noise."""
    h, sigma = np.array([2e-3, 2e-3, 3e-3]), 1e-7
    x = np.stack(np.meshgrid(*[h_i * np.arange(3) for h_i in h], indexing="ij"), axis=-1)
    G = 0.01 * rng.normal(size=(3, 3))
    found = []
    for _ in range(4000):
        u = x @ G.T + sigma * rng.normal(size=x.shape)
        gradient = np.stack([(np.take(u, 2, i)[1, 1] - np.take(u, 0, i)[1, 1]) / (2 * h[i]) for i in range(3)], axis=-1)
        found.append(octahedral_strain((gradient + gradient.T) / 2))
    noise = gradient_noise(np.full(3, sigma), h)
    assert noise == pytest.approx(sigma / np.sqrt(2) / h * np.ones((3, 1)))
    snr, spread = strain_snr(
        G * (1 + 0j), noise
    )  # Re(G e^{iωt}): only the size changes, so the noise is the same all the time
    assert spread == pytest.approx(np.std(found), rel=0.04)
    assert snr == pytest.approx(2 / np.pi * octahedral_strain((G + G.T) / 2) / spread)
    snr, spread = strain_snr(np.zeros((2, 3, 3), complex), np.ones((3, 3)))
    assert not snr.any() and (spread > 0).all()
