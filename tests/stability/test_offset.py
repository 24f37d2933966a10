"""A punch with rounded edges on a block in plane strain: what a penalty gives way, an offset makes up for.

Naive: a penalty alone, as equilibria of plane bodies had it. Soft, the block goes where the punch should not let it, and the force
is too small; hard, its equations are stiff. Ours: the same soft penalty with the contact's offset, in the plane as in space.
"""

import ngsolve as ngs
import pytest
from ngsolve.meshes import MakeStructured2DMesh

from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import NeoHooke

SIDE, DEPTH, HALF, ROUND = 0.02, 1e-3, 4e-3, 1e-3
SOFT = 5e6
"""Pa/m: a pressure of a modulus goes a fifth of the way deep."""


class Punch:
    """Down by `DEPTH` (m) as the load factor goes to 1."""

    events = (1.0,)

    def __init__(self):
        self.way = ngs.Parameter(0.0)

    def set(self, t):
        self.way.Set(t * DEPTH)

    def travel(self, start, end):
        return DEPTH * (end - start)

    def distance(self, x):
        """To a flat face of half width `HALF` with edges of radius `ROUND`; the punch is above."""
        across = ngs.sqrt((x[0] - SIDE / 2) ** 2 + 1e-14) - (HALF - ROUND)
        up = SIDE + ROUND - self.way - x[1]  # from the point to the centre of the edge's circle
        return ngs.IfPos(across, ngs.sqrt(across**2 + up**2 + 1e-16), up) - ROUND


def pressed(penalty, share):
    """Force (N/m) and how deep (m) the wall is in the punch."""
    punch = Punch()
    contact = RigidContact("top", punch.distance, penalty, 1e-6, share)
    mesh = MakeStructured2DMesh(quads=True, nx=20, ny=8, mapping=lambda x, y: (SIDE * x, SIDE * (1 - (1 - y) ** 1.7)))
    body = Problem(mesh, {".*": Material(NeoHooke(1e3), 1e4)}, {"bottom": 0}, contacts=[contact], element="P2/P1")
    LoadPath(body, punch).solve(steps=4)
    return float(body.force("bottom")[1]), -body.min_gap()


@pytest.fixture(scope="module")
def exact():
    return pressed(100 * SOFT, 0.99)[0]


def test_naive_a_penalty_alone_gives_way(exact):
    force, depth = pressed(SOFT, 0.0)
    print(force / exact, depth)
    assert force < 0.93 * exact and depth > 0.1 * DEPTH


def test_ours_the_offset_makes_up_for_it(exact):
    force, depth = pressed(SOFT, 0.99)
    print(force / exact, depth)
    assert force == pytest.approx(exact, rel=0.02) and depth < 0.05 * DEPTH
