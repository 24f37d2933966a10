"""Derivatives of equilibria by loads, contact, prescribed displacements; several bodies; what is refused; bugs that are caught."""

import ngsolve as ngs
import numpy as np
import pytest
from equilibria import SIDE, Plate, directions, field, model, seen, tight, verify, weights
from quadrature import coarser
from statics import cube, square

from ngbrain.adjoint.check import dot, taylor
from ngbrain.errors import InputError, InvertedElementError, SolverError
from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import (
    BodyForce,
    CavityPressure,
    CavityVolume,
    FluidPressure,
    PressureLoad,
    RigidBody,
    Spring,
    TractionLoad,
)
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.sensitivity.static_equilibrium import Equilibrium
from ngbrain.forward.sensitivity.static_model import (
    LoadCase,
    NodePositions,
    PrescribedDisplacement,
    StaticLinearisation,
    StaticModel,
)
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke, Ogden

MESH, SOFT = square(2, size=SIDE), NeoHooke(1e3)
PRESSED = {"bottom": 0, "top": (0.006, -0.012)}
CORNER = {"left": (0, None), "bottom": (None, 0)}


def scene(loads, parameters, supports=None, form="P2/P1", of=SOFT, observations=None, **options):
    body = Problem(MESH, {".*": Material(of, 5e4)}, supports or {"bottom": 0}, loads, element=form, **options)
    held = {name: PrescribedDisplacement(body, name) for name in parameters if name in PRESSED}
    return StaticModel([LoadCase(body, observations or seen())], parameters | held, tight(body))


def number(value):
    return ngs.Parameter(value)


def traction():
    pull, push = number(60.0), number(-40.0)
    return scene([TractionLoad("right", ngs.CF((pull, push)))], {"pull": pull, "push": push})


def weight():
    heavy = field(MESH, 900.0)
    varied = heavy * ngs.exp(40 * ngs.x)
    return scene([BodyForce(ngs.CF((0, -varied)))], {"heavy": heavy}, PRESSED, bonus=2)


def spring():
    stiff = field(MESH, 1e5)
    return scene([Spring("right", stiff)], {"stiff": stiff}, PRESSED)


def follower(form):
    hard, mu = field(MESH, 80.0), number(1e3)
    return scene([PressureLoad("top", hard)], {"hard": hard, "mu": mu}, form=form, of=NeoHooke(mu))


def loaded():
    hard, mu = number(60.0), number(1e3)
    seeing = [Force("right"), Force("bottom"), Displacements([[0.09, 0.06]])]
    loads = [PressureLoad("right", hard), BodyForce((0, -500.0)), Spring("right", 2e4)]
    return scene(loads, {"hard": hard, "mu": mu}, of=NeoHooke(mu), observations=seeing)


def turning():
    hard = number(400.0)
    return scene([PressureLoad("right|top", hard)], {"hard": hard}, kinematics=Axisymmetric(), supports=CORNER)


def cavity():
    inner = number(400.0)
    return scene([CavityPressure("right|top", inner)], {"inner": inner}, CORNER)


def filled():
    more, alpha = number(2e-3), number(-6.0)
    return scene([CavityVolume("right|top", more)], {"more": more, "alpha": alpha}, CORNER, of=Ogden(1e3, alpha))


def touched():
    height, hard = number(0.09), number(1e7)
    return scene([Plate(height, hard), TractionLoad("top", (30.0, 60.0))], {"height": height, "hard": hard})


def indented():
    """A ball: its place and how hard it is."""
    height, hard = number(0.147), number(1e6)

    def distance(x, t):
        return ngs.Norm(x - ngs.CF((0.05, height - 0.008 * t))) - 0.05

    return scene([RigidBody("top", distance, hard, 2e-4)], {"height": height, "hard": hard})


def in_fluid():
    """Gravity, a fluid above a level, and swelling; the level stays above the body, as the pressure has a kink there."""
    rho, fluid, level, more = number(1040.0), number(1007.0), number(0.2), number(0.05)
    loads = [BodyForce(ngs.CF((2.0, -9.81)) * rho), FluidPressure((2.0, -9.81), level, density=fluid)]
    body = Problem(MESH, {".*": Material(SOFT, 5e4, swelling=more)}, {"bottom": 0}, loads, element="P2/P1")
    parameters = {"rho": rho, "fluid": fluid, "level": level, "more": more}
    return StaticModel([LoadCase(body, [Force("bottom"), *seen()])], parameters, tight(body))


def driven():
    return scene([], {"top": None, "bottom": None}, PRESSED)


def driven_and_pressed():
    hard = number(60.0)
    return scene([PressureLoad("right", hard)], {"hard": hard, "top": None}, PRESSED, ElementPair(2, 0, False))


