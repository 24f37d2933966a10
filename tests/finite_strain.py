"""An incompressible solid of the package's laws on a curved mesh, and the exact states that it is held against."""

from math import inf, pi

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
from scipy.integrate import quad

from ngbrain.materials import perturbed_lagrangian
from ngbrain.solvers.newton import Newton
from ngbrain.tensors import deformation_gradient, isochoric, right_cauchy_green

CAVITY = "cavity"


class Solid:
    """Energy W(C̄) + p (J - 1) on P_k displacements and P_{k-1} pressures in 2-D (plane strain) or 3-D.

    A `system` of the package's Newton method. With a boundary named "cavity" a pressure P works on the enclosed volume V:
    `control="pressure"` prescribes P in -P V, `control="volume"` prescribes V in -P (V - volume) with P one more unknown.

    held   what the displacement space holds: dirichlet="…", dirichletx="…", …
    """

    def __init__(self, mesh, law, order, control=None, bonus=2, **held):
        self.mesh = mesh
        spaces = [ngs.VectorH1(mesh, order=order, **held), ngs.H1(mesh, order=order - 1)]
        if control == "volume":
            spaces.append(ngs.NumberSpace(mesh))
        self.fes = ngs.FESpace(spaces)
        self.gfu = ngs.GridFunction(self.fes)
        self.u, self.p = self.gfu.components[:2]
        u, p, *number = self.fes.TrialFunction()
        F = three(deformation_gradient(u))
        energy = law.energy(isochoric(right_cauchy_green(F))) + perturbed_lagrangian(ngs.Det(F), p, inf)
        self.form = ngs.BilinearForm(self.fes, symmetric=True)
        self.form += ngs.Variation(energy.Compile() * ngs.dx(bonus_intorder=bonus))
        # A boundary's normal points as its geometry happens to be oriented.
        self.control, self._outward = control, 1.0
        if control:
            self._outward = np.sign(self.volume())
            # An eighth of a sphere, a quarter of a circle: what is enclosed at rest.
            self.whole = pi / 6 if mesh.dim == 3 else pi / 4
            self.load = ngs.Parameter(self.whole if control == "volume" else 0)
            work = self.enclosed(u)
            if control == "volume":
                area = ngs.Integrate(ngs.CF(1) * ngs.ds(CAVITY), mesh)
                work = number[0] * (work - self.load / area)
            else:
                work = self.load * work
            self.form += ngs.Variation(-work.Compile() * ngs.ds(CAVITY, bonus_intorder=bonus))
        free, n = self.fes.FreeDofs(), self.fes.components[0].ndof
        self.free = np.fromiter(free, bool, self.fes.ndof)
        self.is_u = np.arange(self.fes.ndof) < n
        self.weights = self.free / self.fes.ndof
        shape = ngs.TET if mesh.dim == 3 else ngs.TRIG
        self._points = mesh.MapToAllElements({shape: ngs.IntegrationRule(shape, 2 * order + bonus)}, ngs.VOL)
        self._det = ngs.Det(deformation_gradient(self.u)).Compile()
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

    def solve(self):
        """Equilibrium from where the solid is; the record says whether it was reached."""
        self.state, record = Newton(rtol=1e-9, xtol=1e-9).solve(self, self.state)
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

    def stretch(self):
        """Of the cavity's wall, by its volume."""
        return float((self.volume() / self.whole) ** (1 / self.mesh.dim))


def three(F):
    """Plane strain as a state in space."""
    return F if F.dims[0] == 3 else ngs.CF((F[0, 0], F[0, 1], 0, F[1, 0], F[1, 1], 0, 0, 0, 1), dims=(3, 3))


def cylinder(level, curved, maxh=1.0, radius=1.0, length=1.0):
    """Around z from z = 0; boundaries "bottom", "top", "side"."""
    shape = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=radius, h=length)
    shape.faces.name = "side"
    shape.faces.Min(occ.Z).name, shape.faces.Max(occ.Z).name = "bottom", "top"
    return refined(shape, level, curved, maxh)


def eighth_of_a_shell(level, curved):
    """Radii 1 and 2; boundaries "x", "y", "z" (planes of symmetry), "cavity", "outside"."""
    shell = occ.Sphere(occ.Pnt(0, 0, 0), 2) - occ.Sphere(occ.Pnt(0, 0, 0), 1)
    shape = shell * occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(3, 3, 3))
    return refined(named(shape, shape.faces, (occ.X, occ.Y, occ.Z)), level, curved)


