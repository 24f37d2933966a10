"""Waves through a slice whose mean was subtracted, as whole-head motion is, or an unknown multiple of 2π of a phase.

Naive: they are inverted as they are. Ours: each wave has an unknown translation beside it.

Two crossing waves in a slice of 50 × 50 mm, about one wavelength at 40 Hz: subtracting their mean changes ρω²u, not ∇²u.
"""

import numpy as np
import pytest
from planewaves import grid, wave_number

from ngbrain.forward.harmonic import problem as harmonic
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.problem import wave_problem
from ngbrain.io.waves import WaveData

G, HZ = 2000 + 800j, 40.0


@pytest.fixture
def data():
    points = grid(21, 21, spacing=2.5e-3)
    k = wave_number(G, HZ)
    u = np.exp(-1j * k * points[:, 0]) + 0.8 * np.exp(-1j * k * (points @ [0.6, 0.8]))
    u = 1e-5 * (u - u.mean())[None, :, None]
    made = WaveData(points, u, [HZ], 1000.0, "isotropic", "viscoelastic", motion="anti_plane")
    return made.with_noise(0.01, seed=0)


def errors(data):
    found = invert(data, uniform=False, regulariser="smooth", max_iterations=12)
    storage, loss = (np.abs(found.maps[name] / known - 1) for name, known in (("storage", 2000), ("loss", 800)))
    return float(np.median(storage)), float(np.median(loss))


def test_naive_the_subtracted_mean_spoils_the_moduli(data, monkeypatch):
    def whole(*args, translation, **options):
        return harmonic.HarmonicProblem(*args, **options)

    monkeypatch.setattr(wave_problem, "HarmonicProblem", whole)
    storage, loss = errors(data)
    print(storage, loss)
    assert max(storage, loss) > 0.15


def test_ours_finds_the_moduli(data):
    storage, loss = errors(data)
    print(storage, loss)
    assert storage < 0.03 and loss < 0.08
