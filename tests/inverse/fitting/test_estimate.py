"""`estimate` for static and transient models, a user-defined law, and refusals."""

import ngsolve as ngs
import numpy as np
import pytest
from equilibria import SIDE, Mine
from relaxing_blocks import GRID
from relaxing_blocks import model as run
from statics import square

from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Displacements, Force, Functional
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.inverse.fitting.estimate import estimate
from ngbrain.inverse.objective.parameters import LogTransform, ScaledTransform, Unknown
from ngbrain.materials import NeoHooke, Ogden
from ngbrain.mesh import block

LOADS = [{"bottom": 0, "top": (0.0, -0.015)}, {"bottom": 0, "top": (0.02, 0.0)}]
LINE = (np.arange(8) + 0.5) * SIDE / 8
POINTS = np.stack(np.meshgrid(LINE, LINE), axis=-1).reshape(-1, 2)


def seen(mesh, form, law, parameters):
    """Both loads; displacements at 64 points and the force on the plate."""
    bodies = [Problem(mesh, {".*": Material(law, 5e4)}, supports, element=form) for supports in LOADS]
    return StaticModel([LoadCase(body, [Displacements(POINTS), Force("top")]) for body in bodies], parameters)


def measured(law, noise, rng):
    """Data from a finer mesh of another order, with noise relative to each observation's rms."""
    fine = seen(square(12, size=SIDE), "P3/P2", law, {"none": ngs.Parameter(0.0)})
    data = fine.evaluate(fine.theta).data
    sigma = np.concatenate(
        [np.full(s.stop - s.start, noise * np.sqrt(np.mean(data[s] ** 2))) for s in fine.observation_slices]
    )
    return data + sigma * rng.normal(size=len(data))


def test_a_users_own_law_by_one_call(rng):
    """A stiffness field and a number; the parameters are set to the estimate, and the interval contains the number."""
    mesh = square(6, size=SIDE)
    stiffness, hardening = ngs.GridFunction(ngs.H1(mesh, order=1)), ngs.Parameter(2.0)
    stiffness.Set(800.0)
    truth = 400.0 + 4e3 * ngs.x
    data = measured(Mine(truth, ngs.CF(0.7)), 0.01, rng)
    of = seen(mesh, "P2/P1", Mine(stiffness, hardening), {"stiffness": stiffness, "hardening": hardening})
    found = estimate(of, data, 0.01)
    off = np.sqrt(ngs.Integrate((stiffness / truth - 1) ** 2, mesh) / SIDE**2)
    assert off < 0.15 and hardening.Get() == found.values["hardening"] == pytest.approx(0.7, rel=0.25)
    assert 0.7 < found.misfit < 1.6
    assert all(isinstance(u.transform, LogTransform) for u in found.problem.unknowns.unknowns.values())
    band = found.posterior.interval("hardening")
    assert band.low[0] < 0.7 < band.high[0]


def test_numbers_of_a_run_from_its_force():
    of = run(grid=GRID)
    truth = of.theta
    data = of.evaluate(truth).data
    for parameter in of.parameters.values():
        parameter.Set(1.3 * parameter.Get())
    sigma = np.broadcast_to(0.01 * np.abs(data).max(axis=0), data.shape)
    found = estimate(of, data, sigma)
    assert np.array(list(found.values.values())) == pytest.approx(truth, rel=0.02)
    assert found.converged


def test_what_is_given_is_taken(rng):
    """A given initial guess and transform; a negative number is scaled by its size."""
    mu, alpha = ngs.Parameter(2e3), ngs.Parameter(-2.0)
    data = measured(Ogden(900.0, -8.0), 1e-3, rng)
    of = seen(square(4, size=SIDE), "P2/P1", Ogden(mu, alpha), {"mu": mu, "alpha": alpha})
    found = estimate(of, data, 0.01, unknowns={"mu": Unknown(1.5e3)})
    assert found.values["mu"] == pytest.approx(900.0, rel=0.03) and found.values["alpha"] == pytest.approx(
        -8.0, rel=0.1
    )
    assert isinstance(found.problem.unknowns.unknowns["alpha"].transform, ScaledTransform)
    assert found.problem.unknowns.unknowns["mu"].start == 1.5e3


def test_what_cannot_be_meant_is_refused():
    mu, alpha = ngs.Parameter(1e3), ngs.Parameter(0.0)
    of = seen(square(1, size=SIDE), "P2", Ogden(mu, -3.0 + alpha), {"mu": mu, "alpha": alpha})
    data = of.evaluate(of.theta).data
    with pytest.raises(InputError, match=r"parameters\.alpha is zero initially"):
        estimate(of, data, 0.01)
    with pytest.raises(InputError, match=r"unknowns is 'my'; wanted: .*mu"):
        estimate(of, data, 0.01, unknowns={"my": Unknown(1.0)})
    for noise in (0.0, -0.1, np.nan):
        with pytest.raises(InputError, match="noise is"):
            estimate(of, data, noise)
    with pytest.raises(InputError, match=r"sigma is of shape \(3,\)"):
        estimate(of, data, np.ones(3))
    with pytest.raises(InputError, match=r"measured is of shape \(3,\)"):
        estimate(of, data[:3], np.ones(3), unknowns={"alpha": Unknown(0.0, ScaledTransform(1.0))})


def test_as_many_numbers_as_data_leave_nothing_to_judge_the_misfit_by():
    """Both are estimated with intervals; the misfit has no degrees of freedom left."""
    mu, bulk = ngs.Parameter(1e3), ngs.Parameter(1e4)
    tissue = {".*": Material(NeoHooke(mu), bulk)}
    body = Problem(block(), tissue, {"bottom": 0, "top": (0, 0, -4e-3)}, element="P2")
    swelling = Functional(lambda at: (ngs.Det(at.F) - 1) * at.dx(".*"), name="swelling", unit="m³")
    model = StaticModel([LoadCase(body, [Force("top", (0, 0, 1)), swelling])], {"mu": mu, "bulk": bulk})
    data = model.evaluate(model.theta).data
    mu.Set(500.0)
    bulk.Set(5e3)
    found = estimate(model, data, 0.01 * np.abs(data))
    assert found.values == pytest.approx({"mu": 1e3, "bulk": 1e4}, rel=2e-3) and np.isnan(found.misfit)
    low, high = (float(end[0]) for end in (found.posterior.interval("mu").low, found.posterior.interval("mu").high))
    assert 900 < low < 1000 < high < 1100
