"""A blade that lets go. Naive: the wall follows the blade (prescribed displacement), so it is pulled back. Ours: contact."""

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import Branch, NeoHooke, Viscous
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

PRESS_AND_LEAVE = ToolMotion("press", (0.0, 4.0, 40.0, 44.0), (0.0, 2e-3, 2e-3, 0.0))
LAW = Viscous(NeoHooke(300.0), (Branch(NeoHooke(1200.0), 10.0),))


@dataclass(frozen=True)
class Glued(RigidContact):
    """A wall that sticks to the blade: the same penalty for pushing and pulling."""

    def energy(self, u, offset):
        return 0.5 * self.penalty * self.gap(u) ** 2

    def pressure(self, u, offset):
        return -self.penalty * self.gap(u)


def forces(kind):
    drive = Drive(PRESS_AND_LEAVE)
    contact = kind("top", lambda x: 0.02 - drive.parameter - x[2], 1e8, 2e-5)
    body = Problem(
        block((0.02, 0.02, 0.02), 0.02),
        {"tissue": Material(LAW, 1.5e6)},
        {"bottom": 0},
        contacts=[contact],
        element="P2/P1",
    )
    up = ngs.GridFunction(body.fes.components[0])
    up.Set(ngs.CF((0, 0, 1)))
    transient = TimeStepper(body, drive, StepControl(0.5, dt_max=5.0), 1e-3)
    found = []
    transient.run(lambda b, at, record: found.append(up.vec.FV().NumPy() @ b.contact_forces()))
    return np.array(found)


def test_naive_prescribed_displacement_pulls_on_release():
    f = forces(Glued)
    assert f.min() < -0.3 * f.max()


def test_contact_never_pulls():
    f = forces(RigidContact)
    assert f.max() > 0 and f.min() >= -1e-12 * f.max() and abs(f[-1]) == 0.0
