"""Derivatives of equilibria: Taylor rates for every law, form and kind of parameter; J against Jᵀ; second derivatives."""

import ngsolve as ngs
import numpy as np
import pytest
from equilibria import LAWS, SIDE, Mine, directions, field, model, seen, tight, unit, verify, weights
from statics import cube, square

from ngbrain import materials
from ngbrain.adjoint.check import dot, taylor
from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.common.material import Material
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticLinearisation, StaticModel
from ngbrain.forward.solid.advance import newton_for
from ngbrain.forward.solid.problem import Problem
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.materials import Demiray, HolzapfelGasserOgden, NeoHooke, Ogden

FORMS = {"displacements": "P2", "continuous pressure": "P2/P1", "condensed pressure": ElementPair(2, 0, False)}
RELAXING = {
    "Branch",
    "MaxwellVariables",
    "MaxwellTerm",
    "Maxwell",
    "Prony",
    "RelaxingOgden",
    "RelaxingPolynomial",
    "Viscous",
}
"""Laws that equilibrium knows nothing of."""
OTHER = {"Deformation", "Law", "Points", "SmallStrainLaw"}


def test_every_law_is_here():
    names = {name for name in materials.__all__ if name[0].isupper() and not name.isupper()}
    assert names - RELAXING - OTHER == {law.__name__ for law in LAWS if law is not Mine}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
@pytest.mark.parametrize("kind", ["field", "number"])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_rates_and_transposes(law, kind, form, rng):
    verify(model(law, kind, form), rng)


@pytest.mark.parametrize("form", ["P1", "P3", "P4/L2(2)"])
def test_orders(form, rng):
    verify(model(Ogden, "field", form), rng)


def test_squares_of_elements(rng):
    verify(model(NeoHooke, "field", "Q2/Q1", square(1, quads=True, size=SIDE)), rng)


def test_space(rng):
    verify(model(NeoHooke, "field", "P2/P1", cube(1, size=SIDE)), rng)


SPACES = {
    "by element": lambda mesh: ngs.L2(mesh, order=0),
    "one number": ngs.NumberSpace,
    "third order": lambda mesh: ngs.H1(mesh, order=3),
    "discontinuous": lambda mesh: ngs.L2(mesh, order=1),
}


@pytest.mark.parametrize("space", SPACES.values(), ids=SPACES)
def test_fields_of_any_space(space, rng):
    mesh = square(2, size=SIDE)
    mu = ngs.GridFunction(space(mesh))
    mu.vec[:] = 1e3
    if mu.space.ndof > 1:
        mu.Set(1e3 * (1 + 4 * ngs.x))
    body = Problem(mesh, {".*": Material(NeoHooke(mu), 5e4)}, {"bottom": 0, "top": (0.006, -0.012)}, element="P2/P1")
    verify(StaticModel([LoadCase(body, seen())], {"mu": mu}, tight(body)), rng)


def test_a_field_of_fibres_and_one_in_a_gradient(rng):
    mesh = square(2, size=SIDE)
    fibre, height = ngs.GridFunction(ngs.VectorL2(mesh, order=1)), field(mesh, 1.0, ngs.H1(mesh, order=2))
    fibre.Set((1.0, 0.3 + 3 * ngs.x))
    both = [ngs.CF((fibre[0], fibre[1], 0.1)), ngs.CF((ngs.Grad(height)[1], 10.0, 3.0))]
    law = HolzapfelGasserOgden(700.0, 900.0, 4.0, 0.05, both)
    body = Problem(mesh, {".*": Material(law, 4e3)}, {"bottom": 0, "top": (0.006, 0.012)}, element="P2")
    verify(StaticModel([LoadCase(body, seen())], {"fibre": fibre, "height": height}, tight(body)), rng)


def test_condensed_pressures_of_a_stiff_bulk_leave_their_digits(rng):
    """K/μ = 10⁶, condensed: what a factor leaves, 1e-9 of a load, goes in one refinement."""
    mesh = square(3, size=SIDE)
    mu = field(mesh, 1e3)
    body = Problem(mesh, {".*": Material(NeoHooke(mu), 9e8)}, {"bottom": 0, "top": (0.006, -0.004)}, element="P4/L2(2)")
    of = StaticModel([LoadCase(body, seen())], {"mu": mu}, newton_for(body, rtol=1e-11, xtol=1e-9))
    there, each = of.evaluate(of.theta), of.equilibria[0]
    b = rng.normal(size=body.fes.ndof) * body.is_u * (body.weights > 0)
    each.change.vec.FV().NumPy()[:] = there._inverse(0).solve(b)
    left = each.tangent_product() * (body.weights > 0) - b
    assert np.linalg.norm(left) < 1e-11 * np.linalg.norm(b)


