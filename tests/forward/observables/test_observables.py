"""Observables of a state: values against closed forms, gradients by Taylor tests, and as data of models."""

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh
from relaxing_blocks import GRID, SIDE, directions, loaded, relaxing, touched, weights

from ngbrain.adjoint.check import dot, taylor
from ngbrain.errors import InputError
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import BodyForce, PressureLoad, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.observables import (
    ContactArea,
    ContactForce,
    CurrentArea,
    Displacements,
    Force,
    Functional,
    Moment,
    NormalForce,
    Observable,
    Patch,
    Ratio,
    SolutionUnknowns,
    StrainEnergy,
    StrainPercentile,
    StressPercentile,
    WallIntegral,
    WallPass,
    mean_depth,
    patch_pressure,
    region_volume,
)
from ngbrain.forward.observables.base import LinearObservable
from ngbrain.forward.observables.percentiles import ProblemPercentile
from ngbrain.forward.observables.ratio import Quotient
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticModel
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.advance import newton_for
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import Branch, NeoHooke, Ogden, Viscous
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive

SQUASHED = -0.08
SWELLING = Functional(lambda at: (ngs.Det(at.F) - 1) ** 2 * at.dx(".*"), name="swelling", unit="m³")


def cube(acting=(), contacts=(), element="P2/P1", mesh=None):
    """Pressed between a base that holds and a top that does not slide."""
    mesh = block((SIDE,) * 3, SIDE / 2) if mesh is None else mesh
    law = Material(Ogden(1e3, -8.0), 2e4)
    body = Problem(mesh, {".*": law}, {"bottom": 0, "top": (0, 0, SQUASHED * SIDE)}, acting, contacts, element)
    LoadPath(body).solve()
    return body


def pressed_and_loaded():
    soft = RigidContact("left", lambda x: x[0] + SIDE / 100, 1e6, 2e-4, 0.9)
    return cube([TractionLoad("right", (60.0, 0, 0)), BodyForce((0, -2e4, 0))], [soft])


def flat(kinematics, quads=False):
    mesh = MakeStructured2DMesh(quads=quads, nx=4, ny=4, mapping=lambda x, y: (SIDE * x, SIDE * y))
    law = Material(NeoHooke(1e3), 5e3)
    supports = {"bottom": 0, "top": (0, SQUASHED * SIDE)}
    body = Problem(
        mesh,
        {".*": law},
        supports,
        [PressureLoad("right", 200.0)],
        element="Q2" if quads else "P2",
        kinematics=kinematics,
    )
    LoadPath(body).solve()
    return body


BODIES = {
    "space": cube,
    "loads and contact": pressed_and_loaded,
    "condensed": lambda: cube(element="P4/L2(2)"),
    "hexahedra": lambda: cube(
        element="Q2/L2(1)",
        mesh=MakeStructured3DMesh(hexes=True, nx=2, ny=2, nz=2, mapping=lambda x, y, z: (SIDE * x, SIDE * y, SIDE * z)),
    ),
    "plane strain": lambda: flat(None),
    "axisymmetric": lambda: flat(Axisymmetric(), quads=True),
}
FORCES = {"foot": Force("bottom"), "side": Force("right"), "all round": Force("bottom|right")}
OTHERS = {
    "strain": StrainPercentile(70, band=0.2),
    "small": StrainPercentile(100, band=0.3, measure="small", factor=2.0),
    "octahedral": StrainPercentile(60, band=0.3, measure="octahedral"),
    "stress": StressPercentile(70, band=0.2),
    "energy": StrainEnergy(),
    "volume": region_volume(),
    "swelling": SWELLING,
    "mean": Ratio(SWELLING, region_volume(), "mean swelling"),
}


@pytest.fixture(scope="module", params=BODIES)
def body(request):
    return BODIES[request.param]()


def moved(body, rng, size):
    """A motion of the free unknowns, displacements by so much (m), pressures by so many parts of the modulus."""
    each = np.where(body.is_u[: body.fes.ndof], size, 0.0)
    if body.p is not None:
        each[body.fes.Range(1).start : body.fes.Range(1).stop] = size / SIDE * 1e3
    return each * rng.normal(size=len(each)) * (body.weights > 0)


