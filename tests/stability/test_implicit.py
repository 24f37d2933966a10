"""Inversions of equilibria, where they go wrong. Naive: whatever comes out of a solver. Ours: a state or an error."""

import ngsolve as ngs
import numpy as np
import pytest
from equilibria import SIDE, Plate, field, tight
from ngsolve.solvers import Newton as NgsolveNewton
from statics import cube, square

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import ConvergenceError, InputError, SolverError
from ngbrain.forward.common.loads import BodyForce, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.sensitivity import tangent_inverse as implicit_solve
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticLinearisation, StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import ridge
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.inverse.optimise.quasi_newton import bfgs, l_bfgs, newton_cg
from ngbrain.inverse.optimise.regularisation_weight import FixedWeights
from ngbrain.materials import Demiray, HolzapfelGasserOgden, NeoHooke

MESH = square(3, size=SIDE)
SEEN = Displacements([[0.02, 0.05], [0.05, 0.09], [0.08, 0.07]])
OPTIMISERS = [levenberg_marquardt, l_bfgs, newton_cg, bfgs]


class Counted:
    """A model, and which of its solves failed."""

    def __init__(self, model):
        self.model, self.failed = model, []

    def evaluate(self, theta):
        try:
            return self.model.evaluate(theta)
        except SolverError:
            self.failed.append(float(theta[0]))
            raise


def problem(model, data, start, transform=None):
    """One number looked for; hardly drawn to the start."""
    (name,) = model.blocks
    fields = ParameterFields(model.theta, model.blocks, {name: Unknown(start, *([transform] if transform else []))})
    counted = Counted(model)
    parts = [np.full(len(part), 0.01 * np.abs(part).max()) for part in model.split(data)[0]]
    misfit = LeastSquares(data, np.concatenate(parts))
    return Reduced(counted, misfit, fields, {name: ridge(fields.start)}, {name: 1e-3}), counted


def plain_newton(body):
    """NGSolve's, from where the body is: whether it says that it converged."""
    failed, _ = NgsolveNewton(body.form, body.gfu, maxit=40, printing=False, inverse="umfpack")
    return failed == 0


# Tissue under its weight, stiffness unknown: a step too far in it folds the tissue over.


def heavy():
    mu = ngs.Parameter(1e3)
    supports = {"bottom": 0, "left|right": (0, None)}
    body = Problem(MESH, {".*": Material(NeoHooke(mu), 5 * mu)}, supports, [BodyForce((0, -3e4))], element="P2")
    return StaticModel([LoadCase(body, [SEEN])], {"mu": mu}), body, mu


def test_naive_newton_converges_to_folded_tissue():
    model, body, mu = heavy()
    model.evaluate([5e3])
    mu.Set(92.0)
    assert plain_newton(body) and body.min_det(body.x) < -1
    model.evaluate([92.0])
    assert body.min_det(body.x) > 0.1


@pytest.mark.parametrize("optimiser", OPTIMISERS, ids=lambda o: o.__name__)
def test_ours_turns_back(optimiser):
    model, _, _ = heavy()
    truth = model.evaluate([1e3]).data
    reduced, counted = problem(model, truth, 8e3)
    found = optimiser(reduced, reduced.unknowns.start, FixedWeights())
    print(optimiser.__name__, found.x, counted.failed)
    assert np.exp(found.x) == pytest.approx([1e3], rel=1e-3)
    assert counted.failed or optimiser not in (l_bfgs, bfgs)


class Unsteady:
    """Data are θ itself; beyond 2 there is an equilibrium, but its tangent is singular."""

    def evaluate(self, theta):
        self.data = theta
        return self

    def gradient(self, w):
        if self.data[0] > 2:
            raise SolverError("equilibrium has no derivative")
        return w

    jvp = vjp = gradient


