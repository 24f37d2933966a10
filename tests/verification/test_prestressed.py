"""Shear waves along a stretched bar against Ogden 2007, 10.1007/978-3-211-73572-5_1: ρc² = λ₁² (λ₁W₁ - λ₂W₂)/(λ₁² - λ₂²)."""

from math import inf

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured3DMesh

from ngbrain.forward.common.material import Material
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveModel
from ngbrain.forward.sensitivity.static_model import PrescribedDisplacement
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import MooneyRivlin, NeoHooke, Ogden

LENGTH, WIDTH, MU, RHO, FREQUENCY, ETA = 0.1, 0.02, 2e3, 1000.0, 24.0, 0.15
PLACES = LENGTH * np.array([0.13, 0.3, 0.52, 0.77, 0.9])
ALPHA, C01 = -6.0, 600.0

LAWS = {
    "Neo-Hooke": (NeoHooke, lambda s: MU * s**2),
    "Mooney-Rivlin": (lambda mu: MooneyRivlin(mu / 2 - C01, C01), lambda s: s**2 * (MU - 2 * C01 + 2 * C01 / s)),
    "Ogden": (
        lambda mu: Ogden(mu, ALPHA),
        lambda s: 2 * MU / ALPHA * s**2 * (s**ALPHA - s ** (-ALPHA / 2)) / (s**2 - 1 / s),
    ),
}
"""Laws, and ρc² (Pa) of waves along the axis at a stretch s of it."""


def stretched(law, stretch, loss=ETA, frequency=FREQUENCY):
    """A bar between rollers, without change of volume, driven across at one end and held at the other."""
    bar = MakeStructured3DMesh(nx=6, ny=1, nz=1, hexes=True, mapping=lambda x, y, z: (LENGTH * x, WIDTH * y, WIDTH * z))
    mu = ngs.Parameter(MU)
    ends = {"back": (0, None, None), "front": ((stretch - 1) * LENGTH, None, None)}
    rollers = ends | {"left": (None, 0, None), "bottom": (None, None, 0)}
    body = Problem(bar, {".*": Material(law(mu), inf)}, rollers, element="Q4/Q3")
    across = [Wave(frequency, {"back": (0, 1e-6, 0)})]
    points = np.array([(x, 0.4 * WIDTH, 0.7 * WIDTH) for x in PLACES])
    held = {"x": ".*", "y": "back|front", "z": ".*"}
    parameters = {"mu": mu, "front": PrescribedDisplacement(body, "front")}
    return WaveModel(HarmonicProblem.about(body, across, loss=loss, density=RHO, dirichlet=held), parameters, points)


def standing(modulus, stretch):
    """Between the ends, at x = λX of the bar as it is now: sin k(l - x)/sin kl with ρω² = ρc² (1 + iη) k²."""
    k = 2 * np.pi * FREQUENCY * np.sqrt(RHO / (modulus * (1 + 1j * ETA)))
    length, x = stretch * LENGTH, stretch * PLACES
    return 1e-6 * np.sin(k * (length - x)) / np.sin(k * length)


@pytest.mark.parametrize(("law", "stretch"), [("Neo-Hooke", 1 + 1e-5)] + [(law, s) for law in LAWS for s in (0.8, 1.2)])
def test_waves_along_the_axis(law, stretch):
    made, modulus = LAWS[law]
    model = stretched(made, stretch)
    found = model.evaluate(model.theta).data[0]
    wanted = standing(modulus(stretch), stretch)
    assert np.abs(found[:, 1] - wanted).max() < 1e-3 * np.abs(wanted).max()
    assert np.abs(found[:, [0, 2]]).max() < 1e-6 * np.abs(wanted).max()


@pytest.mark.parametrize(("law", "stretch"), [(law, s) for law in LAWS for s in (0.8, 1.2)])
def test_resonances_of_a_stretched_bar(law, stretch):
    """The first, without loss: ω = π/(λL) √(ρc²/ρ)."""
    made, modulus = LAWS[law]
    first = np.pi / (stretch * LENGTH) * np.sqrt(modulus(stretch) / RHO)
    model = stretched(made, stretch, loss=0.0, frequency=0.9 * first / (2 * np.pi))
    assert model.evaluate(model.theta).factors.detuning(0) == pytest.approx(1 / 0.9 - 1, abs=2e-4)


@pytest.mark.parametrize("stretch", [0.8, 1.2])
def test_how_they_change(stretch):
    """With μ, and with the stretch, which they know of through the equilibrium alone."""
    made, modulus = LAWS["Mooney-Rivlin"]
    model, h = stretched(made, stretch), 1e-5
    there = model.evaluate(model.theta)
    by_mu, by_stretch = np.zeros((2, model.size))
    by_mu[model.blocks["mu"]] = MU
    by_stretch[model.blocks["front"]] = model.theta[model.blocks["front"]] / (stretch - 1)
    more, less = (standing(modulus(stretch) + sign * h * MU * stretch**2, stretch) for sign in (1, -1))
    longer, shorter = (standing(modulus(stretch + sign * h), stretch + sign * h) for sign in (1, -1))
    for direction, wanted in ((by_mu, (more - less) / (2 * h)), (by_stretch, (longer - shorter) / (2 * h))):
        found = there.jvp(direction)[0, :, 1]
        assert np.abs(found - wanted).max() < 2e-3 * np.abs(wanted).max()
