"""Inversions of equilibria end to end: noisy data of a finer mesh of another order, and nothing told but energy and observation."""

import ngsolve as ngs
import numpy as np
import pytest
from equilibria import SIDE, Mine, along
from statics import square

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import LogTransform, ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import ridge, smooth
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.inverse.optimise.quasi_newton import l_bfgs, newton_cg
from ngbrain.inverse.optimise.regularisation_weight import DiscrepancyPrinciple
from ngbrain.materials import HolzapfelGasserOgden, NeoHooke, Ogden

NOISE = 0.01
LOADS = [{"bottom": 0, "top": (0.0, -0.015)}, {"bottom": 0, "top": (0.02, 0.0)}]
"""Pressed by 15 %, sheared by 20 %."""
LINE = (np.arange(8) + 0.5) * SIDE / 8
POINTS = np.stack(np.meshgrid(LINE, LINE), axis=-1).reshape(-1, 2)


def model(mesh, form, law, parameters):
    """Both loads; displacements at 64 points and the force on the plate."""
    bodies = [Problem(mesh, {".*": Material(law, 5e4)}, supports, element=form) for supports in LOADS]
    return StaticModel([LoadCase(body, [Displacements(POINTS), Force("top")]) for body in bodies], parameters, steps=2)


def measured(law):
    """Noisy data and their σ: a part of the rms displacement, and of the force."""
    fine = model(square(14, size=SIDE), "P3/P2", law, {"none": ngs.Parameter(0.0)})
    data, sigma = fine.evaluate(fine.theta).data, []
    for moved, force in fine.split(data):
        sigma += [np.full(len(moved), NOISE * np.sqrt(2 * np.mean(moved**2)))]
        sigma += [np.full(2, NOISE * np.linalg.norm(force))]
    sigma = np.concatenate(sigma)
    return data + sigma * np.random.default_rng(5).normal(size=len(data)), sigma


def inverted(of, data, sigma, unknowns, optimiser=levenberg_marquardt):
    """Fields smooth, numbers hardly held."""
    fields = ParameterFields(of.theta, of.blocks, unknowns)
    held = {}
    for name, block in fields.blocks.items():
        start = fields.start[block]
        held[name] = smooth(of.parts[name].gfu.space, start) if len(start) > 1 else ridge(start)
    weights = {name: 10.0 if fields.blocks[name].stop - fields.blocks[name].start > 1 else 0.01 for name in held}
    reduced = Reduced(of, LeastSquares(data, sigma), fields, held, weights)
    found = optimiser(reduced, fields.start, DiscrepancyPrinciple())
    print(
        optimiser.__name__,
        found.level.ratio,
        of.solves,
        {k: v for k, v in fields.values(found.x).items() if len(v) == 1},
    )
    assert found.converged
    return fields.values(found.x), found


def disc(soft, stiff):
    away = ngs.CF((ngs.x, ngs.y)) - ngs.CF((0.055, 0.05))
    return ngs.IfPos(0.022**2 - ngs.InnerProduct(away, away), stiff, soft)


SLOW = [pytest.param(optimiser, marks=pytest.mark.slow) for optimiser in (newton_cg, l_bfgs)]


@pytest.mark.parametrize("optimiser", [levenberg_marquardt, *SLOW], ids=lambda o: o.__name__)
def test_a_stiff_disc_by_every_optimiser(optimiser):
    mesh = square(8, size=SIDE)
    mu = ngs.GridFunction(ngs.H1(mesh, order=1))
    mu.Set(1.5e3)
    data, sigma = measured(NeoHooke(disc(1e3, 3e3)))
    values, found = inverted(
        model(mesh, "P2/P1", NeoHooke(mu), {"mu": mu}), data, sigma, {"mu": Unknown(1.5e3)}, optimiser
    )
    mu.vec.FV().NumPy()[:] = values["mu"]
    core = np.linalg.norm(POINTS - [0.055, 0.05], axis=1) < 0.018
    shown = mu(mesh(*POINTS.T)).ravel()
    print(np.median(shown[core]), np.median(shown[~core]))
    assert found.level.ratio < 2
    assert 2.0 < np.median(shown[core]) / np.median(shown[~core]) < 3.2
    assert np.median(shown[~core]) == pytest.approx(1e3, rel=0.15)


def test_stiffness_and_exponent_of_an_ogden_tissue():
    mu, alpha = ngs.Parameter(2e3), ngs.Parameter(-2.0)
    data, sigma = measured(Ogden(900.0, -8.0))
    of = model(square(6, size=SIDE), "P2/P1", Ogden(mu, alpha), {"mu": mu, "alpha": alpha})
    values, _ = inverted(of, data, sigma, {"mu": Unknown(2e3), "alpha": Unknown(-2.0, ScaledTransform(5.0))})
    assert values["mu"] == pytest.approx([900.0], rel=0.02)
    assert values["alpha"] == pytest.approx([-8.0], rel=0.1)


def test_direction_and_stiffness_of_fibres():
    angle, k1 = ngs.Parameter(0.9), ngs.Parameter(3e3)
    data, sigma = measured(HolzapfelGasserOgden(600.0, 1.2e3, 4.0, 0.05, along(ngs.CF(0.6))))
    law = HolzapfelGasserOgden(600.0, k1, 4.0, 0.05, along(angle))
    of = model(square(6, size=SIDE), "P2/P1", law, {"angle": angle, "k1": k1})
    values, _ = inverted(of, data, sigma, {"angle": Unknown(0.9, ScaledTransform()), "k1": Unknown(3e3)})
    assert values["angle"] == pytest.approx([0.6], abs=0.02)
    assert values["k1"] == pytest.approx([1.2e3], rel=0.05)


def test_a_users_own_law_inverts_at_once():
    """Ten lines of energy, and nothing else was written for it: a field of stiffness and a number."""
    mesh = square(6, size=SIDE)
    stiffness, hardening = ngs.GridFunction(ngs.H1(mesh, order=1)), ngs.Parameter(2.0)
    stiffness.Set(800.0)
    data, sigma = measured(Mine(400.0 + 4e3 * ngs.x, ngs.CF(0.7)))
    of = model(mesh, "P2/P1", Mine(stiffness, hardening), {"stiffness": stiffness, "hardening": hardening})
    values, _ = inverted(of, data, sigma, {"stiffness": Unknown(800.0), "hardening": Unknown(2.0, LogTransform())})
    stiffness.vec.FV().NumPy()[:] = values["stiffness"]
    wrong = ngs.Integrate((stiffness / (400.0 + 4e3 * ngs.x) - 1) ** 2, mesh) / SIDE**2
    print(np.sqrt(wrong), values["hardening"])
    assert np.sqrt(wrong) < 0.15
    assert values["hardening"] == pytest.approx([0.7], rel=0.3)
