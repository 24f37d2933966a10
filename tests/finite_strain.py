"""An incompressible solid of the package's laws on a curved mesh, and the exact states that it is held against."""

from math import inf, pi

import netgen.occ as occ
import ngsolve as ngs
import numpy as np

from ngbrain.materials import perturbed_lagrangian
from ngbrain.solvers.newton import Newton
from ngbrain.tensors import isochoric, right_cauchy_green

CAVITY = "cavity"


class Solid:
    """Energy W(C̄) + p (J - 1) on P_k displacements and P_{k-1} pressures in 2-D (plane strain) or 3-D.

    A `system` of the package's Newton method. With a boundary named "cavity" a pressure P works on the enclosed volume V:
    `control="pressure"` prescribes P in -P V, `control="volume"` prescribes V in -P (V - volume) with P one more unknown.

    held   what the displacement space holds: dirichlet="…", dirichletx="…", …
    """

    def __init__(self, mesh, law, order, control=None, bonus=2, **held):
        self.mesh, self.order = mesh, order
        spaces = [ngs.VectorH1(mesh, order=order, **held), ngs.H1(mesh, order=order - 1)]
        if control == "volume":
            spaces.append(ngs.NumberSpace(mesh))
        self.fes = ngs.FESpace(spaces)
        self.gfu = ngs.GridFunction(self.fes)
        self.u = self.gfu.components[0]
        u, p, *number = self.fes.TrialFunction()
        F = three(ngs.Id(u.dim) + ngs.Grad(u))
        energy = law.energy(isochoric(right_cauchy_green(F))) + perturbed_lagrangian(ngs.Det(F), p, inf)
        self.form = ngs.BilinearForm(self.fes, symmetric=True)
        self.form += ngs.Variation(energy.Compile() * ngs.dx(bonus_intorder=bonus))
        # A boundary's normal points as its geometry happens to be oriented.
        self.control, self._outward = control, 1.0
        if control:
            self._outward = np.sign(self.volume())
            self.load, around = ngs.Parameter(0), ngs.ds(CAVITY, bonus_intorder=bonus)
            work = self.enclosed(u)
            if control == "volume":
                area = ngs.Integrate(ngs.CF(1) * ngs.ds(CAVITY), mesh)
                work = number[0] * (work - self.load / area)
            else:
                work = self.load * work
            self.form += ngs.Variation(-work.Compile() * around)
        free, n = self.fes.FreeDofs(), self.fes.components[0].ndof
        self.free = np.fromiter(free, bool, self.fes.ndof)
        self.is_u = np.arange(self.fes.ndof) < n
        self.weights = self.free / self.fes.ndof
        shape = ngs.TET if mesh.dim == 3 else ngs.TRIG
        self._points = mesh.MapToAllElements({shape: ngs.IntegrationRule(shape, 2 * order + bonus)}, ngs.VOL)
        self._det = ngs.Det(ngs.Id(mesh.dim) + ngs.Grad(self.u)).Compile()
        self._vec = self.gfu.vec.CreateVector()

    # What Newton's method asks.

    def forces(self, x):
        self.state = x
        self.form.Apply(self.gfu.vec, self._vec)
        return self._vec.FV().NumPy().copy()

    def residual(self, x):
        r = self.forces(x)
        return r * self.free, float(np.linalg.norm(r[self.is_u]))

    def factorise(self, x, r=None):
        self.state = x
        self.form.AssembleLinearization(self.gfu.vec)
        inverse = self.form.mat.Inverse(self.fes.FreeDofs(), inverse="umfpack")
        right, left = self.gfu.vec.CreateVector(), self.gfu.vec.CreateVector()

        def solve(r):
            right.FV().NumPy()[:] = r
            left.data = inverse * right
            return left.FV().NumPy() * self.free

        return solve

    def min_det(self, x):
        self.state = x
        return float(np.min(self._det(self._points)))

    @property
    def state(self):
        return self.gfu.vec.FV().NumPy().copy()

    @state.setter
    def state(self, x):
        self.gfu.vec.FV().NumPy()[:] = x

    # What tests ask.

    def solve(self, newton=None):
        """Equilibrium from where the solid is; the record says whether it was reached."""
        newton = newton or Newton(rtol=1e-9, xtol=1e-9)
        self.state, record = newton.solve(self, self.state)
        return record

    def enclosed(self, u):
        """Density on the undeformed wall of the volume (in 2-D area) between the deformed one and the origin: x·n da / dim."""
        dim = u.dim
        x = ngs.CF((ngs.x, ngs.y, ngs.z)[:dim]) + u
        # The cofactor's normal column holds tangential derivatives only, which is all that a wall knows.
        normal = ngs.Cof(ngs.Id(dim) + ngs.Grad(u).Trace()) * ngs.specialcf.normal(dim)
        return self._outward * ngs.InnerProduct(x, normal) / dim

    def volume(self):
        """Enclosed by the cavity's wall now, as far as the mesh goes (an eighth of a sphere, a quarter of a circle)."""
        return ngs.Integrate(self.enclosed(self.u) * ngs.ds(CAVITY, bonus_intorder=4), self.mesh)

    def pressure(self):
        return self.state[-1] if self.control == "volume" else self.load.Get()


def three(F):
    """Plane strain as a state in space."""
    return F if F.dims[0] == 3 else ngs.CF((F[0, 0], F[0, 1], 0, F[1, 0], F[1, 1], 0, 0, 0, 1), dims=(3, 3))


def refined(shape, maxh, levels, order, dim=3):
    geometry = occ.OCCGeometry(shape, dim=dim)
    mesh = geometry.GenerateMesh(maxh=maxh, parallel_meshing=False)
    for _ in range(levels):
        mesh.Refine()
    mesh = ngs.Mesh(mesh)
    if order > 1:
        mesh.Curve(order)
    return mesh


def cylinder(maxh, levels, order, length=1.0):
    shape = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=1, h=length)
    shape.faces.name = "side"
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "bottom", "top"
    return refined(shape, maxh, levels, order)


def eighth_of_a_shell(maxh, levels, order):
    shape = occ.Sphere(occ.Pnt(0, 0, 0), 2) - occ.Sphere(occ.Pnt(0, 0, 0), 1)
    shape = shape * occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(3, 3, 3))
    shape.faces.name = "outside"
    for axis, name in ((occ.X, "x"), (occ.Y, "y"), (occ.Z, "z")):
        shape.faces.Min(axis).name = name
    near = [f for f in shape.faces if f.center.x**2 + f.center.y**2 + f.center.z**2 < 2 and f.name == "outside"]
    near[0].name = CAVITY
    return refined(shape, maxh, levels, order)


def quarter_of_a_ring(maxh, levels, order):
    shape = occ.WorkPlane().Circle(2).Face() - occ.WorkPlane().Circle(1).Face()
    shape = shape * occ.WorkPlane().Rectangle(3, 3).Face()
    shape.edges.name = "outside"
    for axis, name in ((occ.X, "x"), (occ.Y, "y")):
        shape.edges.Min(axis).name = name
    near = [e for e in shape.edges if e.center.x**2 + e.center.y**2 < 2 and e.name == "outside"]
    near[0].name = CAVITY
    return refined(shape, maxh, levels, order, dim=2)
