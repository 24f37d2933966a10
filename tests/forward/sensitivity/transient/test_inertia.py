"""Derivatives of runs of bodies with mass: by density, tissue, loads and friction."""

import ngsolve as ngs
import numpy as np
import pytest
from friction_blocks import SIDE, Sliding, law_of, mesh_of

from ngbrain.adjoint.check import taylor
from ngbrain.forward.common.loads import BodyForce, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.sensitivity.transient.inertia_step import InertiaSensitivity
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.inertia import GeneralizedAlpha, Inertia
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke
from ngbrain.solvers.newton import Newton

GRID = (0.0, 0.01, 0.02, 0.03, 0.045, 0.05, 0.06, 0.07, 0.08, 0.1, 0.11, 0.12)
SIZES = {"mu": 1e3, "g": 0.5, "tau": 0.05, "rho": 1e3, "pull": 50.0, "friction": 0.3}


def struck(radius, law="Prony", field=False):
    """Pressed and rubbed within a tenth of a second, pulled aside meanwhile."""
    mesh, plate = mesh_of("plane strain", 2), Sliding(1e-3, 1e-3, (0.05, 0.1, 0.15))
    p = {name: ngs.Parameter(size) for name, size in SIZES.items()}
    if field:
        p["rho"] = ngs.GridFunction(ngs.H1(mesh, order=1))
        p["rho"].Set(1e3 * (1 + 20 * ngs.x))
    contact = RigidContact("top", lambda x: SIDE - plate.down - x[1], 1e7, 2e-5, 0.9, travel=plate.along)
    rubbing = Friction(contact, p["friction"], 5e-5, lambda x, way: way * ngs.CF((1.0, 0.0)))
    acting = [Inertia(p["rho"], GeneralizedAlpha(radius)), TractionLoad("right", (1e3 * p["pull"] * plate.down, 0))]
    body = Problem(
        mesh, {".*": Material(law_of(law, p), 2e4)}, {"bottom": 0}, acting, [contact, rubbing], element="P2/P1"
    )
    used = {name: of for name, of in p.items() if law != "Maxwell" or name != "g"}
    return RunModel(body, plate, GRID, used, [Force("top"), Force("bottom"), Displacements([[0.5 * SIDE, 0.8 * SIDE]])])


@pytest.mark.parametrize(
    ("radius", "law", "field"), [(0.0, "Prony", False), (0.5, "Maxwell", False), (0.8, "Prony", True)]
)
def test_gradients_are_those_of_differences(radius, law, field, rng):
    of = struck(radius, law, field)
    start, there = of.theta.copy(), of.evaluate(of.theta)
    largest = np.abs(there.data).max(axis=0)
    w = rng.normal(size=there.data.shape) / (largest + 1e-2 * largest.max())
    gradient = there.gradient(w)
    whole = np.abs(gradient * start).max()

    def value(theta):
        return float(np.sum(w * of.evaluate(theta).data))

    for name, place in of.blocks.items():
        direction = np.zeros(of.size)
        direction[place] = start[place] * rng.uniform(0.5, 1, size=place.stop - place.start)
        pushed = of.evaluate(start).jvp(direction)
        assert np.sum(w * pushed) == pytest.approx(gradient @ direction, rel=1e-6), name
        difference = (value(start + 1e-3 * direction) - value(start - 1e-3 * direction)) / 2e-3
        print(name, difference, gradient @ direction)
        assert difference == pytest.approx(gradient @ direction, rel=5e-3, abs=1e-4 * whole), name


def rates_by_density(rng):
    of = struck(0.5)
    start, there = of.theta.copy(), of.evaluate(of.theta)
    largest = np.abs(there.data).max(axis=0)
    w = rng.normal(size=there.data.shape) / (largest + 1e-2 * largest.max())
    direction = np.zeros(of.size)
    direction[of.blocks["rho"]] = SIZES["rho"]
    return taylor(
        lambda t: float(np.sum(w * of.evaluate(t).data)), there.gradient(w), start, direction, first=1e-2, steps=3
    )


def test_rate_by_density(rng):
    rates = rates_by_density(rng)
    print(rates)
    assert rates[1] == pytest.approx(2, abs=0.1), rates


def test_a_forgotten_speed_lowers_it(rng, monkeypatch):
    remembered = InertiaSensitivity.carried_state_gradient
    monkeypatch.setattr(
        InertiaSensitivity, "carried_state_gradient", lambda self, weights: 0 * remembered(self, weights)
    )
    assert rates_by_density(rng)[1] < 1.5


def test_a_rigid_body_goes_by_its_weight_over_its_mass():
    """u = h(f/ρ): what a part more of the force does, a part less of the density does too, in any scheme."""
    mesh = mesh_of("plane strain", 2)
    force, rho = ngs.Parameter(50.0), ngs.Parameter(1e3)
    supports = {".*": (None, 0)}
    body = Problem(
        mesh, {".*": Material(NeoHooke(1e3), 5e3)}, supports, [Inertia(rho, GeneralizedAlpha(0.6)), BodyForce((force, 0))],
        element="P2",
    )  # fmt: skip
    seen = [Displacements([[SIDE / 2, SIDE / 2]], (1, 0))]
    settled = Newton(rtol=1e6, xtol=1e-12)  # nothing bears a load that a residual could be measured by

    class Loaded:
        events = (1.0,)

        def set(self, t):
            body.factor.Set(1.0)

        def travel(self, start, end):
            return 0.0

    of = RunModel(body, Loaded(), (0.0, 0.1, 0.3, 0.6, 1.0), {"force": force, "rho": rho}, seen, newton=settled)
    J = of.evaluate(of.theta).jacobian[:, :, 0]
    assert J[0] * 50.0 == pytest.approx(of.evaluate(of.theta).data[:, 0], rel=1e-8)
    assert J[1] * 1e3 == pytest.approx(-J[0] * 50.0, rel=1e-8)


def rates_twice(rng, **how):
    """Of second derivatives, along all parameters, and how far these are from symmetric."""
    of = struck(0.5, **how)
    start, there = of.theta.copy(), of.evaluate(of.theta)
    largest = np.abs(there.data).max(axis=0)
    w = rng.normal(size=there.data.shape) / (largest + 1e-2 * largest.max())
    a, b = start * rng.uniform(0.3, 1, (2, of.size))
    along_a, along_b = there.hvp(w, a), there.hvp(w, b)
    slope = lambda t: of.evaluate(t).gradient(w) * start  # noqa: E731
    rates = taylor(slope, lambda d: along_a * start, start, a, first=1e-3, steps=3)
    return rates, abs(along_a @ b - along_b @ a) / (np.abs(along_a * b).sum() + np.abs(along_b * a).sum())


@pytest.mark.parametrize("how", [{}, {"law": "Maxwell"}, {"field": True}], ids=["number", "Maxwell", "field"])
def test_second_derivatives(how, rng):
    rates, uneven = rates_twice(rng, **how)
    print(how, rates, uneven)
    assert uneven < 1e-9 and np.sort(rates)[1] == pytest.approx(2, abs=0.1)


def test_a_mass_that_stays_lowers_their_rate(rng, monkeypatch):
    turned = InertiaSensitivity.gradient_derivatives
    monkeypatch.setattr(
        InertiaSensitivity,
        "gradient_derivatives",
        lambda self, a, m: type(f := turned(self, a, m))(*(0 * part for part in f)),
    )
    assert rates_twice(rng)[0][-1] < 1.3
