"""The order of elimination from the elements: few new entries, the same solution, shared unknowns last."""

import ngsolve as ngs
import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from ngbrain.errors import SolverError
from ngbrain.mesh.geometry.structured import rectangles
from ngbrain.solvers.device import CPU
from ngbrain.solvers.matrices import to_scipy
from ngbrain.solvers.nested_dissection import nested_dissection


@pytest.fixture(scope="module")
def waves():
    """Matrix, incidence and centres of an indefinite problem on 24 x 16 elements of third order, and one unknown of all."""
    mesh = rectangles(np.linspace(0, 1.5, 25), np.linspace(0, 1, 17))
    space = ngs.H1(mesh, order=3) * ngs.NumberSpace(mesh)
    (u, a), (v, b) = space.TnT()
    form = ngs.BilinearForm(space)
    form += (ngs.grad(u) * ngs.grad(v) - 200 * u * v + a * v + u * b + a * b) * ngs.dx
    form.Assemble()
    rows = [(dof, element.nr) for element in space.Elements() for dof in element.dofs]
    incidence = sp.coo_array((np.ones(len(rows)), np.array(rows).T), shape=(space.ndof, mesh.ne)).tocsr()
    centres = np.array([np.mean([mesh[v].point for v in element.vertices], axis=0) for element in mesh.Elements()])
    return to_scipy(form.mat), incidence, centres


def entries(matrix, order):
    options = {"SymmetricMode": True, "Equil": False}
    return splu(sp.csc_array(matrix[order][:, order]), permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options).nnz


def test_it_is_a_permutation_in_which_unknowns_of_all_elements_come_last(waves):
    matrix, incidence, centres = waves
    order = nested_dissection(incidence, centres)
    assert np.array_equal(np.sort(order), np.arange(matrix.shape[0]))
    everywhere = np.flatnonzero(incidence.sum(axis=1) == len(centres))
    assert len(everywhere) == 1 and everywhere[0] in order[-52:]  # with the 16 * 3 + 1 unknowns of the first cut


def test_it_fills_less_than_orders_of_the_matrix_alone(waves):
    matrix, incidence, centres = waves[0][:-1][:, :-1], waves[1][:-1], waves[2]  # without the unknown of all elements
    ours = entries(matrix, nested_dissection(incidence, centres))
    banded = entries(matrix, reverse_cuthill_mckee(sp.csr_matrix(matrix), symmetric_mode=True))
    natural = entries(matrix, np.arange(matrix.shape[0]))
    print(f"{ours:,}, banded {banded:,}, as numbered {natural:,}")
    assert ours < 0.5 * banded and ours < 0.5 * natural


@pytest.mark.parametrize("pivot", [0.0, 1e-3])
def test_the_solution_is_that_of_any_order(waves, pivot, rng):
    matrix, incidence, centres = waves
    b = rng.normal(size=matrix.shape[0])
    x = CPU.factor_in_order(matrix, nested_dissection(incidence, centres), pivot).solve(b)
    expected = splu(sp.csc_array(matrix)).solve(b)
    assert np.linalg.norm(x - expected) < 1e-8 * np.linalg.norm(expected)


def test_scattered_centres_are_halved_too(rng):
    centres = rng.uniform(size=(40, 2))
    incidence = sp.csr_array(rng.uniform(size=(90, 40)) < 0.05)
    assert np.array_equal(np.sort(nested_dissection(incidence, centres)), np.arange(90))


def test_elements_in_one_place_end_too():
    order = nested_dissection(sp.csr_array(np.eye(5)), np.zeros((5, 2)))
    assert np.array_equal(np.sort(order), np.arange(5))


def test_a_singular_matrix_is_named():
    with pytest.raises(SolverError, match="the saddle cannot be factorised"):
        CPU.factor_in_order(sp.csr_array([[1.0, 1.0], [1.0, 1.0]]), np.arange(2), what="the saddle")
