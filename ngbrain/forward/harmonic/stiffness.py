"""Elementwise stiffness of a body, and the elastic energy that regularises displacements."""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.forward.common.kinematics import AntiPlane, PlaneStrain
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.materials.linear import SmallStrainLaw
from ngbrain.solvers.matrices import to_ngsolve, to_scipy

Array = np.ndarray
NEARLY = 100.0
"""Largest K/g: beyond it elements of low order are too stiff."""


def shear_stiffness(body: HarmonicProblem, omega: float) -> ngs.CoefficientFunction:
    """Shear modulus g (Pa, complex): twice the energy of a unit shear, averaged over the coordinate planes.

    Parameters
    ----------
    body : HarmonicProblem
    omega : float
        Angular frequency (rad/s).

    Returns
    -------
    CoefficientFunction
    """
    law = law_of(body, omega)
    n = 2 if body.mesh.dim == 2 and isinstance(body.kinematics, PlaneStrain) else 3
    planes = [(i, j) for i in range(n) for j in range(i)]
    total = ngs.CF(0.0)
    if isinstance(body.kinematics, AntiPlane):
        planes = [(2, 0), (2, 1)]
    for i, j in planes:
        total = total + 2 / len(planes) * law.energy(unit(n, (i, j), 0.5) + unit(n, (j, i), 0.5))
    return total


def law_of(body: HarmonicProblem, omega: float) -> SmallStrainLaw:
    """Material law at an angular frequency.

    Parameters
    ----------
    body : HarmonicProblem
    omega : float
        rad/s.

    Returns
    -------
    SmallStrainLaw
    """
    return body.law if isinstance(body.law, SmallStrainLaw) else body.law(omega)


def unit(n: int, entry: tuple[int, int], value: float) -> ngs.CoefficientFunction:
    """Matrix (n, n) with one nonzero entry.

    Parameters
    ----------
    n : int
    entry : tuple of int
        Row and column.
    value : float

    Returns
    -------
    CoefficientFunction
    """
    values = np.zeros((n, n))
    values[entry] = value
    return ngs.CF(tuple(values.ravel()), dims=(n, n))


def element_means(body: HarmonicProblem, integrand: ngs.CoefficientFunction) -> ngs.GridFunction:
    """Modulus of an integrand's mean over each element: an approximation for preconditioners.

    Parameters
    ----------
    body : HarmonicProblem
    integrand : CoefficientFunction

    Returns
    -------
    GridFunction
    """
    space = ngs.L2(body.mesh, order=0, complex=True)
    sums, sizes = (ngs.LinearForm(space) for _ in range(2))
    sums += (integrand + 0j * ngs.x).Compile() * space.TestFunction() * ngs.dx(intrules=body.rules)
    sizes += (1 + 0j) * space.TestFunction() * ngs.dx(intrules=body.rules)
    sums.Assemble()
    sizes.Assemble()
    mean = ngs.GridFunction(ngs.L2(body.mesh, order=0))
    mean.vec.FV().NumPy()[:] = np.abs(sums.vec.FV().NumPy() / sizes.vec.FV().NumPy())
    return mean


def elastic(body: HarmonicProblem, load: int, order: int) -> sp.csr_array:
    """Scaled elastic stiffness matrix, of 1/(ρω² V) ∫ K (tr ε)² + 2 g ε:ε dx with V the volume of the body.

    At 0 Hz the frequency of the slowest shear mode is used.

    Parameters
    ----------
    body : HarmonicProblem
    load : int
        Index of the wave.
    order : int
        Order of the displacements.

    Returns
    -------
    csr_array
    """
    omega, mesh = body.waves[load].omega, body.mesh
    shear = element_means(body, shear_stiffness(body, omega))
    bulk = NEARLY * shear if body.bulk is None else element_means(body, ngs.CF(body.bulk))
    bulk = ngs.IfPos(bulk - NEARLY * shear, NEARLY * shear, bulk)
    slowest = np.pi**2 * ngs.Integrate(shear, mesh) / ngs.Integrate(1.0, mesh) ** (2 / mesh.dim)
    inertia = max(omega**2 * ngs.Integrate(ngs.CF(body.density), mesh), slowest)
    space = ngs.H1(mesh, order=order) if body.axes == "z" else ngs.VectorH1(mesh, order=order)
    trial, test = space.TnT()
    strain = body.strain(trial, ngs.Grad(trial)).MakeVariable()
    energy = bulk / 2 * ngs.Trace(strain) ** 2 + shear * ngs.InnerProduct(strain, strain)
    form = ngs.BilinearForm(space)
    form += body.kinematics.weight() * energy.Diff(strain, body.strain(test, ngs.Grad(test))) * ngs.dx
    form.Assemble()
    return to_scipy(form.mat) / inertia


def definite(matrix: sp.coo_array) -> Callable[[Array], Array]:
    """Solver for a symmetric, positive definite matrix."""
    made = to_ngsolve(matrix)
    inverse, given, found = made.Inverse(inverse="sparsecholesky"), made.CreateColVector(), made.CreateColVector()

    def solve(r: Array) -> Array:
        given.FV().NumPy()[:] = r
        found.data = inverse * given
        return found.FV().NumPy().copy()

    return solve
