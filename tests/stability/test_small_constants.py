"""Constants of a law that start small: forces at a few stretches, noise of 1 %, the first guess (2000, 50) or (2000, 50, 500) Pa.

Naive: steps that change a logarithm by up to 3, in the scale of where they stand, damped by as much at first: the small constant
goes to nothing within a few steps, where data tell nothing of it, and the misfit ends over 1 000 times above the noise. Ours: a
factor of e at first, and the largest scale so far: all are found, and the misfit is that of the noise.
"""

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Force
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.inverse.fitting.estimate import estimate
from ngbrain.inverse.optimise import levenberg_marquardt as optimiser
from ngbrain.inverse.optimise.gauss_newton_hessian import Metric
from ngbrain.mesh import block

SIDE, START = 0.04, (2000.0, 50.0, 500.0)
TRUTHS = [(900.0, 300.0), (600.0, 30.0), (900.0, 300.0, 800.0), (700.0, 1500.0, 300.0)]
CASES = [pytest.param(truth, marks=[pytest.mark.slow] * (i % 3 > 0)) for i, truth in enumerate(TRUTHS)]


class Series:
    """W = μ/2 (Ī₁ - 3) + c₂ (Ī₁ - 3)² + c₃ (Ī₁ - 3)³."""

    def __init__(self, mu, *c):
        self.mu, self.c = mu, c

    def energy(self, C):
        shape = ngs.Trace(C) - 3
        return self.mu / 2 * shape + sum(c * shape ** (k + 2) for k, c in enumerate(self.c))


def model_of(n):
    """Pressed by 30 and 15 %, pulled by 25 %, sheared by 30 %."""
    numbers = {name: ngs.Parameter(1.0) for name in ("mu", "c2", "c3")[:n]}
    cases = []
    for move in ((0, 0, -0.3), (0, 0, -0.15), (0, 0, 0.25), (0.3, 0, 0)):
        by = tuple(SIDE * part for part in move)
        body = Problem(
            block((SIDE,) * 3, SIDE), {".*": Material(Series(*numbers.values()), 5e4)}, {"bottom": 0, "top": by},
            element="P2/P1",
        )  # fmt: skip
        cases.append(LoadCase(body, [Force("top", (0, 0, 1))] + [Force("top", (1, 0, 0))] * (move[0] > 0)))
    return StaticModel(cases, numbers, steps=2), numbers


def fitted(truth):
    model, numbers = model_of(len(truth))
    data = model.evaluate(np.array(truth)).data * (1 + 0.01 * np.random.default_rng(1).normal(size=5))
    model.forget()
    for number, value in zip(numbers.values(), START, strict=False):
        number.Set(value)
    return estimate(model, data, 0.01 * np.abs(data), callback=lambda _: None)


@pytest.mark.filterwarnings("ignore:An ill-conditioned matrix")
@pytest.mark.parametrize("truth", CASES, ids=str)
def test_naive_long_steps_lose_the_small_constant(truth, monkeypatch):
    monkeypatch.setattr(optimiser, "INITIAL_MAX_CHANGE", optimiser.MAX_CHANGE)
    monkeypatch.setattr(optimiser, "next_step_bound", lambda *_: optimiser.MAX_CHANGE)
    monkeypatch.setattr(optimiser, "LIGHT_DAMPING", optimiser.INITIAL_DAMPING)
    of = Metric.from_point
    monkeypatch.setattr(Metric, "from_point", staticmethod(lambda point, before=None: of(point)))
    try:
        found = fitted(truth)
    except InputError as error:
        assert "the data do not depend on" in str(error)
        return
    print(found.values, found.misfit)
    assert found.values["c2"] < 1e-3 * truth[1] and found.misfit > 1000


@pytest.mark.parametrize("truth", CASES, ids=str)
def test_ours_finds_it(truth):
    found = fitted(truth)
    print(found.values, found.misfit)
    assert found.converged and found.misfit < 2
    for name, value in zip(found.values, truth, strict=True):
        band = found.posterior.interval(name, 0.99)
        assert band.low < value < band.high, name
    assert found.values["mu"] == pytest.approx(truth[0], rel=0.05)
