"""Bodies with mass that swing by themselves against closed forms: torsion of a round bar, elastic and relaxing.

Torsion sin(πz/2L) of a bar on one end is exact for any radius, without pressure; of G(t) the angle obeys
θ̈ + k² ∫ G(t - s) θ̇(s) ds = 0 with k² = (π/2L)²/ρ, by Laplace θ(s) = θ̇(0)/(s² + k² s Ĝ(s)).
"""

import numpy as np
import pytest
from free_vibration import LENGTH, bar, even, stored, swing, turned, twist

from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.inertia import GeneralizedAlpha, Inertia
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import Branch, Maxwell, NeoHooke, Viscous, fourier

MU, RHO, RATE = 1000.0, 1000.0, 1e-2
K = np.pi / 2 / LENGTH
PERIOD = 2 * np.pi / (K * np.sqrt(MU / RHO))
TAU = 0.02


def swung(law, radius, steps, periods=1.0):
    """A bar's angle over time (t, θ, energy over that at first) with so many steps a period."""
    body = Problem(
        bar(),
        {".*": Material(law, 1e6)},
        {"bottom": 0},
        [Inertia({".*": RHO}, GeneralizedAlpha(radius))],
        element="P2/P1",
    )
    body.start(twist(RATE))
    first = body.kinetic_energy()

    def look(b):
        return turned(b), (b.kinetic_energy() + stored(b)) / first

    _, rows = swing(body, periods * PERIOD, even(PERIOD / steps), look)
    return rows.T


def relaxing(t, stays, relaxes, tau):
    """θ/θ̇(0) of G = stays + relaxes exp(-t/τ), and its poles."""
    k2 = K**2 / RHO
    inner = np.poly1d([tau, 1.0])
    whole = np.poly1d([1.0, 0.0, k2 * stays]) * inner + np.poly1d([k2 * relaxes * tau, 0.0])
    parts = [inner(s) / whole.deriv()(s) * np.exp(s * t) for s in whole.roots]
    return np.sum(parts, axis=0).real, whole.roots


@pytest.mark.parametrize("radius", [1.0, 0.8])
def test_an_elastic_bar_swings_with_the_frequency_of_its_waves(radius):
    errors = []
    for steps in (20, 40):
        t, angle, energy = swung(NeoHooke(MU), radius, steps)
        errors.append(np.abs(angle * 2 * np.pi / PERIOD / RATE - np.sin(2 * np.pi * t / PERIOD)).max())
        if radius == 1.0:
            assert np.abs(energy - 1).max() < 1e-6
        else:
            assert 0.99 < energy[-1] < 0.9999 and energy.max() < 1
    assert errors[0] < 0.055 and errors[1] < 0.01, errors


BRANCHES = {"hereditary": Branch(NeoHooke(400.0), TAU), "flowing": Maxwell(NeoHooke(400.0), 400.0 * TAU)}


@pytest.mark.parametrize("kind", BRANCHES)
def test_a_relaxing_bar_dies_away_as_its_complex_modulus_says(kind):
    law = Viscous(NeoHooke(600.0), (BRANCHES[kind],))
    t, angle, _ = swung(law, 0.8, 40, periods=2.0)
    exact, poles = relaxing(t, 600.0, 400.0, TAU)
    assert np.abs(angle / RATE - exact).max() < 0.01 * np.abs(exact).max()
    # From crest to crest angles fall about by π tan δ of harmonic work at that frequency, and as much by the swinging pole.
    s = poles[np.argmax(poles.imag)]
    crests = [i for i in range(1, len(t) - 1) if (angle[i] - angle[i - 1]) * (angle[i + 1] - angle[i]) < 0]
    decrement, modulus = np.log(angle[crests[1]] / angle[crests[3]]), fourier(law)(s.imag)
    assert decrement == pytest.approx(np.pi * modulus.imag / modulus.real, rel=0.05)
    assert decrement == pytest.approx(-2 * np.pi * s.real / s.imag, rel=0.06)