def test_an_equilibrium_without_a_derivative_is_turned_back_from():
    fields = ParameterFields(np.array([0.5]), {"theta": slice(0, 1)}, {"theta": Unknown(0.5, ScaledTransform(100.0))})
    misfit = LeastSquares(np.array([1.9]), 0.01)
    reduced = Reduced(Unsteady(), misfit, fields, {"theta": ridge(fields.start)}, {"theta": 1e-3})
    for optimiser in (l_bfgs, bfgs):
        found = optimiser(reduced, fields.start, FixedWeights())
        assert fields.theta(found.x) == pytest.approx([1.9], rel=1e-3)


class Lost(Unsteady):
    """Has two solutions and then none: not where it had them before, either."""

    left = 2

    def evaluate(self, theta):
        self.left -= 1
        if self.left < 0:
            raise SolverError("no equilibrium")
        self.data = theta
        return self


def test_a_solution_that_is_lost_is_told():
    """One step of length 1, after which 2e-8 are left to go: halved, nothing."""
    fields = ParameterFields(np.zeros(1), {"theta": slice(0, 1)}, {"theta": Unknown(0.0, ScaledTransform())})
    misfit = LeastSquares(np.array([1 + 3e-8]), 1e-4)
    reduced = Reduced(Lost(), misfit, fields, {"theta": ridge(fields.start)}, {"theta": 1.0})
    with pytest.raises(SolverError, match="no equilibrium"):
        bfgs(reduced, fields.start, FixedWeights())


# A law that grows exponentially, its exponent unknown: a step too far overflows.


def exponential():
    b = ngs.Parameter(5.0)
    body = Problem(
        MESH,
        {".*": Material(Demiray(500.0, b), 2e4)},
        {"bottom": 0},
        [TractionLoad("top", (0, 400.0))],
        element="P2/P1",
    )
    return StaticModel([LoadCase(body, [SEEN])], {"b": b}), body, b


def test_naive_newton_breaks_down_where_the_energy_overflows():
    model, body, b = exponential()
    model.evaluate([1.0])
    b.Set(3e4)
    with np.errstate(all="ignore"):
        try:
            converged = plain_newton(body)
        except Exception:  # the factorisation of NaN
            converged = False
    assert not converged
    with pytest.raises(ConvergenceError):
        model.evaluate([3e4])
    assert np.all(np.isfinite(model.evaluate([5.0]).data))


@pytest.mark.parametrize("optimiser", OPTIMISERS, ids=lambda o: o.__name__)
def test_ours_finds_the_exponent_from_a_five_hundredth(optimiser):
    model, _, _ = exponential()
    truth = model.evaluate([5.0]).data
    reduced, counted = problem(model, truth, 0.01)
    found = optimiser(reduced, reduced.unknowns.start, FixedWeights())
    print(optimiser.__name__, np.exp(found.x), counted.failed)
    assert np.exp(found.x) == pytest.approx([5.0], rel=1e-4)
    assert all(tried > 1e4 for tried in counted.failed)  # where nothing solves; bounded steps need not go there


# Tissue pulled up to a plate, stiffness unknown. On the plate it hardly moves: ln mu changes data by a twentieth of what it does
# off the plate, so a linear step from there is far too long. Naive: 180 and 1160 times the truth, then next to no stiffness and
# no equilibrium. Ours: .01 % off.


def below_a_plate():
    mu = ngs.Parameter(1e3)
    loads = [Plate(0.105, 1e9), TractionLoad("top", (0, 300.0))]
    body = Problem(MESH, {".*": Material(NeoHooke(mu), 2e4)}, {"bottom": 0}, loads, element="P2/P1")
    return StaticModel([LoadCase(body, [SEEN])], {"mu": mu}, tight(body)), body


def touching(body):
    """Share of the top that the plate holds."""
    line = np.linspace(0.01 * SIDE, 0.99 * SIDE, 50)
    return np.mean([SIDE + body.u(body.mesh(x, SIDE * (1 - 1e-8)))[1] > 0.105 for x in line])


def full_steps(reduced, path):
    """Gauss-Newton, every trial accepted; moduli (Pa) are added to the path."""
    x = reduced.unknowns.start
    for _ in range(8):
        path.append(float(np.exp(x[0])))
        point = reduced.evaluate(x)
        x = x - point.gradient() / point.product(np.ones(1))
    return path