def quarter_of_a_ring(level, curved):
    """Radii 1 and 2 in the plane; boundaries "x", "y" (lines of symmetry), "cavity", "outside"."""
    ring = occ.WorkPlane().Circle(2).Face() - occ.WorkPlane().Circle(1).Face()
    shape = ring * occ.WorkPlane().Rectangle(3, 3).Face()
    return refined(named(shape, shape.edges, (occ.X, occ.Y)), level, curved, dim=2)


def named(shape, sides, axes):
    sides.name = "outside"
    for axis, name in zip(axes, "xyz", strict=False):
        sides.Min(axis).name = name
    for side in sides:
        if side.name == "outside" and np.linalg.norm([side.center.x, side.center.y, side.center.z]) < 1.2:
            side.name = CAVITY
    return shape


def refined(shape, level, curved, maxh=1.0, dim=3):
    """Each level cuts every element into halves of its edges, new points on the geometry; `curved` 1 is straight."""
    mesh = occ.OCCGeometry(shape, dim=dim).GenerateMesh(maxh=maxh, parallel_meshing=False)
    for _ in range(level):
        mesh.Refine()
    mesh = ngs.Mesh(mesh)
    if curved > 1:
        mesh.Curve(curved)
    return mesh


def twisted(twist):
    """Displacement of Rivlin's torsion: the section at z is turned by twist · z."""
    c, s = ngs.cos(twist * ngs.z), ngs.sin(twist * ngs.z)
    return ngs.CF(((c - 1) * ngs.x - s * ngs.y, s * ngs.x + (c - 1) * ngs.y, 0))


def end_loads(u, forces):
    """Torque and axial force on the boundary "top", by the virtual work of nodal `forces` (N) of u's space."""
    motion = ngs.GridFunction(u.space)

    def work(velocity):
        motion.Set(velocity, definedon=u.space.mesh.Boundaries("top"))
        return float(motion.vec.FV().NumPy() @ forces)

    return work(ngs.CF((-ngs.y - u[1], ngs.x + u[0], 0))), work(ngs.CF((0, 0, 1)))


def torsion(c1, c2, twist, radius=1.0):
    """Torque and axial force of the incompressible cylinder, W = c1 (I₁ - 3) + c2 (I₂ - 3)."""
    return pi * twist * radius**4 * (c1 + c2), -pi * twist**2 * radius**4 * (c1 + 2 * c2) / 2


def torsion_pressure(c1, c2, twist):
    """Mean Cauchy stress in the cylinder of radius 1: σ_rr = -c1 ψ² (1 - r²) and (σ_θθ - σ_rr + σ_zz - σ_rr)/3."""
    r2 = ngs.x**2 + ngs.y**2
    return twist**2 * (c1 * (r2 - 1) + 2 / 3 * (c1 - c2) * r2)


def distance(a, b, mesh):
    """|a - b| / |b| in L2."""

    def norm(c):
        return ngs.sqrt(ngs.Integrate(ngs.InnerProduct(c, c), mesh, order=12))

    return norm(a - b) / norm(b)


def sphere_pressure(c1, c2, stretch):
    """Inner pressure that opens a sphere of radii 1 and 2 to `stretch`: ∫ W'(λ) / (λ³ - 1) dλ with W(λ, λ, λ⁻²)."""

    def density(s):
        return (4 * c1 * (s - s**-5) + 4 * c2 * (s**3 - s**-3)) / (s**3 - 1)

    return quad(density, (1 + (stretch**3 - 1) / 8) ** (1 / 3), stretch, epsabs=1e-13)[0]


def ring_pressure(mu, stretch):
    """The same of a long cylinder of radii 1 and 2 in plane strain, Neo-Hooke."""
    outer = np.sqrt((stretch**2 + 3) / 4)
    return mu * (np.log(stretch / outer) + (outer**-2 - stretch**-2) / 2)


def opened(solid, stretches):
    """Pressures of a solid under volume control whose cavity is opened to one stretch after the other."""
    pressures = []
    for stretch in stretches:
        reach(solid, solid.whole * stretch**solid.mesh.dim)
        pressures.append(float(solid.state[-1]))
    return np.array(pressures)


def reach(solid, load):
    """Equilibrium under a load by as many steps as it takes, each half of one that failed."""
    at, step = solid.load.Get(), load - solid.load.Get()
    while at != load:
        target, state = (load if abs(load - at) <= abs(step) else at + step), solid.state
        solid.load.Set(target)
        record = solid.solve()
        if record.converged:
            at = target
        else:
            solid.state, step = state, step / 2
            assert abs(step) > 1e-2 * abs(load), (load, at, record.reason)


def orders(errors):
    """Observed between one level and the next."""
    errors = np.abs(errors)
    return np.log2(errors[:-1] / errors[1:])