def ranks(observed, x):
    """Points by their strain."""
    observed.problem.x = x
    return np.argsort(observed.values())


@pytest.mark.parametrize(
    "asked", [*FORCES.values(), *OTHERS.values(), Moment], ids=lambda a: getattr(a, "name", "moment")
)
def test_gradients_pass_taylors_test(asked, body, rng):
    if asked is Moment:
        middle = (SIDE / 2,) * body.mesh.dim
        asked = Moment("bottom", middle, *([] if body.mesh.dim == 2 else [(0.3, 0.1, 1.0)]))
    observed, rest = asked.on(body), body.x
    x, first = rest + moved(body, rng, 1e-3 * SIDE), 0.1  # no two points have the same strain by symmetry
    w, dx = rng.normal(size=observed.size), moved(body, rng, 1e-3 * SIDE)
    while isinstance(observed, ProblemPercentile) and not np.array_equal(
        *(ranks(observed, x + s * dx) for s in (0, first))
    ):
        first /= 2

    def value(at):
        body.x = at
        return float(w @ observed.value())

    body.x = x
    gradient = observed.gradient(w)
    rates = taylor(value, gradient, x, dx, first=first, steps=3)
    body.x = x
    assert asked.gradient(body, weights=w) == pytest.approx(gradient, rel=1e-12, abs=1e-12 * np.abs(gradient).max())
    body.x = rest
    print(asked.name, first, rates)
    assert rates[-1] == pytest.approx(2, abs=0.1), rates


def test_a_contact_counted_as_tissue_fails_it(rng, monkeypatch):
    from ngbrain.forward.observables.force import Reaction

    monkeypatch.setattr(Reaction, "own_stiffness", lambda self, motion: 0 * motion)
    body = pressed_and_loaded()
    observed, x = Force("left").on(body), body.x

    def value(at):
        body.x = at
        return float(observed.value().sum())

    rates = taylor(value, observed.gradient(np.ones(3)), x, moved(body, rng, 1e-3 * SIDE), first=0.1)
    assert rates[-1] < 1.5


def test_forces_and_moments_balance_loads_in_closed_form():
    """A block that stands on its foot, pushed at one side: the foot bears force and moment of the push and the weight."""
    push, heavy, r = 40.0, 3e4, np.array([0.0, 0.0, 0.0])
    mesh = block((SIDE,) * 3, SIDE / 2)
    body = Problem(
        mesh, {".*": Material(NeoHooke(5e4), 2e5)}, {"bottom": 0}, [TractionLoad("right", (0, push, 0)), BodyForce((0, 0, -heavy))],
        element="P2",
    )  # fmt: skip
    LoadPath(body).solve()
    force = Force("bottom").value(body)
    assert force == pytest.approx([0, -push * SIDE**2, heavy * SIDE**3], abs=1e-8)
    # Of what is deformed: arms are those of rest, so the moments are off by what the block bends.
    moments = [Moment("bottom", r, axis).value(body)[0] for axis in np.eye(3)]
    arm, half = push * SIDE**3, SIDE / 2
    wanted = [heavy * SIDE**3 * half + arm / 2, -heavy * SIDE**3 * half, -arm]
    assert moments == pytest.approx(wanted, rel=0.02)
    assert Force("bottom", (0, 0, 2.0)).value(body) == pytest.approx([2 * force[2]])


def test_percentiles_and_integrals_of_a_homogeneous_stretch():
    mesh = block((SIDE,) * 3, SIDE / 2)
    body = Problem(mesh, {".*": Material(NeoHooke(1e3), 5e3)}, {"bottom": (None, None, 0)}, element="P2")
    stretch = np.array([1.2, 0.9, 0.95])
    body.u.Set(ngs.CF(tuple((s - 1) * c for s, c in zip(stretch, (ngs.x, ngs.y, ngs.z), strict=True))))
    for percent in (0, 50, 100):
        assert StrainPercentile(percent).value(body) == pytest.approx([(1.2**2 - 1) / 2])
        assert StrainPercentile(percent, measure="small", factor=3).value(body) == pytest.approx([0.6])
    assert region_volume().value(body) == pytest.approx([np.prod(stretch) * SIDE**3])
    assert StrainEnergy().value(body) == pytest.approx([body.energy])


