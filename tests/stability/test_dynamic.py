"""A nearly incompressible block swings far. Naive: the trapezoidal rule (ρ_∞ = 1). Ours: what cannot be followed is damped."""

import ngsolve as ngs
import numpy as np
from free_vibration import even, stored, swing

from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.inertia import GeneralizedAlpha, Inertia
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block

SIDE = 0.02
STEP = 0.4 * SIDE
"""A tenth (s) of the time in which a shear wave (1 m/s) goes up and down twice."""


def swinging(radius):
    """Energy, over that at first, after each step until the block has swung ten times, and how many steps failed."""
    material = Material(NeoHooke(1e3), 1e6)
    body = Problem(
        block((SIDE,) * 3, SIDE),
        {"tissue": material},
        {"bottom": 0},
        [Inertia({"tissue": 1e3}, GeneralizedAlpha(radius))],
        element="P2/P1",
    )
    body.start((0.5 * ngs.z / SIDE, 0, 0))
    first = body.kinetic_energy()
    transient, rows = swing(body, 100 * STEP, even(STEP), lambda b: [(b.kinetic_energy() + stored(b)) / first])
    return rows[:, 1], transient.progress.rejected


def test_naive_trapezoidal_rule_makes_energy_of_nothing():
    energies, rejected = swinging(1.0)
    assert energies.max() > 2 and rejected > 0


def test_a_scheme_with_damping_swings_on_and_loses_little():
    energies, rejected = swinging(0.8)
    assert energies.max() < 1 and energies[-1] > 0.85 and not rejected and np.size(energies) == 100
