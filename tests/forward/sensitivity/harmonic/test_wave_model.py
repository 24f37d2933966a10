"""Derivatives of waves at points: Taylor rates of every field, J against Jᵀ, and bugs put in on purpose that are caught."""

import ngsolve as ngs
import numpy as np
import pytest
import scipy.sparse as sp
from quadrature import coarser
from wave_models import MODELS, SIDE, START, WAVES, directions, field, model, wanted
from waves import square

from ngbrain.adjoint.check import dot, taylor
from ngbrain.errors import ConvergenceError, InputError
from ngbrain.forward.harmonic.factors import Factorised
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import AbsorbingBoundary
from ngbrain.forward.sensitivity.harmonic import wave_model as sensitivity
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY, WaveLinearisation, WaveModel
from ngbrain.materials import Shearing


def misfit(of, weight):
    """½ Σ |d - d0|² with d0 far from the data, and its gradient."""

    def value(theta):
        return float(0.5 * np.sum(np.abs(of.evaluate(theta).data - weight) ** 2))

    def gradient(theta):
        there = of.evaluate(theta)
        return there.gradient(there.data - weight)

    return value, gradient


@pytest.mark.parametrize("name", MODELS)
def test_rates_of_every_field(name, rng):
    of = MODELS[name]()
    theta, (value, gradient) = of.theta, misfit(of, wanted(of, rng))
    slope = gradient(theta)
    for block, direction in directions(of, rng):
        rates = taylor(value, slope, theta, direction, first=1e-3 if block != BOUNDARY else 1.0)[1:]
        assert np.all((rates > 1.9) & (rates < 2.1)), (block, rates)


@pytest.mark.parametrize("name", MODELS)
def test_the_products_are_transposes_and_the_gradient_is_one(name, rng):
    of = MODELS[name]()
    there, w = of.evaluate(of.theta), wanted(of, rng)
    pulled, driven = there.vjp(w), there.gradient(w)
    scale = np.concatenate([np.full(b.stop - b.start, np.abs(pulled[b]).max()) for b in of.blocks.values()])
    assert np.abs((pulled - driven) / scale).max() < 1e-11
    for _, direction in directions(of, rng):
        assert dot(there.jvp, pulled, direction, w) < 1e-11


def test_absorbing_edges_of_fields(rng):
    mesh = square(3, SIDE)
    storage = field(mesh, "storage")
    law, edge = Shearing(storage * (1 + 0.3j)), AbsorbingBoundary("left|right", storage * (1 + 0.3j), 1e4)
    body = HarmonicProblem(mesh, law, WAVES, bulk=9e3, form="P2", dirichlet="bottom|top", absorbing=[edge])
    of = WaveModel(body, {"storage": storage}, np.array([[0.01, 0.02], [0.03, 0.011]]))
    value, gradient = misfit(of, wanted(of, rng))
    name, direction = next(directions(of, rng))
    rates = taylor(value, gradient(of.theta), of.theta, direction, first=2e-3)
    assert name == "storage" and np.all((rates > 1.9) & (rates < 2.1)), rates


@pytest.mark.parametrize("space", ["by element", "by region", "higher"])
def test_fields_of_any_space(space, rng):
    mesh = square(3, SIDE)
    spaces = {
        "by element": ngs.L2(mesh, order=0),
        "by region": ngs.NumberSpace(mesh),
        "higher": ngs.H1(mesh, order=3),
    }
    storage = ngs.GridFunction(spaces[space])
    storage.vec[:] = 0
    if space == "higher":
        storage.Set(START["storage"])
    else:
        storage.vec[:] = START["storage"]
    body = HarmonicProblem(mesh, Shearing(storage * (1 + 0.3j)), WAVES, bulk=9e3, form="P2", dirichlet="bottom|top")
    of = WaveModel(body, {"storage": storage}, np.array([[0.01, 0.02], [0.03, 0.011]]))
    weight = wanted(of, rng)
    value, gradient = misfit(of, weight)
    _, direction = next(directions(of, rng))
    rates = taylor(value, gradient(of.theta), of.theta, direction, first=2e-3)
    assert np.all((rates > 1.9) & (rates < 2.1)), rates
    there = of.evaluate(of.theta)
    assert there.vjp(weight) == pytest.approx(there.gradient(weight), rel=1e-9, abs=1e-16)