@pytest.mark.parametrize("element", ["P2", "P2/P1"])
def test_stress_of_a_pulled_block(element):
    """Uniaxial, Neo-Hookean without change of volume: σ = μ (λ² - 1/λ), wherever it is looked for."""
    supports = {
        "left": (0, None, None),
        "front": (None, 0, None),
        "bottom": (None, None, 0),
        "top": (None, None, 0.3 * SIDE),
    }
    law = Material(NeoHooke(1e3), 1e7)
    body = Problem(block((SIDE,) * 3, SIDE / 2), {".*": law}, supports, element=element)
    LoadPath(body).solve()
    wanted = 1e3 * (1.3**2 - 1 / 1.3)
    asked = StressPercentile(90, centre=(SIDE / 2,) * 3, within=SIDE / 3)
    assert asked.value(body) == pytest.approx([wanted], rel=1e-3) and asked.unit == "Pa"
    assert asked.on(body).raw == pytest.approx(wanted, rel=1e-3)


def test_stress_at_rest_has_a_slope_and_relaxing_tissue_none():
    body = Problem(block((SIDE,) * 3, SIDE / 2), {".*": Material(NeoHooke(1e3), 5e3)}, {"bottom": 0}, element="P2")
    assert StressPercentile(50).value(body) == pytest.approx([0], abs=1e-3)
    assert np.isfinite(StressPercentile(50).gradient(body)).all()
    relaxing = Material(Viscous(NeoHooke(300.0), (Branch(NeoHooke(700.0), 3.0),)), 5e3)
    with pytest.raises(InputError, match="viscoelastic"):
        StressPercentile(50).on(Problem(body.mesh, {".*": relaxing}, {"bottom": 0}, element="P2"))


def test_octahedral_strain_and_a_place_of_ones_own():
    """Of a homogeneous stretch that of ln λ; `where` cuts the region as `centre` and `within` do."""
    mesh = block((SIDE,) * 3, SIDE / 2)
    body = Problem(mesh, {".*": Material(NeoHooke(1e3), 5e3)}, {"bottom": (None, None, 0)}, element="P2")
    stretch = np.array([1.2, 0.9, 0.95])
    body.u.Set(ngs.CF(tuple((s - 1) * c for s, c in zip(stretch, (ngs.x, ngs.y, ngs.z), strict=True))))
    one, two, three = np.log(stretch)
    wanted = 2 / 3 * np.sqrt((one - two) ** 2 + (two - three) ** 2 + (three - one) ** 2)
    assert StrainPercentile(50, measure="octahedral").value(body) == pytest.approx([wanted])
    near = ngs.IfPos((SIDE / 3) ** 2 - sum((x - SIDE / 2) ** 2 for x in (ngs.x, ngs.y, ngs.z)), 1.0, 0.0)
    ball = StrainPercentile(50, centre=(SIDE / 2,) * 3, within=SIDE / 3).on(body)
    cut = StrainPercentile(50, where=near).on(body)
    assert np.array_equal(ball.values(), cut.values()) and ball.raw == cut.raw
    assert 0 < len(cut.values()) < len(StrainPercentile(50).on(body).values())


def test_a_narrow_band_is_the_percentile_itself_and_a_wide_one_the_mean():
    body = cube(mesh=block((SIDE,) * 3, SIDE / 4))
    raw = [StrainPercentile(p).on(body).raw for p in (20, 50, 95)]
    narrow = [StrainPercentile(p, band=0.002).value(body)[0] for p in (20, 50, 95)]
    assert narrow == pytest.approx(raw, rel=5e-3) and raw[0] < raw[1] < raw[2]
    wide = [abs(StrainPercentile(95, band=b).value(body)[0] / raw[2] - 1) for b in (0.01, 0.05)]
    assert wide[0] < wide[1]
    strain = StrainPercentile(50).on(body).values()
    assert strain.min() < StrainPercentile(50, band=0.5).value(body)[0] < strain.max()


