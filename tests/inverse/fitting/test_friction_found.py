"""Friction and relaxation from the forces of a plate that presses, slides and stops.

Data come from cubic elements on a mesh twice as fine with four times finer steps, with 1 % noise.
"""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from friction_blocks import Sliding, model

from ngbrain.forward.observables import Force
from ngbrain.inverse.fitting.estimate import estimate

TRUTH = {"mu": 1000.0, "g": 0.5, "tau": 3.0, "friction": 0.1}
GUESS = {"mu": 2000.0, "g": 0.3, "tau": 8.0, "friction": 0.3}
TIMES = [0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6, 8, 10, 13]
STEPS = [*np.arange(0, 3.75, 0.25), 4, 4.5, 5, 6, 7, 8, 10, 13]
BOTH, NORMAL = Force("top"), Force("top", (0, 1))


def run(values, n, element, steps, seen):
    return model(
        steps, seen=[seen], times=TIMES, n=n, element=element, plate=Sliding(8e-4, 2e-3, (1.0, 3.0, 13.0)), wide=2.0,
        bulk=5e4, penalty=2e7, given=("slip", "penalty"), **values,
    )  # fmt: skip


@cache
def exact():
    finer = np.unique(np.concatenate([np.linspace(a, b, 5) for a, b in pairwise(STEPS)]))
    of = run(TRUTH, 6, "P3/P2", finer, BOTH)
    return of.evaluate(of.theta).data


def recovered(seed, seen=BOTH):
    noise = 0.01 * np.sqrt(np.mean(exact() ** 2, axis=0)) * np.ones_like(exact())
    data = exact() + noise * np.random.default_rng(seed).normal(size=noise.shape)
    columns = slice(None) if seen is BOTH else slice(1, None)
    return estimate(run(GUESS, 3, "P2/P1", STEPS, seen), data[:, columns], noise[:, columns], callback=lambda _: None)


def holds(found, name):
    band = found.posterior.interval(name)
    return float(band.low[0]) < TRUTH[name] < float(band.high[0])


def test_both_components_tell_friction_and_relaxation():
    found = recovered(0)
    print(found)
    assert found.converged and found.misfit < 1.5 and not found.undetermined
    assert found.values["friction"] == pytest.approx(0.1, rel=0.05) and holds(found, "friction")
    assert found.values["tau"] == pytest.approx(3.0, rel=0.15) and holds(found, "tau")


@pytest.mark.slow
def test_the_normal_force_alone_leaves_friction_open():
    found = recovered(0, NORMAL)
    print(found)
    assert list(found.undetermined) == ["friction"] and "friction: not determined: 95 % between" in str(found)
    assert found.values["tau"] == pytest.approx(3.0, rel=0.15)


@pytest.mark.slow
def test_twenty_draws_of_noise():
    found = [recovered(seed) for seed in range(20)]
    for each in found:
        print(each.values)
    assert all(each.values["friction"] == pytest.approx(0.1, rel=0.05) for each in found)
    assert all(each.values["tau"] == pytest.approx(3.0, rel=0.15) for each in found)
    for name in ("friction", "tau"):
        assert sum(holds(each, name) for each in found) >= 17, name