SWITCHES = [(1e3, 3e3, 1), (1e4, 2.5e3, 0)]
"""Start and truth (Pa), and whether tissue touches the plate at the start; at the truth it does not."""


@pytest.mark.parametrize(("start", "truth", "touches"), SWITCHES)
def test_naive_full_steps_across_a_contacts_switch(start, truth, touches):
    model, body = below_a_plate()
    reduced, _ = problem(model, model.evaluate([truth]).data, start)
    assert touching(body) == 0
    model.evaluate([start])
    assert touching(body) == touches
    path = []
    with pytest.raises(SolverError):
        full_steps(reduced, path)
    print(path)
    assert max(path) > 100 * truth and path[-1] < 1e-6 * truth


def test_naive_full_steps_arrive_where_the_contact_does_not_switch():
    model, _ = below_a_plate()
    reduced, _ = problem(model, model.evaluate([3e3]).data, 6e3)
    assert full_steps(reduced, [])[-1] == pytest.approx(3e3, rel=1e-4)


@pytest.mark.parametrize(("start", "truth", "touches"), SWITCHES)
def test_ours_crosses_it(start, truth, touches):
    model, body = below_a_plate()
    reduced, counted = problem(model, model.evaluate([truth]).data, start)
    contact, at = [], counted.evaluate

    def watched(theta):
        state = at(theta)
        contact.append(touching(body))
        return state

    counted.evaluate = watched
    found = levenberg_marquardt(reduced, reduced.unknowns.start, FixedWeights())
    print(found.x, contact, len(found.history))
    assert np.exp(found.x) == pytest.approx([truth], rel=1e-4) and found.converged
    assert {touches, 0} <= set(contact)


@pytest.mark.slow
@pytest.mark.parametrize("optimiser", OPTIMISERS, ids=lambda o: o.__name__)
def test_ours_crosses_it_from_a_fifth(optimiser):
    """Where trials fail, too; bounded steps go nowhere near the moduli with which they would."""
    model, _ = below_a_plate()
    reduced, counted = problem(model, model.evaluate([3e3]).data, 600.0)
    found = optimiser(reduced, reduced.unknowns.start, FixedWeights())
    print(optimiser.__name__, np.exp(found.x), counted.failed)
    assert np.exp(found.x) == pytest.approx([3e3], rel=1e-4)
    assert bool(counted.failed) == (optimiser in (bfgs, l_bfgs))


def test_an_absurd_step_leaves_nothing_behind():
    """The tangent of 1e170 Pa, kept, would give corrections whose squares are nothing."""
    model, _ = below_a_plate()
    wanted = model.evaluate([1e4]).data
    model.evaluate([1e170])
    assert model.evaluate([1e4]).data == pytest.approx(wanted, rel=1e-9)


# Fibres that are pressed bear nothing: data of pressed tissue know nothing of them.


def pressed():
    mu, k1 = ngs.Parameter(1e3), ngs.Parameter(2e3)
    supports = {"bottom": (None, 0), "left": (0, None), "top": (None, -0.015)}
    law = HolzapfelGasserOgden(mu, k1, 5.0, 0.0, (0, 1, 0))
    body = Problem(MESH, {".*": Material(law, 2e4)}, supports, element="P2/P1")
    return StaticModel([LoadCase(body, [SEEN, Force("top")])], {"mu": mu, "k1": k1})


def test_what_has_no_influence_is_told_and_not_moved():
    model = pressed()
    there = model.evaluate(model.theta)
    assert there.influence() == {"mu": 1.0, "k1": 0.0}
    fields = ParameterFields(model.theta, model.blocks, {"mu": Unknown(2e3), "k1": Unknown(1e3)})
    misfit = LeastSquares(there.data, 0.01 * np.abs(there.data).max())
    naive = Reduced(model, misfit, fields, {}, {})
    for optimiser in OPTIMISERS:
        with pytest.raises(
            InputError,
            match="k1, which the data do not depend on; wanted: unknowns that they depend on, or a regulariser",
        ):
            optimiser(naive, fields.start, FixedWeights())
    drawn = {name: ridge(fields.start[block]) for name, block in fields.blocks.items()}
    ours = Reduced(model, misfit, fields, drawn, {"mu": 1e-3, "k1": 1e-3})
    found = fields.values(levenberg_marquardt(ours, fields.start, FixedWeights()).x)
    assert found["k1"] == pytest.approx([1e3], rel=1e-12) and found["mu"] == pytest.approx([1e3], rel=1e-3)


