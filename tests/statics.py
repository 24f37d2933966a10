"""Bodies of the benchmarks of statics, and how tightly they are solved."""

from math import tanh

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke
from ngbrain.solvers.newton import Newton

SIDE = 0.1
CUBE = {".*": Material(NeoHooke(1e3), 1e5)}


def tight():
    """To the last digits."""
    return Newton(rtol=1e-10, xtol=1e-9)


def square(n, quads=False, size=1.0):
    """Boundaries "left", "right", "bottom", "top"."""
    return MakeStructured2DMesh(quads=quads, nx=n, ny=n, mapping=lambda x, y: (size * x, size * y))


def cube(n, hexes=False, steepness=0.0, size=SIDE):
    """Boundaries "back" and "front" (x), "left" and "right" (y), "bottom" and "top"; graded towards all of them by tanh."""

    def at(s):
        return size * (s if not steepness else 0.5 + 0.5 * tanh(steepness * (2 * s - 1)) / tanh(steepness))

    return MakeStructured3DMesh(hexes=hexes, nx=n, ny=n, nz=n, mapping=lambda x, y, z: (at(x), at(y), at(z)))


def bonded(mesh, form="P2/P1", press=0.2):
    """A cube between plates that do not slide, sides free."""
    return Problem(mesh, CUBE, {"bottom": 0, "top": (0, 0, -press * SIDE)}, element=form)


CORNERS = np.array([(0, 0), (48, 44), (48, 60), (0, 44)], float)


def cook(maxh, refinements=0):
    """Cook's membrane (mm), elements at its corners halved again and again; boundaries "left", "right", "free"."""
    plane = occ.WorkPlane().MoveTo(*CORNERS[0])
    for corner in CORNERS[1:]:
        plane.LineTo(*corner)
    face = plane.Close().Face()
    for edge in face.edges:
        edge.name = {0.0: "left", 48.0: "right"}.get(round(edge.center.x, 6), "free")
    mesh = ngs.Mesh(occ.OCCGeometry(face, dim=2).GenerateMesh(maxh=maxh))
    for _ in range(refinements):
        for element in mesh.Elements():
            points = np.array([mesh[vertex].point for vertex in element.vertices])
            apart = np.linalg.norm(points[:, None] - CORNERS, axis=2)
            mesh.SetRefinementFlag(element, bool(apart.min() < 1e-6))
        mesh.Refine()
    return mesh
