"""Waves in bodies that are deformed already: at rest those of `HarmonicProblem`, and Taylor rates of all that they depend on."""

import ngsolve as ngs
import numpy as np
import pytest
from equilibria import LAWS, SIDE, directions, field, pulled_both_ways, tight
from ngsolve.meshes import MakeStructured2DMesh
from statics import cube, square

from ngbrain.adjoint.check import dot, taylor
from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import InputError, SolverError
from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import BodyForce, CavityVolume, PressureLoad, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY, WaveModel
from ngbrain.forward.sensitivity.static_model import NodePositions, PrescribedDisplacement
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import ParameterFields, ScaledTransform, Unknown
from ngbrain.materials import Branch, NeoHooke, Ogden, Shearing, Viscous
from ngbrain.solvers.device import CPU, Device

POINTS = SIDE * np.array([[0.31, 0.52, 0.4], [0.7, 0.83, 0.6]])


def ogden(p):
    return Ogden(p("mu", 1e3), p("alpha", -5.0))


neo_hooke = LAWS[NeoHooke]
CASES = {
    "displacements": (neo_hooke, "P2"),
    "continuous pressure": (ogden, "P2/P1"),
    "condensed pressure": (neo_hooke, ElementPair(2, 0, False)),
}


def waves(dim=2):
    """Of two frequencies; their supports do not move in phase."""
    still = [0.0] * (dim - 2)
    return [Wave(30.0, {"top": (1e-6, 2e-7j, *still)}), Wave(45.0, {"top": (0, 1e-6 + 1e-6j, *still)})]


def model(law=ogden, form="P2/P1", load=TractionLoad, mesh=None, held=None, nodes=False):
    """A square (or another mesh) pressed, sheared and loaded: all that it is made of are fields but for some numbers."""
    mesh = mesh or square(2, size=SIDE)
    parameters = {"nodes": NodePositions(mesh)} if nodes else {}

    def parameter(name, value):
        number = name.startswith(("alpha", "k2", "load"))
        parameters[name] = ngs.Parameter(value) if number else field(mesh, value)
        return parameters[name]

    bulk = parameter("bulk", 4e3 if "/" not in str(form) else 5e4)
    pushed, down = parameter("load", 150.0), (0.006, *[0.002] * (mesh.dim - 2), -0.012)
    acting = load("right", pushed if load is PressureLoad else (pushed, *[0.5 * pushed] * (mesh.dim - 1)))
    body = Problem(mesh, {".*": Material(law(parameter), bulk)}, {"bottom": 0, "top": down}, [acting], element=form)
    parameters["top"] = PrescribedDisplacement(body, "top")
    loss, rho = parameter("loss", 0.2), parameter("rho", 1e3)
    about = HarmonicProblem.about(body, waves(mesh.dim), loss=loss, density=rho, dirichlet=held)
    return WaveModel(about, parameters, POINTS[:, : mesh.dim], tight(body))


def relaxing():
    """A body with a memory."""
    tissue = Material(Viscous(NeoHooke(400.0), (Branch(NeoHooke(600.0), 1.0),)), 5e4)
    return Problem(square(1, size=SIDE), {".*": tissue}, {"bottom": 0}, element="P2/P1")


def weights(there, rng):
    """At random, so that all data count."""
    return (rng.normal(size=there.data.shape) + 1j * rng.normal(size=there.data.shape)) / np.abs(there.data).max()


def verify(of, rng, names=None):
    """J has rates of 2 along each block, Jᵀ by matrices is its transpose and the same as by forms."""
    theta = of.theta
    there = of.evaluate(theta)
    w = weights(there, rng)
    pulled = pulled_both_ways(of, there, w)
    for name, direction in directions(of, rng):
        change = there.jvp(direction)
        assert dot(change, pulled, direction, w) < 1e-10, name
        if name == BOUNDARY:  # waves are linear in it
            moved = of.evaluate(theta + direction).data - there.data
            assert moved == pytest.approx(change, abs=1e-9 * np.abs(change).max())
        elif names is None or name in names:
            rates = taylor(lambda t: of.evaluate(t).data, lambda _: change, theta, direction, 2)  # noqa: B023
            assert np.all((rates > 1.9) & (rates < 2.1)), (name, rates)


@pytest.mark.parametrize(("law", "form"), CASES.values(), ids=CASES)
def test_rates_and_transposes(law, form, rng):
    """By μ and K, α, a load, what is prescribed, loss and density."""
    of = model(law, form)
    assert {"mu", "load", "top", "loss", "rho", "bulk"} <= set(of.blocks)
    verify(of, rng)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_every_law(law, rng):
    verify(model(LAWS[law]), rng)