# The direction of fibres, from fibres that bear nothing, and from others.


def turned():
    angle = ngs.Parameter(np.radians(70))
    fibre = ngs.CF((ngs.cos(angle), ngs.sin(angle), 0))
    law = HolzapfelGasserOgden(500.0, 2e3, 5.0, 0.0, fibre)
    body = Problem(MESH, {".*": Material(law, 2e4)}, {"bottom": 0, "top": (0, 0.012)}, element="P2/P1")
    return StaticModel([LoadCase(body, [SEEN, Force("top")])], {"angle": angle})


def from_degrees(model, truth, degrees):
    """Where it ends (°), and its value."""
    reduced, _ = problem(model, truth, np.radians(degrees), ScaledTransform())
    try:
        found = levenberg_marquardt(reduced, reduced.unknowns.start, FixedWeights())
    except ConvergenceError:
        return degrees, np.inf
    return float(np.degrees(found.x[0])), found.objective


def test_one_start_of_unloaded_fibres_stands_still_and_several_do_not():
    model = turned()
    truth = model.evaluate(model.theta).data
    assert model.evaluate([0.0]).influence() == {"angle": 0.0}
    ends = {degrees: from_degrees(model, truth, degrees) for degrees in range(0, 180, 30)}
    print(ends)
    assert ends[0][0] == pytest.approx(0, abs=1e-6)
    assert 100 < ends[120][0] < 115 and ends[120][1] > 500  # a local minimum
    best = min(ends.values(), key=lambda end: end[1])
    assert best[0] == pytest.approx(70, abs=0.01)


# Short cuts in the adjoint.


def sheared():
    mu = field(mesh := cube(2), 1e3)
    body = Problem(mesh, {".*": Material(NeoHooke(mu), 5e3)}, {"bottom": 0, "top": (0.01, 0, -0.015)}, element="P2")
    return StaticModel([LoadCase(body, [Displacements([[0.03, 0.04, 0.06], [0.06, 0.05, 0.03]])])], {"mu": mu}), body


def test_the_last_factor_of_newtons_method_alone_is_not_the_adjoints(monkeypatch):
    model, body = sheared()
    there = model.evaluate(model.theta)
    w, each = np.ones(6), model.equilibria[0]
    right = there.gradient(w)
    each.set_weights(np.zeros(each.size))
    each.adjoint.vec.FV().NumPy()[:] = body.last_factor(each.observation_gradient(w))
    naive = each.parameter_gradient()
    off = np.linalg.norm(naive - right) / np.linalg.norm(right)
    monkeypatch.setattr(implicit_solve, "FEW", 0)
    exact = StaticLinearisation(model, there.theta, there.states).gradient(w)
    ours = np.linalg.norm(exact - right) / np.linalg.norm(right)
    print(off, ours)
    assert off > 0.1 and 0 < ours < 1e-9


def test_quadrature_of_the_parameters_own_order_is_not_the_energys():
    model, body = sheared()
    there = model.evaluate(model.theta)
    right, each, mu = there.gradient(np.ones(6)), model.equilibria[0], model.parts["mu"].gfu
    naive = ngs.LinearForm(mu.space)
    for part in each.lagrangian(body.gfu):
        if not (slope := part.derivative(mu, mu.space.TestFunction())).vanishes:
            naive += slope.coef.Compile() * ngs.dx
    naive.Assemble()
    off = np.linalg.norm(naive.vec.FV().NumPy() - right) / np.linalg.norm(right)
    print(off)
    assert off > 0.01