def test_the_pressure_of_a_plate_is_its_force_over_the_walls_area():
    mesh = block((SIDE,) * 3, SIDE / 2)
    plate = RigidContact("top", lambda x: 0.96 * SIDE - x[2], 1e6, 2e-5, 0.9)
    body = Problem(mesh, {".*": Material(NeoHooke(1e3), 2e4)}, {"bottom": 0}, contacts=[plate], element="P2/P1")
    LoadPath(body).solve()
    force, pressure = Force("bottom", (0, 0, 1)).value(body)[0], patch_pressure(plate)
    area = Functional(lambda at: ngs.Norm(at.area(at.u, "top")) * plate.measure()).value(body)[0]
    assert SIDE**2 < area < 1.1 * SIDE**2  # it bulges
    assert pressure.value(body)[0] == pytest.approx(force / area, rel=1e-6) and pressure.unit == "Pa"
    half = patch_pressure(plate, ngs.IfPos(ngs.x - 0.3 * SIDE, 1.0, 0.0)).value(body)[0]
    rest = patch_pressure(plate, ngs.IfPos(ngs.x - 0.3 * SIDE, 0.0, 1.0)).value(body)[0]
    assert min(half, rest) < pressure.value(body)[0] < max(half, rest)


def test_the_pressure_under_a_plate_passes_taylors_test(rng):
    body = pressed_and_loaded()
    observed, x, dx = patch_pressure(body.contacts[0]).on(body), body.x, moved(body, rng, 1e-4 * SIDE)

    def value(at):
        body.x = at
        return float(observed.value()[0])

    assert taylor(value, observed.gradient(np.ones(1)), x, dx, first=0.1)[-1] == pytest.approx(2, abs=0.1)


@dataclass(frozen=True)
class Unevenness(WallIntegral):
    """One of a user's own: the square of how far a wall is from a plate (m⁴)."""

    plate: RigidContact
    name = "unevenness"
    unit = "m⁴"

    def densities(self, problem):
        return {self.plate.wall: lambda at: self.plate.gap(at.u) ** 2}


def test_what_is_seen_of_a_wall_in_one_pass(rng):
    """The force is that of the body's supports; with half of a plate in touch the area is half of the wall's, smoothed or not."""
    mesh = block((SIDE,) * 3, SIDE / 2)
    plate = RigidContact("top", lambda x: 0.96 * SIDE - x[2], 1e6, 2e-5, 0.9)
    body = Problem(mesh, {".*": Material(NeoHooke(1e3), 2e4)}, {"bottom": 0}, contacts=[plate], element="P2/P1")
    LoadPath(body).solve()
    patches = [Patch(plate)]
    asked = [ContactForce(patches, (0, 0, -1)), NormalForce(patches), ContactArea(patches), ContactArea(patches, True)]
    asked += [CurrentArea(patches), Unevenness(plate), patch_pressure(plate), mean_depth(patches)]
    force, normal, area, soft, current, uneven, pressure, depth = WallPass(body, asked)()
    assert [each.value(body)[0] for each in asked] == pytest.approx([*WallPass(body, asked)()], rel=1e-12)
    assert force == pytest.approx(normal) == pytest.approx(Force("bottom", (0, 0, 1)).value(body)[0], rel=1e-6)
    assert ContactForce(patches, (0, 3, -2)).value(body)[0] == pytest.approx(2 * normal)  # without friction
    assert area == pytest.approx(current) == pytest.approx(soft) and pressure == pytest.approx(normal / current)
    assert uneven == pytest.approx(depth**2 * SIDE**2, rel=0.1)
    body.u.Interpolate(ngs.CF((0, 0, ngs.IfPos(ngs.x - SIDE / 2, 0.0, -0.05 * ngs.z))))
    half = [each.value(body)[0] / SIDE**2 for each in asked[2:4]]
    assert half == pytest.approx([0.5, 0.5], abs=0.1)
    with pytest.raises(InputError, match="smoothed=True"):
        ContactArea(patches).gradient(body)
    with pytest.raises(InputError, match="integral over walls"):
        WallPass(body, [Force("bottom")])
    for bad in ([], patches * 2):
        with pytest.raises(InputError, match="patches"):
            NormalForce(bad)


