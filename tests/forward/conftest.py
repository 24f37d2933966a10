"""A small block of tissue, and a plate to press it with."""

import ngsolve as ngs
import pytest

from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import Branch, NeoHooke, Ogden, Viscous
from ngbrain.mesh import block

RELAXING = Viscous(Ogden(300.0, -12.0), (Branch(Ogden(700.0, -15.0), 3.0), Branch(NeoHooke(500.0), 200.0)))


class Plate:
    """A rigid plate that presses on the top: at height `height - advance(t)`."""

    def __init__(self, times, advance, height=0.02):
        import numpy as np

        self.times, self.advance, self.height = np.array(times, float), np.array(advance, float), height
        self.events = tuple(float(t) for t in times[1:])
        self.level = ngs.Parameter(height)

    def at(self, t):
        import numpy as np

        return float(np.interp(t, self.times, self.advance))

    def set(self, t):
        self.level.Set(self.height - self.at(t))

    def travel(self, start, end):
        return self.at(end) - self.at(start)

    def contact(self, penalty=1e8):
        return RigidContact("top", lambda x: self.level - x[2], penalty, 2e-5)


@pytest.fixture
def plate():
    return Plate


@pytest.fixture
def make_body():
    def make(law=RELAXING, contacts=(), bulk=1.5e6, maxh=0.02, order=2, size=(0.02, 0.02, 0.02), **helpers):
        mesh = block(size, maxh)
        return Problem(
            mesh,
            {"tissue": Material(law, bulk, **helpers)},
            {"bottom": 0},
            contacts=contacts,
            element=f"P{order}/P{order - 1}",
        )

    return make