def test_solves_are_counted(rng):
    of = model()
    there, w = of.evaluate(of.theta), wanted(of, rng)
    assert (of.solves.factorisations, of.solves.forward) == (2, 3)
    there.gradient(w)
    assert of.solves.adjoint == 3
    there.jvp(of.theta)
    there.vjp(w)
    assert of.solves.incremental == 6


# Each bug is one that was met somewhere; rates of a right gradient are above 1.9.


def conjugated(patch):
    back = WaveLinearisation._adjoints
    patch.setattr(WaveLinearisation, "_adjoints", lambda self, w, purpose: back(self, np.conj(w), purpose))


def reversed_sign(patch):
    gradient = WaveLinearisation.gradient
    patch.setattr(WaveLinearisation, "gradient", lambda self, w: -gradient(self, w))


def without_mass(patch):
    """∂M/∂ρ forgotten."""
    terms = HarmonicProblem.weak_form_terms
    patch.setattr(
        HarmonicProblem, "weak_form_terms", lambda self, omega, u, v: terms(self, 0.0 if _waves(u) else omega, u, v)
    )


def coarser_gradient(patch):
    """By the rule before the right one: no bug where that is exact, as for linear moduli of isotropic tissue."""
    gradient = WaveLinearisation.gradient

    def wrong(self, w):
        body = self.model.body
        right, body.rules = body.rules, coarser(body.rules)
        found = gradient(self, w)
        body.rules = right
        return found

    patch.setattr(WaveLinearisation, "gradient", wrong)


def stale_factor(patch):
    gradient = WaveLinearisation.gradient

    def wrong(self, w):
        fields = self.model.fields.values()
        for each in fields:
            each.vec.data *= 1.05
        self.factors = Factorised(self.model.body)
        for each in fields:
            each.vec.data /= 1.05
        return gradient(self, w)

    patch.setattr(WaveLinearisation, "gradient", wrong)


def boundary_twice(patch):
    once = WaveLinearisation._of_boundary
    patch.setattr(WaveLinearisation, "_of_boundary", lambda self, adjoints: np.concatenate([2 * once(self, adjoints)]))


def boundary_forgotten(patch):
    once = WaveLinearisation._of_boundary
    patch.setattr(WaveLinearisation, "_of_boundary", lambda self, adjoints: 0 * once(self, adjoints))


def _waves(u):
    return isinstance(u, ngs.GridFunction)


BUGS = [
    (conjugated, "viscoelastic", "storage"),
    (reversed_sign, "viscoelastic", "loss"),
    (without_mass, "density", "density"),
    (coarser_gradient, "fields of fourth order", "storage"),
    (coarser_gradient, "mixed, fields of fourth order", "loss"),
    (coarser_gradient, "lossy fibres", "phi"),
    (coarser_gradient, "density", "density"),
    (coarser_gradient, "space", "zeta"),
    (stale_factor, "viscoelastic", "storage"),
    (boundary_twice, "viscoelastic", BOUNDARY),
    (boundary_forgotten, "viscoelastic", BOUNDARY),
]


@pytest.mark.parametrize(("bug", "kind", "block"), BUGS, ids=[f"{bug.__name__}-{kind}" for bug, kind, _ in BUGS])
def test_a_bug_lowers_the_rate(bug, kind, block, monkeypatch, rng):
    of = MODELS[kind]()
    theta, weight = of.theta, wanted(of, rng)
    direction = dict(directions(of, rng))[block]
    first = 5e-4 if block != BOUNDARY else 1.0

    def rates(value, gradient):
        return taylor(value, gradient(theta), theta, direction, steps=8, first=first)

    assert np.all(rates(*misfit(of, weight)) > 1.9)
    bug(monkeypatch)
    found = rates(*misfit(MODELS[kind](), weight))  # whose forms are made with the bug
    assert found[-1] < 1.2, found


