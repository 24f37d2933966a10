"""Inversion by conjugate gradients on a block with a stiff ball: data of another order and mesh, 2 % noise."""

from functools import cache

import ngsolve as ngs
import numpy as np
import pytest
import scipy.sparse as sp
from ball_in_block import MIDDLE, RADIUS, SOFT, STIFF, body, cube, label_at, measured

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY, WaveModel
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.optimise.gauss_newton_cg import GaussNewtonCG
from ngbrain.inverse.optimise.normal_equations import NormalEquations, sample_prior_field
from ngbrain.inverse.optimise.preconditioners import (
    BoundaryExtensionPreconditioner,
    block_preconditioner,
    diagonal_block_inverses,
    factorise_quasidefinite,
)
from ngbrain.inverse.optimise.regularisation_weight import FixedWeights
from ngbrain.inverse.problem.label_shares import combine_labels, label_shares
from ngbrain.materials import Shearing, TransverselyIsotropic


@cache
def mesh_of_inversion():
    return cube(0.0141)


def problem(names=("tissue",), weight=1e3, boundary=False, law=None):
    """A `Reduced` with a field for each label, and its `ParameterFields`."""
    mesh, (x, u, deviation) = mesh_of_inversion(), measured()
    at = label_shares(mesh, 3, label_at if len(names) > 1 else lambda x: np.zeros(len(x), int), names)
    space = ngs.H1(mesh, order=1)
    fields = {f"{part} {name}": ngs.GridFunction(space) for name in names for part in ("storage", "loss")}
    starts = {name: 5000.0 if name.startswith("storage") else 2000.0 for name in fields}
    for name, field in fields.items():
        field.Set(starts[name])
    storage, loss = (
        combine_labels(at, {name: fields[f"{part} {name}"] for name in names}) for part in ("storage", "loss")
    )
    model = WaveModel(body(mesh, (law or Shearing)(storage + 1j * loss)), fields, x)
    unknowns = {name: Unknown(start) for name, start in starts.items()}
    if boundary:
        unknowns[BOUNDARY] = Unknown(model.theta[model.blocks[BOUNDARY]], ScaledTransform(float(deviation.mean())))
    search = ParameterFields(model.theta, model.blocks, unknowns)
    regular = {name: smooth(space, search.start[search.blocks[name]]) for name in fields}
    return Reduced(model, LeastSquares(u, deviation), search, regular, dict.fromkeys(fields, weight)), search


def lowered(point, precondition, max_cg_iterations):
    """½ x·Hx - b·x after a number of iterations, with b the descent direction."""
    normal = NormalEquations(point, forcing=0.0, max_cg_iterations=max_cg_iterations)
    b = -normal.gradient()
    normal.precondition = precondition
    x = normal.solve(b)
    return 0.5 * x @ normal.product(x) - b @ x


def test_inclusion_is_found_with_noise():
    reduced, search = problem(weight=1e3)
    found = GaussNewtonCG(reduced, FixedWeights()).descend(search.start, 5)
    x = measured()[0]
    modulus = evaluation(ngs.H1(mesh_of_inversion(), order=1), x) @ search.values(found.x)["storage tissue"]
    away = np.linalg.norm(x - MIDDLE, axis=1)
    soft, stiff = np.median(modulus[away > RADIUS + 4e-3]), np.median(modulus[away < RADIUS - 4e-3])
    assert soft == pytest.approx(SOFT.real, rel=0.06)  # the search began at 5000; elements are coarse
    assert stiff > 1.25 * soft  # a field of 14 mm elements cannot rise by 2 within the ball's 24 mm


def test_labels_keep_a_jump():
    reduced, search = problem(("soft", "stiff"), weight=1e5)
    found = GaussNewtonCG(reduced, FixedWeights()).descend(search.start, 5)
    values = search.values(found.x)
    assert np.median(values["storage soft"]) == pytest.approx(SOFT.real, rel=0.1)
    assert np.median(values["storage stiff"]) == pytest.approx(STIFF.real, rel=0.1)