@pytest.mark.parametrize(
    "of",
    [
        lambda patches: ContactForce(patches, (1, 0.2, 0.1)),
        NormalForce,
        lambda patches: ContactArea(patches, True),
        CurrentArea,
        mean_depth,
        lambda patches: Unevenness(patches[0].contact),
    ],
)
def test_gradients_of_what_is_seen_of_a_wall(of, rng):
    body = pressed_and_loaded()
    observed, x, dx = of([Patch(body.contacts[0])]).on(body), body.x, moved(body, rng, 1e-4 * SIDE)

    def value(at):
        body.x = at
        return float(observed.value()[0])

    gradient = observed.gradient(np.ones(1))
    assert taylor(value, gradient, x, dx, first=0.1)[-1] == pytest.approx(2, abs=0.1)


@dataclass(frozen=True)
class TipDrop(Observable):
    """One of a user's own: how far the top's middle went down (m)."""

    unit = "m"
    name = "drop of the tip"

    def on(self, problem):
        seen = Displacements([[SIDE / 2, SIDE / 2, SIDE]], (0, 0, -1)).on(problem)
        return LinearObservable(problem, seen.matrix)


def test_one_of_a_users_own_is_asked_like_all_others():
    body = cube()
    assert TipDrop().value(body) == pytest.approx([-SQUASHED * SIDE])
    state = body.state(1.0)
    body.reset()
    assert TipDrop().value(body) == pytest.approx([0]) and TipDrop().value(body, state) == pytest.approx(
        [-SQUASHED * SIDE]
    )
    assert SolutionUnknowns().value(body) == pytest.approx(body.x)


SMOOTH = [Force("bottom", (0.2, 0.3, 1)), SWELLING, TipDrop(), Moment("bottom", (0, 0, 0), (0.3, 1, 0))]
STRAIN, STRESS = StrainPercentile(70, band=0.3), StressPercentile(60, band=0.4)


def test_data_of_an_equilibrium(rng):
    mu, push = ngs.Parameter(1e3), ngs.Parameter(60.0)
    mesh = block((SIDE,) * 3, SIDE / 2)
    body = Problem(
        mesh,
        {".*": Material(NeoHooke(mu), 5e3)},
        {"bottom": 0},
        [TractionLoad("right", (push, 0.3 * push, 0))],
        element="P2",
    )
    tight = newton_for(body, rtol=1e-12, xtol=1e-12)
    model = StaticModel([LoadCase(body, [*SMOOTH, STRAIN, STRESS])], {"mu": mu, "push": push}, tight)
    start, there = model.theta.copy(), model.evaluate(model.theta)
    w = weights(there.data[None], rng)[0]
    for name, direction in directions(model, rng):
        gradient = model.evaluate(start).gradient(w)
        rates = taylor(lambda t: float(w @ model.evaluate(t).data), gradient, start, direction, first=1e-3)
        there = model.evaluate(start)
        assert rates[0] == pytest.approx(2, abs=0.1), (name, rates)
        assert dot(there.jvp, there.vjp, direction, w) < 1e-9
        assert there.vjp(w) == pytest.approx(gradient, rel=1e-8)


def stretched():
    """A block in space pulled aside, and what it is made of."""
    mu, push = ngs.Parameter(1e3), ngs.Parameter(60.0)
    mesh, law = block((SIDE,) * 3, SIDE / 2), Material(NeoHooke(mu), 5e3)
    body = Problem(mesh, {".*": law}, {"bottom": 0}, [TractionLoad("right", (push, 0.3 * push, 0))], element="P2")
    return body, {"mu": mu, "push": push}