def test_a_matrix_that_is_not_transposed_fails_the_dot_test(monkeypatch, rng):
    of = model()
    there, w = of.evaluate(of.theta), wanted(of, rng)
    _, direction = next(directions(of, rng))
    wrong = [sp.csr_array(s.conj()) for s in there.sensitivity.matrices]
    monkeypatch.setattr(there.sensitivity, "matrices", wrong)
    pushed = there.jvp(direction)
    monkeypatch.undo()
    assert dot(pushed, there.vjp, direction, w) > 1e-3


def test_bad_input():
    mesh = square(2, SIDE)
    storage = field(mesh, "storage")
    body = HarmonicProblem(mesh, Shearing(storage), WAVES, bulk=9e3, form="P2", dirichlet="bottom|top")
    with pytest.raises(InputError, match="boundary"):
        WaveModel(body, {"boundary": storage}, np.array([[0.01, 0.01]]))
    with pytest.raises(InputError, match="1 of 2 outside"):
        WaveModel(body, {"storage": storage}, np.array([[0.01, 0.01], [0.05, 0.01]]))
    with pytest.raises(InputError, match="real"):
        WaveModel(body, {"storage": ngs.GridFunction(ngs.H1(mesh, complex=True))}, np.array([[0.01, 0.01]]))
    of = WaveModel(body, {"storage": storage}, np.array([[0.01, 0.01]]))
    with pytest.raises(InputError, match="theta"):
        of.evaluate(np.ones(3))
    with pytest.raises(ConvergenceError, match="not finite; reduce the step"):
        of.evaluate(np.full(of.size, np.nan))
    assert sensitivity.BOUNDARY in of.blocks


def test_a_complex_constant_of_a_wall_is_told():
    """It waits until derivatives are asked for: waves themselves do not differentiate it."""
    at = (made := model(absorbing=[AbsorbingBoundary("left", ngs.CF(2000 + 700j), 1e4)])).evaluate(made.theta)
    for product in (at.gradient, at.vjp):
        with pytest.raises(InputError, match="absorbing is made of a complex constant"):
            product(at.data)


@pytest.mark.parametrize("name", MODELS)
def test_second_derivatives(name, rng):
    """Symmetric, and those of the gradient, along all fields and what drives the boundary together."""
    of = MODELS[name]()
    theta, w = of.theta, wanted(of, rng)
    there = of.evaluate(theta)
    a, b = (sum(direction for _, direction in directions(of, rng)) for _ in range(2))
    along_a, along_b = there.hvp(w, a), there.hvp(w, b)
    assert abs(b @ along_a - a @ along_b) < 1e-10 * np.abs(b * along_a).sum()
    size = np.concatenate([np.full(p.stop - p.start, np.abs(theta[p]).max()) for p in of.blocks.values()])
    rates = taylor(lambda t: of.evaluate(t).gradient(w) * size, lambda d: there.hvp(w, d) * size, theta, a, 2, 5e-4)
    assert np.all((rates > 1.9) & (rates < 2.1)), rates


def test_what_drives_one_wave_costs_no_solve_of_the_others(rng):
    """As each displacement of the boundary does, whose columns error bars take one by one."""
    of = model()
    there, before = of.evaluate(of.theta), of.solves.incremental
    direction = np.zeros(of.size)
    direction[of.blocks[BOUNDARY]][: 2 * len(of.driven_dofs)] = rng.normal(size=2 * len(of.driven_dofs))
    change = there.jvp(direction)
    assert of.solves.incremental - before == 1
    assert np.abs(change[0]).max() > 0 and not change[1:].any()
    w = wanted(of, rng)
    whole = there.vjp(w)
    before = of.solves.incremental
    parts = [there.vjp(np.where(np.arange(3)[:, None, None] == k, w, 0)) for k in range(3)]
    assert of.solves.incremental - before == 3
    np.testing.assert_allclose(sum(parts), whole, rtol=1e-12, atol=1e-12 * np.abs(whole).max())
