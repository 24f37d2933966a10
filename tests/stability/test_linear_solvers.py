"""Stiff volume and high order, where linear solvers fail.

Volume. Naive: a displacement form by conjugate gradients, which at K/μ = 10⁴ is not done in 500 iterations with the
diagonal or with BDDC. Ours: a pressure beside the displacements and MINRES with blocks, as many iterations at 10⁸ as at 10².

Order. Naive: monomials in x, y, z, whose mass matrix has no digit left at order 8 on flat tetrahedra. Ours: a hierarchical
basis with static condensation, residuals below 1e-8 and errors that fall to the eighth order.
"""

import itertools

import ngsolve as ngs
import numpy as np
import pytest
import scipy.sparse as sp
from linear_elasticity import MU, elastic, gravity
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

from ngbrain.mesh import block
from ngbrain.solvers import krylov
from ngbrain.solvers.condensed import Condensed
from ngbrain.solvers.linear import prepare

SIDE = 0.02


@pytest.fixture(scope="module")
def square():
    return MakeStructured2DMesh(quads=False, nx=24, ny=24, mapping=lambda x, y: (SIDE * x, SIDE * y))


def iterations(name, kind, mesh, ratio, order, fixed):
    form = elastic(kind, mesh, ratio, order, fixed=fixed)
    make = prepare(name, form, MU)
    form.Assemble()
    solve = make()
    solve(gravity(form))
    return solve.iterations


@pytest.mark.parametrize("ratio", [1e4, 1e6])
def test_naive_displacements_alone_do_not_converge(ratio, square):
    form = elastic("displacement", square, ratio, fixed="left|right")
    form.Assemble()
    condensed = Condensed(form)
    diagonal = sp.csr_array(form.mat.CSR(), shape=form.mat.shape).diagonal()
    diagonal[diagonal == 0] = 1
    with pytest.raises(FloatingPointError, match="no convergence in 500 iterations"):
        krylov.cg(condensed.apply, lambda r: r / diagonal, gravity(form) * condensed.free, 1e-8, 500)
    with pytest.raises(FloatingPointError, match="cg-bddc: no convergence in 500 iterations"):
        iterations("cg-bddc", "displacement", square, ratio, 3, "left|right")


@pytest.mark.parametrize("name", ["minres-amg", "minres-bddc"])
def test_ours_does_not_see_the_bulk_modulus(name, square):
    for mesh, fixed in ((square, "left|right"), (block((SIDE,) * 3, 0.004), "bottom|top")):
        found = [iterations(name, "continuous pressure", mesh, ratio, 2, fixed) for ratio in (1e2, 1e4, 1e6, 1e8)]
        print(name, f"{mesh.dim}-D", found)
        assert max(found) <= 1.2 * found[0] <= 1.2 * 140


def flat(aspect):
    """12 sheared tetrahedra, flat by a factor."""
    return MakeStructured3DMesh(hexes=False, nx=2, ny=1, nz=1, mapping=lambda x, y, z: (x + 0.3 * y, y, z / aspect))


def solved(mesh, order, aspect):
    """Relative error of the displacement gradient and of the residual, for a smooth solution."""
    x, y, z = ngs.x, ngs.y, aspect * ngs.z
    exact = ngs.CF((ngs.sin(2 * x + z), ngs.cos(y - 2 * z), ngs.exp(x) * ngs.sin(y + z)))
    form = elastic("displacement", mesh, 10, order, condense=True, fixed=".*")
    whole = elastic("displacement", mesh, 10, order, fixed=".*")
    truth, u = ngs.GridFunction(form.space), ngs.GridFunction(form.space)
    gradient = ngs.CF(tuple(exact[i].Diff(s) for i in range(3) for s in (ngs.x, ngs.y, ngs.z)), dims=(3, 3))
    strain = ngs.Sym(gradient)
    stress = 2 * MU * (strain - ngs.Trace(strain) / 3 * ngs.Id(3)) + 10 * MU * ngs.Trace(strain) * ngs.Id(3)
    load = ngs.LinearForm(form.space)
    load += ngs.InnerProduct(stress, ngs.Grad(form.space.TestFunction())) * ngs.dx(bonus_intorder=6)
    load.Assemble()
    truth.Set(exact, ngs.BND, dual=True)
    make = prepare("sparsecholesky", form)
    form.Assemble()
    whole.Assemble()
    lifted = load.vec.CreateVector()
    lifted.data = load.vec - whole.mat * truth.vec
    u.vec.FV().NumPy()[:] = make()(lifted.FV().NumPy())
    left = load.vec.CreateVector()
    left.data = lifted - whole.mat * u.vec
    free = np.fromiter(form.space.FreeDofs(), bool, form.space.ndof)
    residual = np.linalg.norm(left.FV().NumPy()[free]) / max(np.linalg.norm(lifted.FV().NumPy()[free]), 1e-300)
    u.vec.data += truth.vec
    wrong = ngs.Integrate(ngs.InnerProduct(ngs.Grad(u) - gradient, ngs.Grad(u) - gradient), mesh, order=2 * order + 4)
    return np.sqrt(wrong / ngs.Integrate(ngs.InnerProduct(gradient, gradient), mesh, order=2 * order + 4)), residual


def projected(order, aspect):
    """Relative error of a polynomial of that order, projected on monomials on a flat tetrahedron; and the condition number."""
    rule = ngs.IntegrationRule(ngs.TET, 2 * order)
    x, y, z = np.array(rule.points).T / np.array([[1], [1], [aspect]])
    powers = [p for p in itertools.product(range(order + 1), repeat=3) if sum(p) <= order]
    basis = np.array([x**i * y**j * z**k for i, j, k in powers])
    mass = basis * np.array(rule.weights) @ basis.T
    values = np.cos(order * np.arccos(np.clip(2 * (x + y + aspect * z) - 1, -1, 1)))  # Chebyshev's
    found = np.linalg.solve(mass, basis * np.array(rule.weights) @ values) @ basis
    return np.linalg.norm(found - values) / np.linalg.norm(values), np.linalg.cond(mass)


@pytest.mark.parametrize("aspect", [10, 100])
def test_naive_monomials_lose_every_digit(aspect):
    found = [projected(order, aspect) for order in (2, 4, 6, 8)]
    print("monomials", aspect, [f"{error:.0e} ({condition:.0e})" for error, condition in found])
    errors, conditions = np.transpose(found)
    assert errors[0] < 1e-12 and errors[-1] > 1e-5 and conditions[-1] > 1e20


@pytest.mark.parametrize("aspect", [pytest.param(10, marks=pytest.mark.slow), 100])
def test_ours_gains_with_every_order(aspect):
    found = [solved(flat(aspect), order, aspect) for order in range(1, 9)]
    print("hierarchical", aspect, [f"{error:.0e} ({residual:.0e})" for error, residual in found])
    errors, residuals = np.transpose(found)
    assert max(residuals) < 1e-8
    assert np.all(errors[1:] < 0.6 * errors[:-1]) and errors[-1] < 1e-6
