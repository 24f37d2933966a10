"""Strain imaging from measured displacements. Naive: the equation of motion is fulfilled best by moduli of nothing, a factor that
falls by e^.5 in every step. Ours: the common factor, which nothing tells, stays where it is.
"""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_waves import pressed

from ngbrain.adjoint.reduced import Reduced
from ngbrain.inverse.data.quality import noise_deviation
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.optimise.gauss_newton import GaussNewton
from ngbrain.inverse.optimise.regularisation_weight import Evidence
from ngbrain.inverse.problem.discretisation import discretise
from ngbrain.inverse.problem.wave_problem import ElastographyProblem

NOISE = 2e-3


@pytest.fixture(scope="module")
def axial():
    data = pressed(tilted=True).with_noise(NOISE, seed=0)
    displacement = data.displacement.copy()
    displacement[:, :, 0] = np.nan
    return replace(data, displacement=displacement)


def ended(data, held):
    """Mean of the modulus over where it began, and the misfit over its level."""
    experiment, sigma = ElastographyProblem(data, discretise(data)), noise_deviation(data, NOISE)
    unknowns = experiment.unknowns(sigma)
    if not held:
        unknowns.undetermined_direction = None
    block = unknowns.blocks["youngs"]
    regular = {"youngs": smooth(experiment.space, unknowns.start[block])}
    problem = Reduced(experiment.model, LeastSquares(experiment.measured, sigma), unknowns, regular, {"youngs": 1e3})
    found = GaussNewton(problem, Evidence()).from_waves(unknowns.start, experiment.waves)
    return float(np.exp(np.mean((found.x - unknowns.start)[block]))), found.level.ratio


def test_naive_all_moduli_fall_to_nothing(axial):
    level, misfit = ended(axial, held=False)
    assert level < 0.05 and misfit < 0.01


def test_the_common_factor_stays(axial):
    level, misfit = ended(axial, held=True)
    assert level == pytest.approx(1.0, abs=0.1) and 0.8 < misfit < 1.2