@pytest.mark.parametrize("boundary", [False, True])
def test_preconditioner_is_symmetric_positive_definite(boundary, rng):
    reduced, search = problem(weight=1e-2, boundary=boundary)
    apply = block_preconditioner(
        diagonal_block_inverses(reduced.evaluate(search.start), BoundaryExtensionPreconditioner()), reduced
    )
    for _ in range(4):
        a, b = rng.normal(size=(2, len(search.start)))
        assert a @ apply(b) == pytest.approx(
            b @ apply(a), rel=1e-8, abs=1e-8 * np.sqrt((a @ apply(a)) * (b @ apply(b)))
        )
        assert a @ apply(a) > 0


def regulariser_preconditioners(point):
    """Inverse of each regulariser alone, without the data."""
    reduced = point.reduced
    matrices = {
        name: reduced.weights[name] * reduced.regularisers[name].matrix(point.x[block])
        for name, block in reduced.unknowns.blocks.items()
    }
    return {name: factorise_quasidefinite(sp.csc_array(matrix)).solve for name, matrix in matrices.items()}


def test_preconditioner_beats_the_regulariser():
    reduced, search = problem(weight=1e-2)
    point = reduced.evaluate(search.start)
    ours, alone = (
        block_preconditioner(diagonal_block_inverses(point, BoundaryExtensionPreconditioner()), reduced),
        block_preconditioner(regulariser_preconditioners(point), reduced),
    )
    enough = 0.998 * lowered(point, ours, 150)  # negative
    assert lowered(point, ours, 18) < enough < lowered(point, alone, 36)  # half as many iterations


def test_directions_are_remembered():
    """A second solve at the same point with another right-hand side takes fewer iterations."""
    reduced, search = problem(weight=1e-2)
    normal = NormalEquations(reduced.evaluate(search.start), forcing=0.03)
    b = -normal.gradient()
    normal.solve(b)
    normal.solve(1.1 * b)
    assert normal.iterations[1] <= normal.iterations[0] / 4


@pytest.mark.parametrize("held", [0.5, 0.0])
def test_likely_fields_are_as_the_regulariser_says(held, rng):
    """Differences between neighbours with one value fixed or none; without one the mean is free and does not count."""
    n = 8
    differences = sp.csr_array(np.eye(n - 1, n) - np.eye(n - 1, n, 1))
    matrix = sp.csr_array(differences.T @ differences + held * sp.diags_array(np.eye(n)[0]))
    drawn, fields = np.array([sample_prior_field(matrix, rng) for _ in range(4000)]).transpose(1, 0, 2)
    apart = fields @ differences.T.toarray()
    assert np.allclose(np.cov(apart.T), np.eye(n - 1), atol=0.1)
    assert np.mean(np.einsum("ij,ij->i", fields @ matrix.toarray(), fields)) == pytest.approx(n - (held == 0), rel=0.05)
    assert np.allclose(fields @ matrix.toarray(), drawn, atol=1e-3)


def columns(weight, boundary):
    """A point, its effective number of storage parameters by all columns of H⁻¹, and their part of the regulariser."""
    reduced, search = problem(weight=weight, boundary=boundary)
    point = reduced.evaluate(search.start)
    block, regular = search.blocks["storage tissue"], reduced.regular_matrix(search.start)
    solver, trace = NormalEquations(point, forcing=1e-4, max_cg_iterations=400), 0.0
    for i in range(block.start, block.stop):
        one = np.zeros(len(search.start))
        one[i] = 1.0
        trace += 1.0 - float((regular @ solver.solve(one))[i])
    return point, trace, {"storage tissue": regular[block, block]}


