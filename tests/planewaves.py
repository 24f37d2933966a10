"""Plane shear and pressure waves e^{-ik·x} in homogeneous media, on grids and scattered points."""

import numpy as np

from ngbrain.io.waves import WaveData

RHO, FREQUENCY = 1000.0, 50.0


def wave_number(modulus, frequency=FREQUENCY):
    return 2 * np.pi * frequency * np.sqrt(RHO / np.asarray(modulus, complex))


def grid(*shape, spacing=2e-3):
    return np.indices(shape).reshape(len(shape), -1, order="F").T * spacing


def shear_waves(points, shear, frequency=FREQUENCY):
    """Two shear waves in different directions, (n, d)."""
    d = points.shape[1]
    first, second = (np.array([1.0, 2.0, 2.0][:d]), np.array([2.0, -1.0, 1.0][:d]))
    u = 0
    for way, size in ((first, 1e-5), (second, 0.6e-5)):
        way = way / np.linalg.norm(way)
        across = np.array([-way[1], way[0], 0.0][:d])
        across /= np.linalg.norm(across)
        u = u + size * np.exp(-1j * wave_number(shear, frequency) * (points @ way))[:, None] * across
    if d == 3:  # and one polarised along z
        u = u + 0.8e-5 * np.exp(-1j * wave_number(shear, frequency) * points[:, :1]) * [0, 0, 1.0]
    return u


def pressure_wave(points, modulus, frequency=FREQUENCY):
    """Along (1, 1, …), of the modulus λ + 2G."""
    way = np.ones(points.shape[1]) / np.sqrt(points.shape[1])
    return 2e-5 * np.exp(-1j * wave_number(modulus, frequency) * (points @ way))[:, None] * way


def waves(points, u, frequency=(FREQUENCY,), **changes):
    given = {"symmetry": "isotropic", "rheology": "viscoelastic", "poisson": 0.49}
    u = u if u.ndim == 3 else u[None]
    return WaveData(points, u, list(frequency), RHO, **{**given, **changes})


def relative(found, true):
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))