@pytest.mark.parametrize("solver", ["cg-amg", "umfpack"])
def test_other_solvers_give_the_same_gradient(solver, rng):
    gradients = []
    for chosen in ("sparsecholesky", solver):
        mesh = cube(2, size=SIDE)
        mu = field(mesh, 1e3)
        body = Problem(
            mesh, {".*": Material(NeoHooke(mu), 4e3)}, {"bottom": 0, "top": (0, 0, -0.012)}, element="P2", solver=chosen
        )
        of = StaticModel([LoadCase(body, seen(3))], {"mu": mu})
        gradients.append(of.evaluate(of.theta).gradient(np.ones(10)))
    assert gradients[1] == pytest.approx(gradients[0], abs=1e-10 * np.abs(gradients[0]).max())


def test_a_factor_that_fails_is_made_with_pivots(monkeypatch, rng):
    of = model(NeoHooke, form="P2/P1")
    there, w = of.evaluate(of.theta), np.ones(7)
    wanted = there.gradient(w)

    def fails():
        raise FloatingPointError("no pivots")

    monkeypatch.setattr(of.equilibria[0].body, "new_factor", fails)
    again = StaticLinearisation(of, there.theta, there.states)
    assert again.gradient(w) == pytest.approx(wanted, rel=1e-9, abs=1e-12 * np.abs(wanted).max())


# Second derivatives.


@pytest.mark.parametrize("form", ["P2", "P2/P1"])
@pytest.mark.parametrize("law", [Demiray, Ogden, HolzapfelGasserOgden, Mine], ids=lambda law: law.__name__)
def test_second_derivatives(law, form, rng):
    """They are symmetric, and those of the gradient."""
    of = model(law, "field" if form == "P2" and law is not Ogden else "number", form)
    theta = of.theta
    there = of.evaluate(theta)
    w, (a, b) = weights(there, rng), (theta * rng.uniform(-1, 1, (2, of.size)))
    along_a, along_b = there.hvp(w, a), there.hvp(w, b)
    assert dot(along_a, along_b, a, b) < 1e-10
    rates = taylor(lambda t: of.evaluate(t).gradient(w) * theta, lambda d: there.hvp(w, d) * theta, theta, a, 2)
    assert np.all((rates > 1.9) & (rates < 2.1)), rates


def test_the_whole_hessian_of_a_misfit(rng):
    """JᵀWJ and the second derivatives weighted by the misfit's slope, together: symmetric, and the gradient's derivative."""
    of = model(Ogden, "number", "P2/P1")
    theta = of.theta
    there = of.evaluate(theta)
    misfit = LeastSquares(1.3 * there.data, 0.1 * unit(there))

    def hessian(direction):
        bent = misfit.gauss_newton_product(there.data, there.jvp(direction))
        return there.vjp(bent) + there.hvp(misfit.gradient(there.data), direction)

    def gradient(t):
        now = of.evaluate(t)
        return now.gradient(misfit.gradient(now.data)) * theta

    a, b = theta * rng.uniform(-1, 1, (2, of.size))
    along_a, along_b = hessian(a), hessian(b)
    assert dot(along_a, along_b, a, b) < 1e-10
    rates = taylor(gradient, lambda _: along_a * theta, theta, a, 2)
    assert np.all((rates > 1.9) & (rates < 2.1)), rates


# What a state stands for.


def test_a_state_of_before_keeps_its_derivatives(rng):
    for form in ("P2/P1", ElementPair(2, 0, False)):
        of = model(Demiray, "field", form)
        theta, direction = of.theta, dict(directions(of, rng))["mu"]
        first = of.evaluate(theta)
        w = weights(first, rng)
        wanted = first.gradient(w), first.jvp(direction), first.hvp(w, direction)
        fresh, second = of.evaluate(theta), of.evaluate(1.1 * theta)
        second.gradient(w)
        for there in (first, fresh):
            found = there.gradient(w), there.jvp(direction), there.hvp(w, direction)
            for is_now, was in zip(found, wanted, strict=True):
                assert is_now == pytest.approx(was, rel=1e-8, abs=1e-10 * np.abs(was).max())
        assert of.theta == pytest.approx(theta)


def test_a_path_of_its_own_leads_to_the_same_equilibrium():
    of, theta = model(Ogden, "field", "P2/P1"), model(Ogden).theta
    of.evaluate(theta)
    rng = np.random.default_rng(3)
    moved = theta * rng.uniform(0.5, 2.0, len(theta))
    straight = model(Ogden, "field", "P2/P1").evaluate(moved).data
    assert of.evaluate(moved).data == pytest.approx(straight, abs=1e-9 * np.abs(unit(of.evaluate(moved))).max())


def test_solves_are_counted(rng):
    of = model(NeoHooke)
    there = of.evaluate(of.theta)
    made, w = of.solves.factorisations, weights(there, rng)
    assert made >= 1 and of.solves.forward == 1
    there.gradient(w)
    assert (of.solves.factorisations, of.solves.adjoint, of.solves.incremental) == (made + 1, 1, 0)
    there.gradient(w)
    there.jvp(of.theta)
    there.vjp(w)
    assert (of.solves.factorisations, of.solves.adjoint, of.solves.incremental) == (made + 1, 1, 2)