@pytest.mark.parametrize("boundary", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_what_data_determine(boundary):
    """The mean of samples is the trace of 1 - αRH⁻¹ by columns; truncated iterations overestimate it slightly."""
    point, trace, matrices = columns(1e4, boundary)
    blocks = point.reduced.unknowns.blocks
    found = []
    for seed in range(6):
        found.append(
            NormalEquations(point).effective_parameters_by_block(blocks, matrices, np.random.default_rng(seed))[
                "storage tissue"
            ]
        )
    scatter = 2 * np.sqrt(2 * trace / 6)
    assert trace - scatter < np.mean(found) < (1.7 if boundary else 1.0) * trace + scatter
    assert np.std(found) < 1.5 * np.sqrt(2 * trace)


def test_preconditioner_of_a_transversely_isotropic_law():
    reduced, search = problem(law=lambda mu: TransverselyIsotropic(mu, 0.5, 0.5, (1, 0, 0)))
    point = reduced.evaluate(search.start)
    normal = NormalEquations(point, forcing=0.1, max_cg_iterations=100)
    normal.solve(-normal.gradient())
    assert normal.iterations[0] < 40


def test_what_is_determined_is_drawn_once():
    reduced, search = problem()
    normal = NormalEquations(reduced.evaluate(search.start), max_cg_iterations=5)
    whole, regular = normal.effective_parameters(np.random.default_rng(0)), reduced.regularisers
    first = normal.effective_parameters_by_block(search.blocks, regular, np.random.default_rng(1))
    assert normal.effective_parameters_by_block(search.blocks, regular, np.random.default_rng(2)) == first
    assert normal.effective_parameters(np.random.default_rng(3)) == whole and len(normal.iterations) == 1


@pytest.mark.one_thread
def test_resumed_from_a_checkpoint_has_the_same_bits(tmp_path):
    whole, search = problem(weight=1e4)
    straight = GaussNewtonCG(whole, max_cg_iterations=5).descend(search.start, 3)
    first, _ = problem(weight=1e4)
    GaussNewtonCG(first, max_cg_iterations=5, checkpoint=tmp_path / "part.npz").descend(search.start, 1)
    second, _ = problem(weight=1e4)
    resumed = GaussNewtonCG(second, max_cg_iterations=5, checkpoint=tmp_path / "part.npz").resume(3)
    assert np.array_equal(resumed.x, straight.x)
    assert resumed.weights == straight.weights
    assert [done.expected for done in resumed.history] == [done.expected for done in straight.history]  # its probes
    assert [path.name for path in tmp_path.iterdir()] == ["part.npz"]


def test_a_checkpoint_of_another_problem_is_refused(tmp_path):
    first, search = problem(weight=1e4)
    GaussNewtonCG(first, max_cg_iterations=5, checkpoint=tmp_path / "part.npz").descend(search.start, 1)
    moved, heavier = problem(weight=1e4)[0], problem(weight=1e4)[0]
    moved.misfit.measured[0, 0, 0] *= 1.001
    heavier.model.body.density *= 1.001
    for other, words in (
        (moved, "differs in measured displacements;"),
        (heavier, "differs in material, density or fibres;"),
    ):
        with pytest.raises(InputError, match=words):
            GaussNewtonCG(other, checkpoint=tmp_path / "part.npz").resume()


def test_what_has_settled_is_not_begun_again(tmp_path):
    first, search = problem(weight=1e4)
    found = GaussNewtonCG(first, FixedWeights(), checkpoint=tmp_path / "whole.npz").descend(search.start, 20)
    second, _ = problem(weight=1e4)
    told = []
    resumed = GaussNewtonCG(second, FixedWeights(), checkpoint=tmp_path / "whole.npz", callback=told.append).resume(21)
    assert found.converged and resumed.converged and not told
    assert np.array_equal(resumed.x, found.x) and resumed.history == found.history
    assert resumed.objective == pytest.approx(found.objective, rel=1e-12) and resumed.weights == found.weights
    assert second.model.solves.factorisations == 1


def test_what_is_no_checkpoint_is_refused(tmp_path):
    reduced, _ = problem()
    (tmp_path / "cut.npz").write_bytes(b"PK and no more")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    for name in ("none.npz", "cut.npz", "other.npz"):
        with pytest.raises(InputError, match="checkpoint"):
            GaussNewtonCG(reduced, checkpoint=tmp_path / name).resume()


def test_boundary_that_is_off_is_put_right():
    reduced, search = problem(boundary=True, weight=1e4)
    x = search.start.copy()
    block = search.blocks[BOUNDARY]
    x[block] += np.random.default_rng(0).normal(size=block.stop - block.start)
    before = reduced.evaluate(x).misfit
    found = GaussNewtonCG(reduced, FixedWeights(), max_cg_iterations=20).descend(x, 2)
    assert found.level.misfit / 2 < 0.5 * before