def test_a_pressure_that_follows(rng):
    """Its tangent is not symmetric where its rim is free, nor is the waves' matrix."""
    of = model(neo_hooke, load=PressureLoad, held="top")
    verify(of, rng, {"load", "mu"})
    A = of.evaluate(of.theta).factors.matrix(0)[~of.body.fixed][:, ~of.body.fixed]
    assert abs(A - A.T).max() > 1e-3 * abs(A).max()


@pytest.mark.parametrize("form", ["P2", "P2/P1"])
def test_where_nodes_are(form, rng):
    """Rates of 2 where nodes move by a twentieth of the side."""
    of = model(neo_hooke, form, nodes=True)
    there, direction = of.evaluate(of.theta), np.zeros(of.size)
    block, w = of.blocks["nodes"], weights(there, rng)
    direction[block] = SIDE / 20 * rng.normal(size=block.stop - block.start)
    change = there.jvp(direction)
    assert dot(change, pulled_both_ways(of, there, w), direction, w) < 1e-10
    rates = taylor(lambda t: of.evaluate(t).data, lambda _: change, of.theta, direction, 2)
    assert np.all((rates > 1.9) & (rates < 2.1)), rates


def test_space(rng):
    verify(model(neo_hooke, "P2", mesh=cube(1, size=SIDE)), rng, {"mu", "load"})


def test_waves_may_be_held_elsewhere(rng):
    """What stands still in equilibrium may swing, and the other way round."""
    of = model(neo_hooke, held={"x": "top|left", "y": "top"})
    there, left, bottom = of.evaluate(of.theta), SIDE * np.array([0.0, 0.4]), SIDE * np.array([0.4, 0.0])
    u, mesh = there.displacement(0), of.body.mesh
    across, along = map(abs, u(mesh(*left)))
    assert across < 1e-9 * along
    assert abs(u(mesh(*bottom))[1]) > 1e-8 and of.body.state.body.u(mesh(*bottom)) == pytest.approx((0, 0))
    assert u(mesh(0.05, SIDE)) == pytest.approx((1e-6, 2e-7j))
    verify(of, rng, {"mu"})


def test_around_an_axis(rng):
    mesh, mu = square(2, size=SIDE), ngs.Parameter(1e3)
    rollers = {"bottom": (None, 0), "left": (0, None), "top": (None, 0)}
    sinking, around = [BodyForce((0.0, -2e3))], Axisymmetric()
    body = Problem(mesh, {".*": Material(NeoHooke(mu), 5e4)}, rollers, sinking, element="P2/P1", kinematics=around)
    about = HarmonicProblem.about(body, [Wave(20.0, {"top": (0, 1e-6)})], loss=0.1)
    verify(WaveModel(about, {"mu": mu}, POINTS[:, :2]), rng)


def test_a_cavity_keeps_its_volume(rng):
    """Its pressure is one more unknown, which waves change."""
    ring = MakeStructured2DMesh(
        False,
        2,
        2,
        mapping=lambda r, a: ((1 + r) * SIDE / 4 * np.cos(a * np.pi / 2), (1 + r) * SIDE / 4 * np.sin(a * np.pi / 2)),
    )
    mu = ngs.Parameter(1e3)
    body = Problem(
        ring,
        {".*": Material(NeoHooke(mu), 5e4)},
        {"bottom": (None, 0), "top": (0, None)},
        [CavityVolume("left", 1e-4)],
        element="P2/P1",
    )
    swinging = [Wave(20.0, {"right": (1e-6, 5e-7j)})]
    held = {"x": "top|right", "y": "bottom|right"}
    of = WaveModel(
        HarmonicProblem.about(body, swinging, loss=0.1, dirichlet=held), {"mu": mu}, SIDE * np.array([[0.25, 0.25]])
    )
    verify(of, rng)
    assert abs(of.evaluate(of.theta).waves[0, -1]) > 0


@pytest.mark.parametrize("form", ["P2", "P2/P1"])
def test_at_rest_they_are_harmonic_waves(form):
    mesh = square(3, size=SIDE)
    mu = field(mesh, 2e3)
    body = Problem(mesh, {".*": Material(NeoHooke(mu), 1e4)}, {"bottom": 0, "top": 0}, element=form)
    rest = HarmonicProblem.about(body, waves(), loss=0.3, density=1100.0).solve()
    settings = {"bulk": 1e4, "density": 1100.0, "form": form, "dirichlet": "bottom|top"}
    harmonic = HarmonicProblem(mesh, Shearing(mu * (1 + 0.3j)), waves(), **settings).solve()
    for found, wanted in zip(rest, harmonic, strict=True):
        found, wanted = found.vec.FV().NumPy()[: len(body.fixed)], wanted.vec.FV().NumPy()[: len(body.fixed)]
        assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()