SCENES = {
    "traction": traction,
    "weight": weight,
    "spring": spring,
    "follower, displacements": lambda: follower("P2"),
    "follower, mixed": lambda: follower("P2/P1"),
    "follower, condensed": lambda: follower("P4/L2(2)"),
    "force on what is loaded": loaded,
    "of revolution": turning,
    "cavity": cavity,
    "filled": filled,
    "contact": touched,
    "ball": indented,
    "fluid and swelling": in_fluid,
    "prescribed": driven,
    "prescribed and pressed": driven_and_pressed,
}


@pytest.mark.parametrize("make", SCENES.values(), ids=SCENES)
def test_rates_and_transposes(make, rng):
    verify(make(), rng)


@pytest.mark.parametrize("make", SCENES.values(), ids=SCENES)
def test_second_derivatives(make, rng):
    bend(make(), 0.3, rng)


def bend(of, share, rng):
    """Second derivatives are symmetric, and those of the gradient, along ways of a share of θ's size."""
    theta, there = of.theta, of.evaluate(of.theta)
    w = weights(there, rng)
    size = np.concatenate([np.full(b.stop - b.start, np.abs(theta[b]).max() or 1e-2) for b in of.blocks.values()])
    a, b = share * size * rng.uniform(-1, 1, (2, of.size))
    along_a, along_b = there.hvp(w, a), there.hvp(w, b)
    assert dot(along_a, along_b, a, b) < 1e-10
    rates = taylor(lambda t: of.evaluate(t).gradient(w) * size, lambda d: there.hvp(w, d) * size, theta, a, 2)
    assert np.all((rates > 1.9) & (rates < 2.1)), rates


def two():
    """Two loads of one tissue."""
    mu, pull = field(MESH, 1e3), number(70.0)
    tissue = {".*": Material(NeoHooke(mu), 5e4)}
    pressed = Problem(MESH, tissue, PRESSED, element="P2/P1")
    pulled = Problem(MESH, tissue, {"left": 0}, [TractionLoad("right", ngs.CF((pull, 0)))], element="P2/P1")
    cases = [LoadCase(pressed, seen()), LoadCase(pulled, [Force("left"), Displacements([[0.09, 0.04]])])]
    return StaticModel(cases, {"mu": mu, "pull": pull, "top": PrescribedDisplacement(pressed, "top")}, tight(pressed))


def test_two_bodies_share_their_parameters(rng):
    of = two()
    verify(of, rng)
    first, second = of.split(of.evaluate(of.theta).data)
    assert [len(part) for part in first + second] == [4, 2, 1, 2, 2]
    assert second[0] == pytest.approx([-7.0, 0.0], abs=1e-7)


def test_observations_are_what_they_say():
    of = model(NeoHooke, form="P2/P1")
    body = of.equilibria[0].body
    ((u, force, swelling),) = of.split(of.evaluate(of.theta).data)
    points = SIDE * np.array([[0.31, 0.52], [0.7, 0.83]])
    assert u.reshape(2, 2) == pytest.approx(np.array([body.u(body.mesh(*point)) for point in points]))
    assert force == pytest.approx(body.force("bottom")) and force[1] > 0
    J = ngs.Det(body.kinematics.gradient(body.u, ngs.Grad(body.u)))
    wanted = ngs.Integrate((J - 1) ** 2 * ngs.InnerProduct(body.u, body.u), body.mesh, order=4)
    assert swelling == pytest.approx([wanted], rel=1e-3)
    twist = Force("top", motions=[ngs.CF((-ngs.y, ngs.x))])
    mine = StaticModel([LoadCase(body, [twist])], {"none": number(0.0)})
    assert mine.evaluate(mine.theta).data == pytest.approx([body.conjugate(ngs.CF((-ngs.y, ngs.x)), "top")])


# Where nodes are.


def shaped(dim, form):
    """Tissue whose nodes are unknown beside its stiffness, under loads of all kinds."""
    mesh = square(2, size=SIDE) if dim == 2 else cube(1, size=SIDE)
    nodes, mu = NodePositions(mesh), field(mesh, 1e3)
    nodes.set_value(2e-3 * np.random.default_rng(4).uniform(-1, 1, nodes.size))
    still = (0.0,) * (dim - 2)
    loads = [
        PressureLoad("right", 40.0),
        TractionLoad("top", (20.0, *still, 5.0)),
        BodyForce((0.0, *still, -3e3 * ngs.x)),
    ]
    body = Problem(mesh, {".*": Material(NeoHooke(mu), 5e3)}, {"bottom": 0}, loads, element=form)
    return StaticModel([LoadCase(body, seen(dim))], {"nodes": nodes, "mu": mu}, tight(body))