def test_second_derivatives_of_all_kinds_of_data_of_an_equilibrium(rng):
    """Of percentiles so near that no point changes its rank, which is looked at."""
    body, p = stretched()
    energy = Ratio(StrainEnergy(), region_volume(), "mean energy")
    small = StrainPercentile(50, band=0.3, measure="small", factor=3.0)
    asked = [SWELLING, TipDrop(), STRAIN, STRESS, small, energy]
    model = StaticModel([LoadCase(body, asked)], p, newton_for(body, rtol=1e-12, xtol=1e-12))
    percentiles = [seen for seen in model.equilibria[0].observables if isinstance(seen, ProblemPercentile)]
    start, there = model.theta.copy(), model.evaluate(model.theta)
    w = weights(there.data[None], rng)[0]
    direction = start * rng.uniform(0.5, 1, 2)

    def ranked():
        return [np.argsort(seen.values()).tolist() for seen in percentiles]

    first, ranks = 2e-2, ranked()
    while any((model.evaluate(start + s * direction), ranked())[1] != ranks for s in (first, -first)):
        first /= 2
    assert first > 1e-5
    for observed, where in zip(asked, model.observation_slices, strict=True):
        own = np.zeros_like(w)
        own[where] = w[where]
        there = model.evaluate(start)
        found = there.hvp(own, direction) * start

        def slope(theta, own=own):
            return model.evaluate(theta).gradient(own) * start

        if observed in (STRAIN, STRESS, small):
            ends = [slope(start + s * direction) for s in (first, -first)]
            assert found == pytest.approx((ends[0] - ends[1]) / (2 * first), rel=1e-4), observed.name
        else:
            rates = taylor(slope, lambda d, found=found: found, start, direction, first=2e-2)
            assert rates[0] == pytest.approx(2, abs=0.1), (observed.name, rates)


def test_a_quotient_whose_slopes_stay_has_no_second_derivatives(rng, monkeypatch):
    monkeypatch.setattr(Quotient, "weight_change", lambda self, state, *along: [])
    body, p = stretched()
    model = StaticModel([LoadCase(body, [Ratio(StrainEnergy(), region_volume())])], p)
    start, w = model.theta.copy(), np.ones(1)
    found = model.evaluate(start).hvp(w, start) * start
    rates = taylor(lambda t: model.evaluate(t).gradient(w) * start, lambda d: found, start, start, first=2e-2)
    assert rates[-1] < 1.3, rates


def test_the_pressure_of_a_plate_in_a_run_by_what_it_is_made_of(rng):
    """Its penalty is in the pressure itself."""
    mesh, materials, parameters, protocol, acts = touched()
    drive = Drive(protocol)
    walls = acts(drive)
    body = Problem(mesh, materials, {"bottom": 0}, contacts=walls, element="P2/P1")
    model = RunModel(body, drive, GRID, parameters, [patch_pressure(walls[0])])
    start, there = model.theta.copy(), model.evaluate(model.theta)
    w = weights(there.data, rng)
    gradient = there.gradient(w)
    for name, direction in directions(model, rng):
        rates = taylor(lambda t: float(np.sum(w * model.evaluate(t).data)), gradient, start, direction, first=0.02)
        assert rates[1] == pytest.approx(2, abs=0.15), (name, rates)
        assert np.sum(w * model.evaluate(start).jvp(direction)) == pytest.approx(gradient @ direction, rel=1e-6), name
    found = model.evaluate(start).hvp(w, start) * start
    rates = taylor(lambda t: model.evaluate(t).gradient(w) * start, lambda d: found, start, start, first=1e-3)
    assert rates[0] == pytest.approx(2, abs=0.1), rates


