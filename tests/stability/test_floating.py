"""A body in a fluid. Naive: the fluid's pressure as a dead load, that of the place at rest. A floating body then never finds its
draught, as sinking changes nothing, and falls until something else holds it. Or pressure at the depth at rest that follows the
surface: the same, with an unsymmetric tangent on top. Ours: pressure at the depth now, from a potential of the surface.
"""

import ngsolve as ngs
import numpy as np
import pytest
from statics import SIDE, cube

from ngbrain.forward import BodyForce, FluidPressure, LoadPath, Material, PressureLoad, Problem, Spring
from ngbrain.forward.common.loads import TractionLoad
from ngbrain.materials import NeoHooke

WATER, WOOD, LEVEL, HOLD = 1000 * 9.81, 600 * 9.81, SIDE / 2, 1.0
"""Weights (N/m³), the level at rest (m), and a thread by which it hangs (N/m)."""
SUNK = (WOOD * SIDE - WATER * LEVEL) * SIDE**2 / (WATER * SIDE**2 + HOLD)
"""Weight less lift at rest, over what a metre of sinking adds (m)."""


def draught(loads):
    """How far it sinks (m), and the body."""
    loads = [BodyForce((0, 0, -WOOD)), Spring("top", HOLD / SIDE**2), *loads]
    tissue = {".*": Material(NeoHooke(1e5), 1e8)}
    body = Problem(cube(1), tissue, {"back|front|left|right": (0, 0, None)}, loads, element="P2/P1")
    LoadPath(body).solve()
    return -ngs.Integrate(body.u[2], body.mesh) / SIDE**3, body


def dead():
    return [TractionLoad("bottom", (0, 0, WATER * LEVEL))]


def following_at_rest():
    return [PressureLoad("bottom", WATER * LEVEL)]


@pytest.mark.parametrize("naive", [dead, following_at_rest])
def test_naive_a_body_falls_through_the_fluid(naive):
    sunk, body = draught(naive())
    assert sunk > 50 * SUNK and sunk > 9 * SIDE
    assert body.symmetric == (naive is dead)


def test_a_body_floats():
    sunk, body = draught([FluidPressure((0, 0, -WATER), LEVEL)])
    assert sunk == pytest.approx(SUNK, rel=1e-3) and body.symmetric
    lift = np.abs(body.u.vec.FV().NumPy()).max()
    assert lift < 2 * SUNK
