"""Relaxing blocks that a plate presses and then slides along, with friction, as models of what their parameters do to forces."""

import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import Maxwell, NeoHooke, Prony, Viscous

SIDE = 0.02
VALUES = {"mu": 1e3, "g": 0.5, "tau": 3.0, "friction": 0.3, "slip": 5e-5, "penalty": 1e7}


class Sliding:
    """Down, then along, then still."""

    def __init__(self, down=1.5e-3, along=2e-3, times=(1.0, 3.0, 8.0)):
        self.events, self._ways = times, (down, along)
        self.down, self.along = ngs.Parameter(0.0), ngs.Parameter(0.0)

    def at(self, t):
        pressed, slid, _ = self.events
        return np.interp(t, (0, pressed), (0, self._ways[0])), np.interp(t, (pressed, slid), (0, self._ways[1]))

    def set(self, t):
        down, along = self.at(t)
        self.down.Set(down)
        self.along.Set(along)

    def travel(self, start, end):
        return self.at(end)[0] - self.at(start)[0]


def mesh_of(kind, n, wide=1.0):
    if kind == "space":
        return MakeStructured3DMesh(
            hexes=False, nx=n, ny=n, nz=n, mapping=lambda x, y, z: (wide * SIDE * x, SIDE * y, SIDE * z)
        )
    quads = kind == "quadrilaterals"
    return MakeStructured2DMesh(quads=quads, nx=round(wide * n), ny=n, mapping=lambda x, y: (wide * SIDE * x, SIDE * y))


def law_of(kind, p):
    if kind == "Maxwell":
        return Viscous(NeoHooke(p["mu"]), (Maxwell(NeoHooke(600.0), p["tau"] * 500.0),))
    return NeoHooke(p["mu"]) if kind == "elastic" else Prony(NeoHooke(p["mu"]), [p["g"]], [p["tau"]])


def model(
    grid, kind="plane strain", law="Prony", share=0.9, n=3, element="P2/P1", seen=(), times=None, plate=None, wide=1.0,
    bulk=2e4, given=(), **values,
):  # fmt: skip
    """A `RunModel` whose parameters are those of `VALUES`, but for what is given; other values by name."""
    mesh, plate = mesh_of(kind, n, wide), plate or Sliding()
    p = {name: ngs.Parameter(value) for name, value in (VALUES | values).items()}
    last = mesh.dim - 1
    contact = RigidContact("top", lambda x: SIDE - plate.down - x[last], p["penalty"], 2e-5, share, travel=plate.along)
    aside = (1.0, *(0.0,) * last)
    rubbing = Friction(contact, p["friction"], p["slip"], lambda x, way: way * ngs.CF(aside))
    supports = {"bottom": 0} | ({"left": (0, None)} if kind == "axisymmetric" else {})
    body = Problem(
        mesh, {".*": Material(law_of(law, p), bulk)}, supports, contacts=[contact, rubbing],
        element="Q2/Q1" if kind == "quadrilaterals" else element,
        kinematics=Axisymmetric() if kind == "axisymmetric" else None,
    )  # fmt: skip
    middle = [0.5 * wide * SIDE, *(0.9 * SIDE,) * last]
    unused = {"elastic": ("g", "tau"), "Maxwell": ("g",)}.get(law, ())
    used = {name: of for name, of in p.items() if name not in (*unused, *given)}
    return RunModel(body, plate, grid, used, list(seen) or [Force("top"), Displacements([middle])], times)