def test_a_misfit_of_them(rng):
    """Its gradient has rates of 2, by the interface that optimisers know."""
    of = model(neo_hooke)
    theta = of.theta
    data = 1.3 * of.evaluate(theta).data
    unknowns = ParameterFields(theta, of.blocks, {"mu": Unknown(theta[of.blocks["mu"]], ScaledTransform())})
    reduced = Reduced(of, LeastSquares(data, 0.1 * np.abs(data).max()), unknowns, {}, {})
    x = unknowns.start
    direction = rng.uniform(-1, 1, len(x)) * np.abs(x).max()
    rates = taylor(reduced.value, reduced.evaluate(x).gradient(), x, direction, 2)
    assert np.all((rates > 1.9) & (rates < 2.1)), rates
    rates = taylor(
        lambda x: reduced.evaluate(x).gradient(), lambda d: reduced.evaluate(x).hessian(d), x, 0.3 * direction, 2
    )
    assert np.all((rates > 1.9) & (rates < 2.1)), rates


@pytest.mark.parametrize("load", [TractionLoad, PressureLoad], ids=lambda load: load.__name__)
@pytest.mark.parametrize(
    ("law", "form"),
    [
        *((neo_hooke, form) for form in ("P2", "P2/P1", ElementPair(2, 0, False))),
        pytest.param(ogden, "P2/P1", marks=pytest.mark.slow),
    ],
)
def test_second_derivatives(law, form, load, rng):
    """They are symmetric, and those of the gradient; with a pressure that follows, matrices are not."""
    bend(model(law, form, load, held="top" if load is PressureLoad else None), rng)


@pytest.mark.parametrize(
    "load", [TractionLoad, pytest.param(PressureLoad, marks=pytest.mark.slow)], ids=lambda load: load.__name__
)
def test_second_derivatives_by_nodes(load, rng):
    bend(model(neo_hooke, "P2/P1", load, held="top" if load is PressureLoad else None, nodes=True), rng)


def bend(of, rng):
    theta = of.theta
    there = of.evaluate(theta)
    sizes = {name: np.abs(theta[b]).max() or 0.02 * SIDE for name, b in of.blocks.items()}
    w, size = weights(there, rng), np.concatenate([np.full(b.stop - b.start, sizes[n]) for n, b in of.blocks.items()])
    a, b = 0.3 * size * rng.uniform(-1, 1, (2, of.size))
    along_a, along_b = there.hvp(w, a), there.hvp(w, b)
    assert dot(along_a, along_b, a, b) < 1e-10
    rates = taylor(lambda t: of.evaluate(t).gradient(w) * size, lambda d: there.hvp(w, d) * size, theta, a, 2)
    assert np.all((rates > 1.9) & (rates < 2.1)), rates


def test_a_state_of_before_keeps_its_derivatives(rng):
    of = model(neo_hooke)
    theta = of.theta
    first = of.evaluate(theta)
    w, direction = weights(first, rng), theta * rng.uniform(-1, 1, len(theta))
    wanted = first.gradient(w), first.jvp(direction)
    fresh, second = of.evaluate(theta), of.evaluate(1.05 * theta)
    second.gradient(w)
    for found, was in zip((fresh.gradient(w), fresh.jvp(direction)), wanted, strict=True):
        assert found == pytest.approx(was, rel=1e-8, abs=1e-9 * np.abs(was).max())


def test_solves_are_counted(rng):
    of = model(neo_hooke)
    there = of.evaluate(of.theta)
    made, w = of.solves.factorisations, weights(there, rng)
    assert of.solves.forward == 3 and made >= 3  # one equilibrium and two waves
    there.gradient(w)
    assert (of.solves.factorisations, of.solves.adjoint, of.solves.incremental) == (made + 1, 3, 0)
    there.jvp(of.theta)
    assert (of.solves.factorisations, of.solves.adjoint, of.solves.incremental) == (made + 1, 3, 3)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"waves": []}, "waves"),
        ({"waves": [Wave(30.0, {"top": (1e-6, 0, 0)})]}, "Wave"),
        ({"waves": [Wave(30.0, {"left": (1e-6, 0)})]}, "Wave.displacement"),
        ({"dirichlet": {"z": "top"}}, "dirichlet"),
        ({"loss": -0.1}, "loss"),
        ({"density": 0.0}, "density"),
        ({"body": relaxing()}, "body"),
    ],
)
def test_what_makes_no_sense(changes, named):
    mesh = square(1, size=SIDE)
    body = Problem(mesh, {".*": Material(NeoHooke(1e3), 5e4)}, {"bottom": 0, "top": (0, -0.01)}, element="P2/P1")
    given = {"body": body, "waves": waves()} | changes
    with pytest.raises(InputError, match=f"^{named} is"):
        HarmonicProblem.about(**given)