@pytest.mark.parametrize(("dim", "form"), [(2, "P2"), (2, "P2/P1"), (3, "P2")])
def test_nodes(dim, form, rng):
    verify(shaped(dim, form), rng)


@pytest.mark.parametrize(("dim", "form"), [(2, "P2"), (2, "P2/P1"), (3, "P2")])
def test_second_derivatives_by_nodes(dim, form, rng):
    bend(shaped(dim, form), 0.15, rng)


def test_nodes_that_turn_an_element_are_refused():
    of = shaped(2, "P2")
    theta = of.theta
    there = of.evaluate(theta)
    with pytest.raises(InvertedElementError, match="invert an element"):
        of.evaluate(theta * np.where(np.arange(of.size) < 18, 100.0, 1.0))
    assert of.evaluate(theta).data == pytest.approx(there.data, rel=1e-9)
    with pytest.raises(InputError, match="mesh is deformed already"):
        NodePositions(of.parts["nodes"].mesh)


# What is refused.


def test_bad_input():
    mesh = square(2, size=SIDE)
    mu = field(mesh, 1e3)
    body = Problem(mesh, {".*": Material(NeoHooke(mu), 5e3)}, PRESSED, element="P2")
    case = LoadCase(body, [Force("top")])
    with pytest.raises(InputError, match=r"parameters\.mu is complex; wanted: a real field"):
        StaticModel([case], {"mu": ngs.GridFunction(ngs.H1(mesh, complex=True))})
    with pytest.raises(
        InputError, match=r"parameters\.mu is float; wanted: a GridFunction, a Parameter, PrescribedDisplacement"
    ):
        StaticModel([case], {"mu": 3.0})
    with pytest.raises(InputError, match="boundary is 'top'; wanted: a boundary with a prescribed component"):
        PrescribedDisplacement(Problem(MESH, {".*": Material(SOFT, 5e3)}, {"bottom": 0}, element="P2"), "top")
    with pytest.raises(InputError, match="boundary"):
        PrescribedDisplacement(body, "nowhere")
    with pytest.raises(InputError, match=r"theta is of shape \(3,\); wanted: 9 numbers"):
        StaticModel([case], {"mu": mu}).evaluate(np.ones(3))
    with pytest.raises(InputError, match="1 of 1 outside"):
        StaticModel([LoadCase(body, [Displacements([[1.0, 1.0]])])], {"mu": mu})
    depth = number(0.01)
    moved = Problem(mesh, {".*": Material(NeoHooke(mu), 5e3)}, {"bottom": 0, "top": (0, -depth)}, element="P2")
    with pytest.raises(
        InputError,
        match=r"parameters.depth is part of the support of 'top'; wanted: PrescribedDisplacement\(body, 'top'\)",
    ):
        StaticModel([LoadCase(moved, [Force("top")])], {"depth": depth})


def test_a_step_too_far_is_a_solver_error_and_the_model_lives_on(rng):
    of = driven()
    theta = of.theta
    before = of.evaluate(theta)
    w = weights(before, rng)
    wanted, through = before.gradient(w), theta.copy()
    through[of.blocks["top"]] *= 10  # the top below the bottom
    for far in (np.full(of.size, np.nan), np.full(of.size, np.inf), through):
        with pytest.raises(SolverError):
            of.evaluate(far)
    assert before.gradient(w) == pytest.approx(wanted, rel=1e-9, abs=1e-9 * np.abs(wanted).max())
    assert of.evaluate(theta).data == pytest.approx(before.data, rel=1e-9)


def test_far_parameters_are_reached_by_steps_between(monkeypatch):
    of, tried = driven(), []
    along = Equilibrium._continue
    monkeypatch.setattr(
        Equilibrium, "_continue", lambda self, put, x: along(self, lambda s: (tried.append(s), put(s)), x)
    )
    theta = of.theta
    of.evaluate(theta)
    far = of.evaluate(4.5 * theta)
    assert len(tried) > 2 and tried[-1] == 1
    assert far.data == pytest.approx(driven().evaluate(4.5 * theta).data, rel=1e-8, abs=1e-10)


# Each bug is one that can be met; rates of a right derivative are above 1.9.


def stale_factor(patch):
    solved = StaticLinearisation._solved

    def wrong(self, w):
        self._inverses[0] = self.model.evaluate(1.05 * self.theta)._inverse(0)
        self._inverses[0].solve(self.states[0])
        return solved(self, w)

    patch.setattr(StaticLinearisation, "_solved", wrong)


def prescribed_forgotten(patch):
    patch.setattr(StaticLinearisation, "_add_prescribed", lambda self, k, total, left: None)


