"""Elements that reach out of the data, in tissue that hardly changes its volume: what is held makes the whole body swell.

Preconditioned by the data near by alone, conjugate gradients do not get there; by what held displacements do inside they do.
"""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg
from ball_in_block import MIDDLE, wave_data

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY
from ngbrain.inverse.data.quality import noise_deviation
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.optimise.normal_equations import NormalEquations
from ngbrain.inverse.optimise.preconditioners import (
    BoundaryExtensionPreconditioner,
    block_preconditioner,
    diagonal_block_inverses,
)
from ngbrain.inverse.problem.discretisation import discretise
from ngbrain.inverse.problem.wave_problem import ElastographyProblem

MOST = 30


@pytest.fixture(scope="module")
def normal():
    data = wave_data()
    data = replace(data, mask=np.linalg.norm(data.points - MIDDLE, axis=1) < 0.018, dirichlet=None, bulk=2e6)
    experiment = ElastographyProblem(data, discretise(data, order=2))
    sigma = noise_deviation(data, 0.02)
    unknowns, misfit = experiment.unknowns(sigma), LeastSquares(experiment.measured, sigma)
    blocks = {name: block for name, block in unknowns.blocks.items() if name != BOUNDARY}
    prior = {name: smooth(experiment.space, unknowns.start[block]) for name, block in blocks.items()}
    reduced = Reduced(experiment.model, misfit, unknowns, prior, dict.fromkeys(prior, 0.05 * misfit.count))
    return NormalEquations(reduced.evaluate(unknowns.start), forcing=1e-9, max_cg_iterations=MOST)


def local(normal):
    """The data of the elements that a held displacement touches."""
    model, jacobian = normal.point.reduced.model, normal.point.jacobian
    block = normal.point.reduced.unknowns.blocks[BOUNDARY]
    observe = model.observation_matrix[:, model.driven_dofs]
    parts = []
    for weight in normal.point.reduced.misfit.weight(None):
        parts += 2 * [sp.csr_array(observe.T @ sp.diags_array(weight.T.ravel()) @ observe)]
    inner = jacobian[model.blocks[BOUNDARY]][:, block]
    whole = sp.csc_array(inner.T @ sp.block_diag(parts) @ inner)
    whole = whole + 1e-2 * np.median(whole.diagonal()) * sp.eye_array(whole.shape[0])
    return scipy.sparse.linalg.splu(sp.csc_array(whole)).solve


def above(normal, held, least):
    """How far `MOST` iterations stay above what can be had, over what noise leaves; without a least value, that value."""
    normal.precondition = block_preconditioner(
        diagonal_block_inverses(normal.point, BoundaryExtensionPreconditioner()) | held, normal.point.reduced
    )
    normal.directions.arrays = []
    gradient = normal.gradient()
    x = normal.solve(-gradient)
    value = 0.5 * x @ normal.product(x) + gradient @ x
    return (value - least) / (normal.point.reduced.misfit.count / 2)


def test_by_the_data_near_by_alone_it_is_hardly_lowered_and_by_extensions_it_is(normal):
    normal.max_cg_iterations = 400
    least = above(normal, {}, 0.0) * normal.point.reduced.misfit.count / 2
    normal.max_cg_iterations = MOST
    assert normal.point.misfit > 30 * normal.point.reduced.misfit.count / 2
    assert above(normal, {BOUNDARY: local(normal)}, least) > 2
    assert above(normal, {}, least) < 0.7