def test_a_pressure_that_follows_is_refused_by_a_gpu():
    of = model(neo_hooke, load=PressureLoad, held="top").body
    with pytest.raises(InputError, match="follower"):
        HarmonicProblem.about(of.state.body, of.waves, device=Device("cuda", CPU.make))


@pytest.mark.parametrize("load", [TractionLoad, PressureLoad])
def test_a_resonance_without_loss_is_said(load):
    """A body that nothing holds, pushed evenly."""
    of = model(neo_hooke, load=load).body
    with pytest.raises(SolverError, match="resonance"):
        HarmonicProblem.about(of.state.body, [Wave(0.0, traction={"top": (1.0, 0)})], dirichlet={}).solve()


@pytest.mark.parametrize("form", ["P2", "P2/P1"])
def test_a_small_traction_at_rest_is_a_little_more_load(form):
    """At 0 Hz waves are how the equilibrium changes with a dead load."""
    mesh, more = square(2, size=SIDE), ngs.Parameter(0.0)
    loads = [TractionLoad("right", (150.0 + more, 80.0))]
    body = Problem(mesh, {".*": Material(NeoHooke(1e3), 4e3)}, {"bottom": 0}, loads, element=form)
    equilibria = []
    for push in (-1.0, 1.0, 0.0):
        more.Set(push)
        body.invalidate_tangent()
        LoadPath(body).solve(newton=tight(body))
        equilibria.append(body.x)
    found = HarmonicProblem.about(body, [Wave(0.0, traction={"right": (2.0, 0.0)})]).solve()[0].vec.FV().NumPy()
    wanted = equilibria[1] - equilibria[0]
    n = len(body.fixed)
    assert np.abs(found[:n] - wanted[:n]).max() < 1e-5 * np.abs(wanted[:n]).max()
    rest = HarmonicProblem(
        mesh, Shearing(1e3), [Wave(0.0, traction={"right": (2.0, 0.0)})], bulk=4e3, form=form, dirichlet="bottom"
    )
    assert np.abs(rest.solve()[0].vec.FV().NumPy()[:n] - wanted[:n]).max() > 0.05 * np.abs(wanted[:n]).max()


def pressed_by_a_plate(depth=1e-3, share=0.9, element="P2/P1"):
    """A square that a plate presses on its right with an offset, clamped at its bottom; the plate's place is a parameter."""
    way = ngs.Parameter(depth)
    plate = RigidContact("right", lambda x: SIDE - way - x[0], 1e6, 1e-5, share)
    mu = field(square(2, size=SIDE), 1e3)
    mesh = mu.space.mesh
    body = Problem(mesh, {".*": Material(NeoHooke(mu), 2e4)}, {"bottom": 0}, contacts=[plate], element=element)
    return body, {"mu": mu, "way": way}


def test_waves_in_a_body_in_contact_have_their_rates(rng):
    """The contact is frozen: it resists what presses on the plate, as its tangent says."""
    body, parameters = pressed_by_a_plate()
    still = [Wave(30.0, {"bottom": (1e-6, 2e-7j)})]
    of = WaveModel(HarmonicProblem.about(body, still, loss=0.2), parameters, POINTS[:, :2], tight(body))
    verify(of, rng)


def test_at_rest_they_are_how_its_equilibrium_changes():
    body, parameters = pressed_by_a_plate()
    move = 1e-7
    of = WaveModel(
        HarmonicProblem.about(body, [Wave(1e-3, {"bottom": (move, 0)})]), parameters, POINTS[:, :2], tight(body)
    )
    found = of.evaluate(of.theta).data.real[0]
    states = []
    for share in (0.0, 1e3):  # by as much more
        other, _ = pressed_by_a_plate()
        other.prescribed[:] = 0
        pushed = Problem(
            other.mesh, other.materials, {"bottom": (share * move, 0)}, contacts=other.contacts, element="P2/P1"
        )
        LoadPath(pushed).solve(newton=tight(pushed))
        states.append(np.array([pushed.u(pushed.mesh(*point)) for point in POINTS[:, :2]]))
    wanted = (states[1] - states[0]) / 1e3
    assert found == pytest.approx(wanted, abs=0.02 * np.abs(wanted).max())
    free, _ = pressed_by_a_plate(depth=-1e-3)  # a plate that does not touch lets all of it go along
    gone = WaveModel(
        HarmonicProblem.about(free, [Wave(1e-3, {"bottom": (move, 0)})]), {"mu": parameters["mu"]}, POINTS[:, :2]
    )
    assert gone.evaluate(gone.theta).data.real[0][:, 0] == pytest.approx(move, rel=1e-6)
    assert np.abs(found[:, 0] - move).max() > 0.1 * move
