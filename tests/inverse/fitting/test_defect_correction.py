"""Stiffness factors of two regions with coarse elements: the correction by one run on finer ones."""

import math

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import Glue, OCCGeometry, Rectangle, Y

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.sensitivity.static_equilibrium import LoadCase
from ngbrain.forward.sensitivity.static_model import StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.inverse.fitting.defect_correction import defect_correction_step
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import LogTransform, ParameterFields, Unknown
from ngbrain.inverse.objective.regularisation import ridge
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.inverse.optimise.regularisation_weight import FixedWeights
from ngbrain.inverse.uncertainty.posterior import Posterior
from ngbrain.materials import NeoHooke

SIDE, MU, TRUTH, NOISE = 0.02, 1000.0, {"soft": 0.7, "stiff": 1.5}, 0.002
POINTS = np.array([[x, y] for x in (0.004, 0.012, 0.017) for y in (0.006, 0.013)])


def mesh(maxh):
    """Two layers, the upper half of whose top is pressed: stress has corners that coarse elements miss."""
    lower = Rectangle(SIDE, SIDE / 2).Face()
    upper = Rectangle(SIDE, SIDE / 2).Face().Move((0, SIDE / 2, 0))
    cut = Rectangle(SIDE / 2, SIDE / 2).Face().Move((0, SIDE / 2, 0))
    lower.faces.name = "stiff"
    left, right = upper * cut, upper - cut
    left.faces.name = right.faces.name = "soft"
    left.edges.Max(Y).name = "pressed"
    lower.edges.Min(Y).name = "bottom"
    return ngs.Mesh(OCCGeometry(Glue([lower, left, right]), dim=2).GenerateMesh(maxh=maxh))


def model(maxh):
    factors = {name: ngs.Parameter(1.0) for name in TRUTH}
    tissues = {name: Material(NeoHooke(MU * factor), 20 * MU) for name, factor in factors.items()}
    body = Problem(mesh(maxh), tissues, {"bottom": 0, "pressed": (0, -0.001)}, element="P1")
    return StaticModel([LoadCase(body, [Displacements(POINTS), Force("pressed", (0, 1))])], factors)


def found(of, data, sigma):
    fields = ParameterFields(of.theta, of.blocks, {name: Unknown(1.0, LogTransform()) for name in TRUTH})
    held = {name: ridge(fields.start[place]) for name, place in fields.blocks.items()}
    reduced = Reduced(of, LeastSquares(data, sigma), fields, held, dict.fromkeys(held, 1 / math.log(3) ** 2))
    return reduced.evaluate(levenberg_marquardt(reduced, fields.start, FixedWeights(), lambda _: None).x)


@pytest.mark.parametrize("size", [0.005, 0.0035])
def test_half_of_what_elements_are_wrong_by_is_taken_off(size):
    """The error of the inversion's own elements is many times that of the noise; at most six tenths remain after the step."""
    truth = np.array(list(TRUTH.values()))
    data = model(0.0006).evaluate(truth).data
    sigma = NOISE * np.abs(data)
    data = data + sigma * np.random.default_rng(1).normal(size=len(data))
    coarse = model(size)
    point = found(coarse, data, sigma)
    naive = point.x - np.log(truth)
    finer = model(size / math.sqrt(2)).evaluate(np.exp(point.x)).data
    moved, fitted = defect_correction_step(point, Posterior(point, min_eigenvalue=0), finer)
    left = naive + moved
    print(size, naive, left)
    assert np.abs(naive).max() > 0.02 and np.abs(left).max() < 0.6 * np.abs(naive).max()
    weighed = [np.linalg.norm((each - data) / sigma) for each in (point.state.data, fitted)]
    assert weighed[1] < weighed[0]