def coarser_gradient(patch):
    parameter_gradient = Equilibrium.parameter_gradient.func

    def wrong(self):
        right, self.body.tissue.rules = self.body.tissue.rules, coarser(self.body.tissue.rules)
        found = parameter_gradient(self)
        self.body.tissue.rules = right
        return found

    patch.setattr(Equilibrium, "parameter_gradient", property(wrong))


def reversed_sign(patch):
    solved = StaticLinearisation._solved
    patch.setattr(StaticLinearisation, "_solved", lambda self, w: [-adjoint for adjoint in solved(self, w)])


def observation_forgotten(patch):
    """∂B/∂θ: the tissue that a force is measured through."""
    functional = Equilibrium.lagrangian

    def wrong(self, state, *along):
        parts = functional(self, state, *along)
        return (
            parts[sum(len(seen.functional(state)) for seen in self.observables) :] if state is self.body.gfu else parts
        )

    patch.setattr(Equilibrium, "lagrangian", wrong)


def not_transposed(patch):
    patch.setattr(
        "ngbrain.forward.sensitivity.tangent_inverse.TangentInverse.solve_transpose", lambda self, r: self.solve(r)
    )


BUGS = {
    stale_factor: (lambda: model(NeoHooke, form="P3"), "mu"),
    prescribed_forgotten: (driven, "top"),
    coarser_gradient: (lambda: model(NeoHooke, form="P3"), "mu"),
    reversed_sign: (lambda: model(NeoHooke), "mu"),
    observation_forgotten: (lambda: model(NeoHooke), "mu"),
    not_transposed: (lambda: follower("P2"), "mu"),
}


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.__name__)
def test_a_bug_lowers_the_rate(bug, monkeypatch, rng):
    make, block = BUGS[bug]

    def rates():
        of = make()
        theta = of.theta
        there = of.evaluate(theta)
        random = np.random.default_rng(1)
        w, direction = weights(there, random), dict(directions(of, random))[block]
        return taylor(lambda t: float(w @ of.evaluate(t).data), there.gradient(w), theta, direction, steps=7)

    assert rates()[-1] > 1.9
    bug(monkeypatch)
    assert rates()[-1] < 1.2


def test_laws_and_cases_without_sense_are_refused():
    mesh = square(1, size=SIDE)

    def made(law):
        return Problem(mesh, {".*": Material(law, 4e3)}, {"bottom": 0}, element="P2")

    with pytest.raises(InputError, match=r"law is .*object.*wanted: an object with `energy\(C\)`"):
        made(object())
    with pytest.raises(InputError, match=r"Strained\.energy is of 9 components"):
        made(type("Strained", (), {"energy": lambda self, C: C})())
    with pytest.raises(InputError, match=r"materials\['\.\*'\]\.law is of a shear modulus at rest of 0 Pa"):
        made(type("Nothing", (), {"energy": lambda self, C: 0 * ngs.Trace(C)})())
    mu = ngs.Parameter(1e3)
    body = made(NeoHooke(mu))
    with pytest.raises(InputError, match="cases is without observables"):
        StaticModel([LoadCase(body, [])], {"mu": mu})
    with pytest.raises(InputError, match=r"points is of shape \(1, 3\); wanted: \(n, 2\)"):
        StaticModel([LoadCase(body, [Displacements(np.ones((1, 3)))])], {"mu": mu})
    there = StaticModel([LoadCase(body, [Force("bottom")])], {"mu": mu}).evaluate(np.array([1e3]))
    for product in (there.gradient, there.vjp):
        with pytest.raises(InputError, match=r"w is of shape \(3,\); wanted: \(2,\)"):
            product(np.ones(3))


@pytest.mark.parametrize("kind", ["a field", "a field beside a number", "a number"])
def test_laws_keep_their_parameters_where_they_like(kind):
    """In slots or in a closure: the modulus at rest is that of the energy, not of what is seen of the object."""
    mesh = square(2, size=SIDE)
    mu = ngs.Parameter(1e3) if kind == "a number" else field(mesh, 1e3 if kind == "a field" else 800.0)
    whole = 200 + mu if kind == "a field beside a number" else mu

    class Closed:
        __slots__ = ()

        def energy(self, C):
            return whole / 2 * (ngs.Trace(C) - 3)

    slopes = []
    for law in (Closed(), NeoHooke(whole)):
        body = Problem(mesh, {".*": Material(law, 4e3)}, {"bottom": 0, "top": (0.006, -0.012)}, element="P2")
        of = StaticModel([LoadCase(body, [Force("top")])], {"mu": mu}, tight(body))
        slopes.append((body.ratio, of.evaluate(of.theta).gradient(np.ones(2))))
    assert slopes[0][0] == pytest.approx(slopes[1][0], rel=1e-12) and slopes[0][0] < 5
    assert slopes[0][1] == pytest.approx(slopes[1][1], rel=1e-9)
