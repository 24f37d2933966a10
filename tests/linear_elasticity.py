"""Linear elasticity as a form of every kind, for the linear solvers: μ = 1 kPa, K a multiple of it."""

import ngsolve as ngs
import numpy as np

MU = 1000.0


def elastic(kind, mesh, ratio, order=2, condense=False, fixed="bottom|top"):
    """A form, not yet assembled; `kind` as in `linear.choose`."""
    V = ngs.VectorH1(mesh, order=order, dirichlet=fixed)
    if kind == "displacement":
        space = V
        u, v = space.TnT()
    else:
        Q = ngs.H1(mesh, order=order - 1) if kind == "continuous pressure" else ngs.L2(mesh, order=order - 2)
        space = V * Q
        (u, p), (v, q) = space.TnT()
    e, f = ngs.Sym(ngs.Grad(u)), ngs.Sym(ngs.Grad(v))
    form = ngs.BilinearForm(space, symmetric=True, condense=condense)
    form += 2 * MU * (ngs.InnerProduct(e, f) - ngs.Trace(e) * ngs.Trace(f) / 3) * ngs.dx
    K = ratio * MU
    if kind == "displacement":
        form += K * ngs.Trace(e) * ngs.Trace(f) * ngs.dx
    else:
        form += (p * ngs.Trace(f) + q * ngs.Trace(e) - p * q / K) * ngs.dx
    return form


def gravity(form):
    """A weight that turns with height, as a right-hand side."""
    space = form.space
    field = space if space.type == "VectorH1" else space.components[0]
    load = ngs.LinearForm(field)
    weight = ngs.CF((1, ngs.x / 0.02, 1 + ngs.y / 0.02)[: space.mesh.dim])
    load += ngs.InnerProduct(weight, field.TestFunction()) * ngs.dx
    load.Assemble()
    r = np.zeros(space.ndof)
    r[: field.ndof] = load.vec.FV().NumPy()
    return r
