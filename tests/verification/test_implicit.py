"""Derivatives of equilibria against closed forms: an incompressible bar pressed uniformly, and the envelope theorem."""

from math import inf, log

import ngsolve as ngs
import numpy as np
import pytest
from equilibria import field, tight
from statics import SIDE, cube, square

from ngbrain.forward.common.loads import BodyForce, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Force, Functional
from ngbrain.forward.sensitivity.static_model import LoadCase, PrescribedDisplacement, StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke, Ogden, density
from ngbrain.materials.base import Deformation

ROLLERS = {"back": (0, None, None), "left": (None, 0, None), "bottom": (None, None, 0)}


@pytest.mark.parametrize("stretch", [0.75, 1.3])
def test_an_ogden_bar(stretch):
    """F = A 2μ/α (λ^(α-1) - λ^(-α/2-1)): its derivatives by μ, α and λ, and the second ones by μ and α."""
    mu, alpha = ngs.Parameter(1e3), ngs.Parameter(-5.0)
    moved = ROLLERS | {"top": (None, None, (stretch - 1) * SIDE)}
    body = Problem(cube(1), {".*": Material(Ogden(mu, alpha), inf)}, moved, element="P2/P1")
    top = PrescribedDisplacement(body, "top")
    model = StaticModel([LoadCase(body, [Force("top")])], {"mu": mu, "alpha": alpha, "top": top}, tight(body))
    there = model.evaluate(model.theta)

    m, a, x, ln, area = 1e3, -5.0, stretch, log(stretch), SIDE**2
    powers, slopes = x ** (a - 1) - x ** (-a / 2 - 1), ln * (x ** (a - 1) + x ** (-a / 2 - 1) / 2)
    bends = ln**2 * (x ** (a - 1) - x ** (-a / 2 - 1) / 4)
    force = 2 * m / a * powers * area
    by_alpha = 2 * m * area * (slopes / a - powers / a**2)
    by_stretch = 2 * m / a * area * ((a - 1) * x ** (a - 2) + (a / 2 + 1) * x ** (-a / 2 - 2))
    by_alpha_twice = 2 * m * area * (bends / a - 2 * slopes / a**2 + 2 * powers / a**3)

    assert there.data[2] == pytest.approx(force, rel=1e-9)
    up = there.gradient(np.array([0, 0, 1.0]))
    assert up[:2] == pytest.approx([force / m, by_alpha], rel=1e-8)
    # Vertices move by a length, higher functions not at all.
    lift = np.isclose(top.value, (stretch - 1) * SIDE, rtol=1e-9).astype(float)
    assert up[model.blocks["top"]] @ lift == pytest.approx(by_stretch / SIDE, rel=1e-8)
    second = [there.hvp(np.array([0, 0, 1.0]), unit)[:2] for unit in np.eye(model.size)[:2]]
    wanted = np.array([[0, by_alpha / m], [by_alpha / m, by_alpha_twice]])
    assert np.array(second) == pytest.approx(wanted, rel=1e-7, abs=1e-9 * abs(by_alpha))


def test_of_the_whole_potential_only_the_explicit_part_is_left(rng):
    """dE(u(θ), θ)/dθ = ∂E/∂θ, as u is stationary: what the adjoint adds has to vanish."""
    mesh = square(3, size=SIDE)
    mu, pull = field(mesh, 1e3), ngs.Parameter(60.0)
    loads = [TractionLoad("right", ngs.CF((pull, 10.0))), BodyForce((0, -500.0))]
    material = Material(NeoHooke(mu), 5e4)
    body = Problem(mesh, {".*": material}, {"left": 0}, loads, element="P2/P1")

    def stored(at):
        return material.energy(Deformation.from_gradient(at.F), at.p) * at.dx(".*")

    def potential(at):
        return stored(at) + loads[0].energy(at) + loads[1].energy(at)

    model = StaticModel([LoadCase(body, [Functional(potential)])], {"mu": mu, "pull": pull}, tight(body))
    there = model.evaluate(model.theta)
    assert there.data == pytest.approx([body.energy], rel=1e-12)
    gradient = there.gradient(np.ones(1))
    per_mu = density(NeoHooke(1.0), Deformation.from_gradient(body.kinematics.gradient(body.u, ngs.Grad(body.u))))
    explicit = ngs.LinearForm(per_mu * mu.space.TestFunction() * ngs.dx(intrules=body.tissue.rules)).Assemble()
    assert gradient[:-1] == pytest.approx(np.array(explicit.vec.FV().NumPy()), rel=1e-8)
    shifted = ngs.Integrate(body.u[0] * ngs.ds("right"), mesh)
    assert gradient[-1] == pytest.approx(-shifted, rel=1e-8)
