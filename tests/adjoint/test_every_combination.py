"""Taylor rates of J for every model of waves, every field it is made of, every misfit and every regulariser."""

import ngsolve as ngs
import numpy as np
import pytest
from wave_models import MODELS, SIDE

from ngbrain.adjoint.check import taylor
from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.inverse.objective.misfit import Huber, LeastSquares
from ngbrain.inverse.objective.parameters import LogTransform, ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import matern, ridge, smooth, total_variation
from ngbrain.inverse.subzones.consensus import ConsensusRegulariser

LENGTH = 0.01
FLOORS = {"zeta": -0.75, "phi": -1.0}
NOISE = 0.3
"""Of the waves: some residuals lie beyond Huber's threshold."""


def of_one_component(measured, sigma):
    """What ultrasound sees."""
    return LeastSquares(np.where(np.arange(measured.shape[-1]) == 1, measured, np.nan), sigma)


MISFITS = {"squares": LeastSquares, "huber": lambda m, s: Huber(m, s, 1.0), "one component": of_one_component}


def to_points(space, x, points):
    """As of zones that are told of their neighbours."""
    at = evaluation(space, points)
    return ConsensusRegulariser(smooth(space, x), at, at @ x + 1, np.full(len(points), 2.0))


REGULARISERS = {
    "smooth": lambda space, x, _: smooth(space, x),
    "smooth inside labels": lambda space, x, _: smooth(space, x, ngs.IfPos(ngs.x - SIDE / 2, 1.0, 0.1)),
    "matern": lambda space, x, _: matern(space, x, LENGTH),
    "ridge": lambda _, x, __: ridge(x),
    "total variation": lambda space, x, _: total_variation(space, x, LENGTH),
    "drawn to points": to_points,
}


def unknowns_of(model):
    """Logarithms of what has a floor at every node, else multiples of a unit."""
    theta, unknowns = model.theta, {}
    for name, where in model.blocks.items():
        nodal = name in model.fields and model.fields[name].space.globalorder == 1
        transform = LogTransform(FLOORS.get(name, 0.0)) if nodal else ScaledTransform(np.abs(theta[where]).max())
        unknowns[name] = Unknown(theta[where], transform)
    return ParameterFields(theta, model.blocks, unknowns)


class Remembered:
    """A model whose data of each θ are computed once, whatever they are compared with."""

    def __init__(self, model):
        self.model, self.known = model, {}

    def evaluate(self, theta):
        if (key := theta.tobytes()) not in self.known:
            self.known[key] = self.model.evaluate(theta).data
        return Known(self.model, theta, self.known[key])


class Known:
    """A State."""

    def __init__(self, model, theta, data):
        self.model, self.theta, self.data = model, theta, data

    def gradient(self, w):
        return self.model.evaluate(self.theta).gradient(w)


@pytest.mark.parametrize("name", MODELS)
def test_gradient(name, rng):
    model = MODELS[name]()
    fields = unknowns_of(model)
    x = fields.start + 0.1 * rng.normal(size=len(fields.start))
    seen, truth = Remembered(model), model.evaluate(fields.theta(fields.start)).data
    sigma = NOISE * np.sqrt(np.mean(np.abs(truth) ** 2, axis=1, keepdims=True))
    measured = truth + sigma * (rng.normal(size=truth.shape) + 1j * rng.normal(size=truth.shape))
    directions = {b: np.zeros(len(x)) for b in fields.blocks}
    for b, where in fields.blocks.items():
        directions[b][where] = rng.normal(size=where.stop - where.start)
    for regulariser, made in REGULARISERS.items():
        drawn = {b: made(f.space, fields.start[fields.blocks[b]], model.points) for b, f in model.fields.items()}
        for misfit, weighed in MISFITS.items():
            reduced = Reduced(seen, weighed(measured, sigma), fields, drawn, dict.fromkeys(drawn, 1.0))
            gradient = reduced.evaluate(x).gradient()
            for b, dx in directions.items():
                rates = taylor(reduced.value, gradient, x, dx, steps=2, first=2e-4)
                assert np.all(np.abs(rates - 2) < 0.1), (b, misfit, regulariser, rates)
