"""What tissue is made of from how it answers over time: relaxation from a force curve, moduli of regions from landmarks."""

import ngsolve as ngs
import numpy as np
import pytest
from relaxing_blocks import HOLD, SIDE, plate, two_layers

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import BoundedTransform, LogTransform, ParameterFields, Unknown
from ngbrain.inverse.objective.regularisation import ridge
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.inverse.optimise.quasi_newton import l_bfgs
from ngbrain.inverse.optimise.regularisation_weight import FixedWeights
from ngbrain.materials import Maxwell, NeoHooke, Prony, Viscous
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

RAMP = ToolMotion("ramp", (0.0, 1.0, 61.0), (0.0, 2e-3, 2e-3))
TIMES = np.concatenate([np.linspace(0.25, 1, 4), 1 + np.geomspace(0.2, 60, 20)])
PRONY = {"mu": 900.0, "fast": 0.35, "tau_fast": 1.5, "slow": 0.3, "tau_slow": 20.0}


def pressed(values, grid=TIMES, law=None, times=TIMES):
    p = {name: ngs.Parameter(value) for name, value in values.items()}
    tissue = law or (lambda p: Prony(NeoHooke(p["mu"]), [p["fast"], p["slow"]], [p["tau_fast"], p["tau_slow"]]))
    drive = Drive(RAMP)
    body = Problem(
        block((SIDE,) * 3, SIDE),
        {"tissue": Material(tissue(p), 1e6)},
        {"bottom": 0},
        contacts=[plate(drive)],
        element="P2/P1",
    )
    return RunModel(body, drive, np.concatenate([[0.0], grid]), p, [Force("top", (0, 0, 1))], times)


def inverted(model, measured, sigma, starts, transforms, search=levenberg_marquardt):
    """Where a search ends that takes each value to be within a factor of e or so of its start."""
    unknowns = {name: Unknown(start, transforms.get(name, LogTransform())) for name, start in starts.items()}
    fields = ParameterFields(model.theta, model.blocks, unknowns)
    held = {name: ridge(fields.start[block]) for name, block in fields.blocks.items()}
    reduced = Reduced(model, LeastSquares(measured, sigma), fields, held, dict.fromkeys(held, 1.0))
    found = search(reduced, fields.start, FixedWeights())
    return found, fields.values(found.x)


SHARES = {"fast": BoundedTransform(0.0, 0.5), "slow": BoundedTransform(0.0, 0.5)}


def noisy(data, rng, level=0.01):
    sigma = level * np.sqrt(np.mean(data**2, axis=0))
    return data + sigma * rng.normal(size=data.shape), sigma


def test_prony_terms_from_a_ramp_and_hold(rng):
    finer = np.unique(np.concatenate([TIMES, np.linspace(0, 1, 17)[1:], 1 + np.geomspace(0.05, 60, 61)]))
    truth = pressed(PRONY, finer)
    measured, sigma = noisy(truth.evaluate(truth.theta).data, rng)
    starts = {"mu": 1500.0, "fast": 0.15, "tau_fast": 4.0, "slow": 0.15, "tau_slow": 50.0}
    found, values = inverted(pressed(starts), measured, sigma, starts, SHARES)
    assert found.converged and found.level.misfit < 3 * found.count
    off = {name: float(values[name][0] / PRONY[name] - 1) for name in PRONY}
    print(off)
    assert all(abs(error) < bound for error, bound in zip(off.values(), (0.05, 0.1, 0.25, 0.15, 0.25), strict=True)), (
        off
    )


@pytest.mark.slow
def test_a_spring_and_a_dashpot_from_a_ramp_and_hold(rng):
    def law(p):
        return Viscous(NeoHooke(p["rest"]), (Maxwell(NeoHooke(p["spring"]), p["eta"]),))

    few = TIMES[3::2]
    values = {"rest": 300.0, "spring": 700.0, "eta": 4000.0}
    truth = pressed(values, TIMES, law, few)
    measured, sigma = noisy(truth.evaluate(truth.theta).data, rng)
    starts = {"rest": 800.0, "spring": 300.0, "eta": 1500.0}
    found, got = inverted(pressed(starts, few, law, few), measured, sigma, starts, {})
    off = [float(got[name][0] / values[name] - 1) for name in values]
    print(off)
    assert found.converged and np.abs(off).max() < 0.1, off


@pytest.mark.parametrize("search", [levenberg_marquardt, l_bfgs])
def test_moduli_of_two_regions_from_landmarks_and_force(search, rng):
    def retracted(low, high):
        p = {"low": ngs.Parameter(low), "high": ngs.Parameter(high)}
        drive = Drive(HOLD)
        tissues = {name: Material(Prony(NeoHooke(mu), [0.5], [5.0]), 1e6) for name, mu in p.items()}
        landmarks = SIDE * np.random.default_rng(3).uniform(0.15, 0.85, (8, 3))
        seen = [Displacements(landmarks), Force("top", (0, 0, 1))]
        body = Problem(two_layers(), tissues, {"bottom": 0}, contacts=[plate(drive)], element="P2/P1")
        return RunModel(body, drive, [0.0, 1.0, 2.5, 4.0, 9.0, 40.0], p, seen, times=[4.0, 40.0])

    truth = retracted(1200.0, 500.0)
    data = truth.evaluate(truth.theta).data
    sigma = np.append(np.full(24, 0.02 * np.sqrt(np.mean(data[:, :24] ** 2))), 0.01 * np.abs(data[:, 24]).max())
    measured = data + sigma * rng.normal(size=data.shape)
    starts = {"low": 500.0, "high": 1200.0}
    found, values = inverted(retracted(**starts), measured, sigma, starts, {}, search)
    off = float(values["low"][0] / 1200.0 - 1), float(values["high"][0] / 500.0 - 1)
    print(off)
    assert np.abs(off).max() < 0.05 and 0.3 < found.level.misfit / found.count < 2, off
