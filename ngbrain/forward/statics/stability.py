"""Stability of an equilibrium, and the fraction of a body that is compressed far enough to check it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import ngsolve as ngs
import numpy as np
import scipy.sparse.linalg
from ngsolve import CoefficientFunction

from ngbrain.tensors import principal_values, right_cauchy_green

if TYPE_CHECKING:
    from ngbrain.forward.solid.problem import Problem

CREASE = 0.65
"""Stretch at which the free surface of a Neo-Hookean half-space pressed in plane strain creases (strain .354: Hong, Zhao and
Suo 2009, 10.1063/1.3211917): beyond it, solutions depend on the mesh."""
SHARE = 0.05
"""Fraction of a body, or of its free surface, compressed beyond `CREASE` above which it is more than a corner effect."""
NEAREST, FEW = 6, 30
"""Number of eigenvalues nearest to zero among which the smallest is selected; unknowns up to which all are computed."""


def smallest_eigenvalue(body: Problem) -> tuple[float, ngs.GridFunction]:
    """Smallest eigenvalue λ (Pa/m²) of a body's tangent, among those nearest to zero, and its mode.

    Infinite, with a zero mode, for a body without free unknowns.
    """
    solve, (u, v) = body.tangent(), body.u.space.TnT()
    mass = ngs.BilinearForm(body.kinematics.weight() * ngs.InnerProduct(u, v) * ngs.dx).Assemble().mat
    rows, columns, values = mass.COO()
    n, free = body.fes.ndof, np.fromiter(body.fes.FreeDofs(), float, body.fes.ndof)
    M = scipy.sparse.csr_array((np.array(values), (np.array(rows), np.array(columns))), (n, n))
    M = M * free[:, None] * free
    motion, moving = ngs.GridFunction(body.u.space), np.flatnonzero(free * body.is_u)
    if not moving.size:
        return np.inf, motion
    if moving.size <= FEW:  # at most as many as there are
        compliance = np.array([solve(M[:, [i]].toarray().ravel())[moving] for i in moving]).T
        values, motions = np.linalg.eig(compliance)
        values = 1 / values.real
        motion.vec.FV().NumPy()[moving] = motions[:, np.argmin(values)].real
        return float(np.min(values)), motion
    inverse = scipy.sparse.linalg.LinearOperator((n, n), solve)
    start = np.random.default_rng(0).standard_normal(n) * free * body.is_u
    values, motions = scipy.sparse.linalg.eigsh(M, NEAREST, M, sigma=0, OPinv=inverse, v0=start)
    motion.vec.FV().NumPy()[:] = motions[body.is_u, np.argmin(values)]
    return float(np.min(values)), motion


def compressed_fraction(body: Problem) -> float:
    """Volume fraction of a body whose smallest principal stretch is below `CREASE`."""
    F = body.kinematics.gradient(body.u, ngs.Grad(body.u))
    least = principal_values(right_cauchy_green(F))[2]
    return _share(least, body, order=4)


def creased_surface_fraction(body: Problem) -> float:
    """Fraction of a body's free surface, by area, with an in-plane stretch below `CREASE`.

    The stretches of a surface with normal N have s₁² + s₂² = |F(1 - N⊗N)|² and s₁ s₂ = |cof F N|. Compression normal to the
    surface, as in an inflated ball, does not count.
    """
    free = _free(body)
    if not any(free.Mask()):
        return 0.0
    normal = ngs.specialcf.normal(body.mesh.dim)
    N = normal if body.mesh.dim == 3 else ngs.CF((normal[0], normal[1], 0))
    F = body.kinematics.gradient(body.u, ngs.Grad(body.u).Trace())
    along, area = F - F * ngs.OuterProduct(N, N), ngs.Cof(F) * N
    half = ngs.InnerProduct(along, along) / 2
    apart = half**2 - ngs.InnerProduct(area, area)
    return _share(half - ngs.sqrt(ngs.IfPos(apart, apart, 0)), body, definedon=free, order=4)


def _share(squared: CoefficientFunction, body: Problem, **where: Any) -> float:
    """Fraction in which a squared stretch is below `CREASE`."""
    weight = ngs.CF(body.kinematics.weight())
    both = ngs.CF((weight * ngs.IfPos(CREASE**2 - squared, 1, 0), weight))
    beyond, whole = ngs.Integrate(both, body.mesh, **where)
    return float(beyond / whole)


def _free(body: Problem) -> ngs.Region:
    """Free boundaries of the body."""
    mesh = body.mesh
    free = ~np.fromiter(mesh.Boundaries("|".join(body.supports.components) or "$^").Mask(), bool)
    for i in np.flatnonzero(free):
        free[i] = sum(_boundaries(mesh, np.arange(len(free)) == i).Neighbours(ngs.VOL).Mask()) == 1
    return _boundaries(mesh, free)


def _boundaries(mesh: ngs.Mesh, which: np.ndarray) -> ngs.Region:
    return ngs.Region(mesh, ngs.BND, ngs.BitArray(which.tolist()))