def run_of(kind, asked, grid=GRID):
    mesh, materials, parameters, protocol, acts = kind()
    drive = Drive(protocol)
    acting = acts(drive)
    walls = [each for each in acting if isinstance(each, RigidContact)]
    loads = [each for each in acting if each not in walls]
    body = Problem(mesh, materials, {"bottom": 0}, loads, contacts=walls, element="P2/P1")
    return RunModel(body, drive, grid, parameters, asked)


@pytest.mark.parametrize("kind", [relaxing, loaded])
def test_data_of_a_run(kind, rng):
    """Integrals and forces at the ends of steps, with loads elsewhere on nodes that are shared."""
    model = run_of(kind, SMOOTH)
    start, there = model.theta.copy(), model.evaluate(model.theta)
    w = weights(there.data, rng)
    gradient = there.gradient(w)
    for name, direction in directions(model, rng):
        rates = taylor(lambda t: float(np.sum(w * model.evaluate(t).data)), gradient, start, direction, first=0.05)
        assert rates[2] == pytest.approx(2, abs=0.1), (name, rates)
        there = model.evaluate(start)
        assert np.sum(w * there.jvp(direction)) == pytest.approx(gradient @ direction, rel=1e-7)


def test_a_percentile_of_a_run(rng):
    """Against differences: its ranks change along the way."""
    model = run_of(loaded, [STRAIN])
    start, there = model.theta.copy(), model.evaluate(model.theta)
    w = weights(there.data, rng)
    gradient = there.gradient(w)
    for name, direction in directions(model, rng):
        ends = [float(np.sum(w * model.evaluate(start + s * direction).data)) for s in (-1e-3, 1e-3)]
        assert (ends[1] - ends[0]) / 2e-3 == pytest.approx(gradient @ direction, rel=5e-3), name
    found, ends = (
        model.evaluate(start).hvp(w, direction),
        [model.evaluate(start + s * direction).gradient(w) for s in (1e-6, -1e-6)],
    )
    assert found * start == pytest.approx(
        (ends[0] - ends[1]) / 2e-6 * start, rel=1e-3, abs=1e-3 * np.abs(found * start).max()
    )


def test_second_derivatives_of_integrals_of_a_run(rng):
    model = run_of(loaded, [SWELLING, Force("bottom")], GRID[:4])
    start, there = model.theta.copy(), model.evaluate(model.theta)
    w = weights(there.data, rng)
    direction = sum(way for _, way in directions(model, rng))
    second, gradient = there.hvp(w, direction), lambda t: model.evaluate(t).gradient(w)
    rates = taylor(gradient, lambda way: second, start, direction, first=0.01)
    assert rates[-1] == pytest.approx(2, abs=0.1), rates


def test_bad_input():
    body = cube()
    with pytest.raises(InputError, match="direction"):
        Displacements([[0.01, 0.01, 0.01]], (0, 0, 0)).on(body)
    with pytest.raises(InputError, match="direction"):
        Force("top", (0, 1)).on(body)
    with pytest.raises(InputError, match="boundary"):
        Force("lid").on(body)
    with pytest.raises(InputError, match="centre"):
        Moment("top", (0, 0)).on(body)
    with pytest.raises(InputError, match="outside"):
        Displacements([[1.0, 0.01, 0.01]]).on(body)
    with pytest.raises(InputError, match="of 3 numbers"):
        Ratio(Force("top"), region_volume()).on(body)
    with pytest.raises(InputError, match="region"):
        StrainPercentile(50, "skull").on(body)
    for wrong in (
        {"percent": 101},
        {"percent": 50, "band": 0},
        {"percent": 5, "measure": "log"},
        {"percent": 5, "within": 1},
    ):
        with pytest.raises(InputError):
            StrainPercentile(**wrong)
    mesh = block((SIDE,) * 3, SIDE)
    nodes = NodePositions(mesh)
    body = Problem(mesh, {".*": Material(NeoHooke(1e3), 5e3)}, {"bottom": 0, "top": (0, 0, -1e-3)}, element="P1")
    with pytest.raises(InputError, match="NodePositions"):
        StaticModel([LoadCase(body, [StrainPercentile(50)])], {"nodes": nodes})
