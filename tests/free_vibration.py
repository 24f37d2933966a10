"""A bar and a block that swing by themselves: nothing drives them."""

import netgen.occ as occ
import ngsolve as ngs
import numpy as np

from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper

LENGTH, RADIUS = 0.02, 0.005


class Undriven:
    """A motion of nothing, up to a time (s)."""

    def __init__(self, end):
        self.events = (end,)

    def set(self, t):
        pass

    def travel(self, start, end):
        return 0.0


def bar():
    """A round bar on `bottom`, of `LENGTH` and `RADIUS` (m)."""
    shape = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, RADIUS, LENGTH)
    shape.mat("tissue")
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "bottom", "top"
    return ngs.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=0.006)).Curve(2)


def twist(rate):
    """The velocity of the slowest torsion of a `bar`, `rate` (rad/s) at its end."""
    return rate * ngs.sin(np.pi * ngs.z / 2 / LENGTH) * ngs.CF((-ngs.y, ngs.x, 0))


def turned(body):
    """How far (rad) a bar's end is turned: the mean of x u_y - y u_x over that of r²."""
    end = {"mesh": body.mesh, "definedon": body.mesh.Boundaries("top")}
    return ngs.Integrate(ngs.x * body.u[1] - ngs.y * body.u[0], **end) / ngs.Integrate(ngs.x**2 + ngs.y**2, **end)


def stored(body):
    """Energy (J) of the tissue."""
    weight = body.inertia._weight.Get()
    body.inertia._weight.Set(0.0)
    energy = body.form.Energy(body.gfu.vec)
    body.inertia._weight.Set(weight)
    return energy


def even(dt):
    """Steps (s) all of one length, that give up when cut by 10."""
    return StepControl(dt, growth=1.0, dt_max=dt, smallest=0.1)


def swing(body, end, control, look):
    """The run, and time and what `look(body)` tells (a sequence) after each step."""
    transient = TimeStepper(body, Undriven(end), control, 1.0)
    rows = []
    transient.run(lambda b, at, record: rows.append((at.t, *look(b))))
    return transient, np.array(rows)
