"""A plate that presses a block and then drags it sideways against a spring, with friction."""

import ngsolve as ngs
import numpy as np

from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact, SlidingSupport
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block
from ngbrain.solvers.newton import Newton

SIDE, MU, BULK = 0.02, 1e5, 1e6
AREA = SIDE**2
SPRING = 2e4
"""Stiffness (Pa/m) of what holds the block from behind: soft beside the block, so that this moves as one."""
SLIP = 2e-6


class Drag:
    """A plate on the top of a block: how far (m) it has gone down and along x at times (s), straight in between."""

    def __init__(self, times, down, along):
        self.times, self.down, self.along = times, down, along
        self.events = tuple(times[1:])
        self.depth, self.way = ngs.Parameter(0.0), ngs.Parameter(0.0)

    def set(self, t):
        self.depth.Set(np.interp(t, self.times, self.down))
        self.way.Set(np.interp(t, self.times, self.along))

    def travel(self, start, end):
        return float(np.interp(end, self.times, self.down) - np.interp(start, self.times, self.down))

    def contact(self, penalty=1e10, share=0.0):
        return RigidContact("top", lambda x: SIDE - self.depth - x[2], penalty, 1e-8, share, self.way)

    def friction(self, contact, coefficient, slip=SLIP):
        return Friction(contact, coefficient, slip, lambda x, way: way * ngs.CF((1.0, 0.0, 0.0)))


def on_a_rail(drag, coefficient, share=0.0, maxh=SIDE):
    """A block that slides freely on its bottom and along its front, held by a spring on its left; the plate rubs on its top."""
    mesh, contact = block((SIDE,) * 3, maxh), drag.contact(share=share)
    rail = [SlidingSupport.on(mesh, wall, 1e7 * MU) for wall in ("bottom", "front")]
    spring, friction = SlidingSupport.on(mesh, "left", SPRING), drag.friction(contact, coefficient)
    return Problem(
        mesh, {"tissue": Material(NeoHooke(MU), BULK)}, {}, contacts=[contact, friction, *rail, spring], element="P2/P1"
    )


def even(dt):
    """Even steps (s)."""
    return StepControl(dt, first=1.0, restart=1.0, touch_growth=1.0, dt_max=dt)


def transient(body, drag, dt, **newton):
    """A run in even steps."""
    return TimeStepper(body, drag, even(dt), 1e-3, Newton(**{"rtol": 1e-7, **newton}))


def forces(body):
    """What the plate does to the top (N): along x by friction, and down by the contact."""
    contact = body.contacts[0]
    down = ngs.Integrate(contact.pressure(body.u, body.offset) * contact.measure(), body.mesh)
    return body.friction_driving_force(), down
