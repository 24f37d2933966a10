"""Derivatives of a run by what its body is made of: Taylor rates, J against Jᵀ, memory, and bugs that are caught."""

import ngsolve as ngs
import numpy as np
import pytest
from relaxing_blocks import GRID, HOLD, KINDS, PLAIN, SEEN, SIDE, directions, field, model, plate, relaxing, weights

from ngbrain.adjoint.check import dot, taylor
from ngbrain.errors import ConvergenceError, InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import SelfContact
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.observables.force import Reaction
from ngbrain.forward.sensitivity.static_model import NodePositions
from ngbrain.forward.sensitivity.transient import maxwell_step as flow_forms
from ngbrain.forward.sensitivity.transient import run_linearisation as through_time
from ngbrain.forward.sensitivity.transient import step as step_forms
from ngbrain.forward.sensitivity.transient import step_hessian as step_curvature
from ngbrain.forward.sensitivity.transient import tangents
from ngbrain.forward.sensitivity.transient.replay import Replay, accepted_times
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.sensitivity.transient.step import StepForms
from ngbrain.forward.sensitivity.transient.tangents import FEW, MAX_ITERATIONS, Tangents
from ngbrain.forward.sensitivity.transient.tissue_hessian import DifferenceTissueHessian
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import NeoHooke, Prony
from ngbrain.materials.maxwell import MaxwellVariables
from ngbrain.mesh import block
from ngbrain.result import Status
from ngbrain.solvers.newton import Newton
from ngbrain.surgery.protocols import Drive

FIRST, SHORT = 4e-2, GRID[:4]


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow if kind == "Maxwell" else ()) for kind in KINDS]
)
def test_rates_of_every_parameter(kind, rng):
    of = model(kind, SHORT if kind == "Maxwell" else GRID)
    theta, there = of.theta, of.evaluate(of.theta)
    w = weights(there.data, rng)
    slope = there.gradient(w)
    for name, direction in directions(of, rng):
        # Far from round-off, near enough to be quadratic; where bodies stand counts almost linearly.
        first = FIRST if name in ("rise", "way") else min(FIRST, 0.1 * FIRST / abs(slope @ direction))
        rates = taylor(lambda x: float(np.sum(w * of.evaluate(x).data)), slope, theta, direction, steps=2, first=first)
        assert np.all((rates > 1.9) & (rates < 2.1)), (name, rates)


@pytest.mark.parametrize("kind", KINDS | PLAIN)
def test_the_products_are_transposes(kind, monkeypatch, rng):
    monkeypatch.setattr(through_time, "TOGETHER", 0)
    of = model(kind, SHORT if kind == "Maxwell" else GRID)
    there = of.evaluate(of.theta)
    w = weights(there.data, rng)
    slope = there.gradient(w)
    direction = sum(part for _, part in directions(of, rng))
    assert dot(there.jvp, slope, direction, w) < 1e-9


def test_fields_of_many_unknowns_are_pushed_one_by_one(monkeypatch, rng):
    of = model("layers")
    there = of.evaluate(of.theta)
    direction = rng.normal(size=of.size) * of.theta
    together = there.jvp(direction)
    w = weights(there.data, rng)
    pulled = there.vjp(w)
    assert np.array_equal(there.gradient(w), pulled)  # its columns are at hand
    there = of.evaluate(of.theta)
    assert pulled == pytest.approx(there.gradient(w), rel=1e-8, abs=1e-9 * np.abs(pulled).max())
    monkeypatch.setattr(through_time, "TOGETHER", 3)
    assert there.jvp(direction) == pytest.approx(together, rel=1e-9, abs=1e-10 * np.abs(together).max())
    assert there.vjp(w) == pytest.approx(pulled, rel=1e-8, abs=1e-9 * np.abs(pulled).max())


def test_data_are_those_of_the_stepping_that_was_recorded():
    def made():
        mesh, materials, parameters, protocol, _ = relaxing()
        drive = Drive(protocol)
        return Problem(mesh, materials, {"bottom": 0}, contacts=[plate(drive)], element="P2/P1"), drive, parameters

    body, drive, _ = made()
    transient = TimeStepper(body, drive, StepControl(1.0, dt_max=10), 1e-3)
    seen, rows = Force("top", (0, 0, 1)).on(body), []
    step = transient.step
    transient.step = lambda: (step(), rows.append(seen.value()[0]))[0]
    grid = accepted_times(transient)
    body, drive, parameters = made()
    of = RunModel(body, drive, grid, parameters, [Force("top", (0, 0, 1))])
    assert of.evaluate(of.theta).data[:, 0] == pytest.approx(np.array(rows), rel=1e-5, abs=1e-9)
    assert len(rows) == len(grid) - 1 > 8


def test_a_force_is_what_the_plate_exerts_and_the_support_takes():
    of = model()
    there = of.evaluate(of.theta)
    top, bottom = there.data[:, 0], there.data[:, 1]
    assert np.all(top < 0) and bottom == pytest.approx(-top, rel=1e-6)
    with_more_times = model(times=[3.0, 20.0, 40.0])
    assert with_more_times.replay.grid.tolist() == [*GRID[:3], 3.0, *GRID[3:5], 20.0, 40.0]
    assert with_more_times.evaluate(of.theta).data.shape == (3, 8)


def test_points_are_where_they_go():
    of = model(grid=GRID[:3])
    there = of.evaluate(of.theta)
    u = [of.body.u(of.body.mesh(*point)) for point in ((0.013, 0.01, 0.015), (0.005, 0.01, 0.01))]
    assert there.data[-1, 2:] == pytest.approx(np.ravel(u), rel=1e-12)


def test_old_factors_serve_several_steps(monkeypatch):
    grid, found = np.linspace(0, 4, 17), {}
    for most in (MAX_ITERATIONS, 1):
        monkeypatch.setattr(tangents, "MAX_ITERATIONS", most)
        of = model(grid=grid)
        there = of.evaluate(of.theta)
        found[most] = there.gradient(np.ones_like(there.data)), of.tangents.factorisations
        assert of.tangents.solves == 16
    (slope, few), (direct, all_of_them) = found.values()
    assert few <= 8 and all_of_them == 16
    assert slope == pytest.approx(direct, rel=1e-8)


# Where nodes are.


def graded():
    """Its stiffness is a function of the place."""
    mesh, _, p, protocol, contacts = relaxing()
    law = Prony(NeoHooke(p["mu"] * (1 + 40 * ngs.x + 9e3 * ngs.z**2)), [p["g"]], [p["tau"]])
    return mesh, {"tissue": Material(law, 1e6)}, p, protocol, contacts


SHAPED = {"graded": graded, "layers": KINDS["layers"], "touched": KINDS["touched"], "flowing": PLAIN["flowing"]}


@pytest.mark.parametrize("kind", SHAPED)
def test_where_nodes_are(kind, rng):
    """J and Jᵀ by shifts of some micrometres, far less than contact is soft over, of inner nodes and those that are held."""
    mesh, materials, parameters, protocol, contacts = SHAPED[kind]()
    nodes, drive = NodePositions(mesh), Drive(protocol)
    try:
        body = Problem(mesh, materials, {"bottom": 0}, contacts=contacts(drive), element="P2/P1")
        of = RunModel(body, drive, SHORT, parameters | {"nodes": nodes}, SEEN)
        theta, there = of.theta, of.evaluate(of.theta)
        w, direction, shifts = weights(there.data, rng), np.zeros(of.size), of.blocks["nodes"]
        direction[shifts] = 5e-5 * rng.normal(size=shifts.stop - shifts.start)
        slope = there.gradient(w)
        rates = taylor(lambda t: float(np.sum(w * of.evaluate(t).data)), slope, theta, direction, steps=2, first=0.1)
        assert np.all((rates > 1.9) & (rates < 2.1)), rates
        there, direction = of.evaluate(theta + 4 * direction), direction + 0.1 * theta * rng.normal(size=of.size)
        slope = there.gradient(w)
        assert dot(there.jvp, slope, direction, w) < 1e-8
        with pytest.raises(InputError, match=r"parameters\.nodes is of type NodePositions"):
            there.hvp(w, direction)
    finally:
        mesh.UnsetDeformation()


# Second derivatives.


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow if kind == "Maxwell" else ()) for kind in KINDS | PLAIN]
)
def test_second_derivatives(kind, rng):
    """They are symmetric, and those of the gradient."""
    of = model(kind, SHORT if kind in ("Maxwell", "flowing") else GRID)
    theta, there = of.theta, of.evaluate(of.theta)
    w = weights(there.data, rng)
    size = np.concatenate([np.full(b.stop - b.start, theta[b].max()) for b in of.blocks.values()])
    much = 0.5 if kind == "elastic" else 0.05  # a modulus alone changes little but how far contact's penalty gives way
    a, b = much * size * rng.uniform(-1, 1, (2, of.size))
    along_a, along_b = there.hvp(w, a), there.hvp(w, b)
    assert dot(along_a, along_b, a, b) < 1e-10
    rates = taylor(lambda t: of.evaluate(t).gradient(w) * size, lambda d: there.hvp(w, d) * size, theta, a, 2)
    assert np.all((rates > 1.9) & (rates < 2.1)), rates


def test_second_derivatives_where_few_histories_are_held():
    found = []
    for every in (1, 2, 5):
        of = model("layers", every=every)
        found.append(of.evaluate(of.theta).hvp(np.ones((5, 8)), of.theta))
    for each in found[1:]:
        assert each == pytest.approx(found[0], rel=1e-9, abs=1e-12 * np.abs(found[0]).max())


def test_second_derivatives_by_differences_are_those_by_symbols(monkeypatch, rng):
    of = model("Prony")
    there = of.evaluate(of.theta)
    w, way = weights(there.data, rng), 0.05 * of.theta
    by_symbols = there.hvp(w, way)
    other = model("Prony")
    monkeypatch.setattr(
        step_curvature, "SymbolicTissueHessian", lambda forms: DifferenceTissueHessian(forms, other.parts)
    )
    by_differences = other.evaluate(of.theta).hvp(w, way)
    assert by_differences == pytest.approx(by_symbols, rel=1e-9, abs=1e-10 * np.abs(by_symbols).max())


def test_second_derivatives_that_are_not_there_are_refused():
    mesh, materials, parameters, protocol, _ = relaxing()
    drive = Drive(protocol)
    walls = [plate(drive), SelfContact("left", "right", 1e8, 1e-5, reach=1e-3)]
    of = RunModel(
        Problem(mesh, materials, {"bottom": 0}, contacts=walls, element="P2/P1"), drive, SHORT, parameters, SEEN
    )
    with pytest.raises(InputError, match="with self-contact"):
        of.evaluate(of.theta).hvp(np.ones((3, 8)), of.theta)
    walls[1] = SelfContact("left", "right", 1e8 * parameters["g"], 1e-5, reach=1e-3)
    with pytest.raises(InputError, match=r"SelfContact\.penalty is .*a number"):
        RunModel(
            Problem(mesh, materials, {"bottom": 0}, contacts=walls, element="P2/P1"), drive, SHORT, parameters, SEEN
        )


# Memory.


def held_in_a_gradient(of, w):
    """The gradient, and the most histories held meanwhile."""
    there, held = of.evaluate(of.theta), [of.replay.stored_histories]
    steps = of.replay.backwards
    of.replay.backwards = lambda: ((held.append(of.replay.stored_histories), step)[1] for step in steps())
    return there.gradient(w), max(held)


@pytest.mark.parametrize("kind", ["relaxing", "flowing"])
def test_few_histories_are_held_and_the_gradient_is_the_same(kind):
    grid, found = np.linspace(0, 4, 10), {}
    for every, states in ((1, True), (3, True), (9, True), (3, False)):
        of = model(kind, grid=grid, every=every, states=states)
        slope, held = held_in_a_gradient(of, np.ones((9, 8)))
        found[every, states] = slope, held, of.replay.solved
        assert len(of.replay._states) == 9 * states
    wanted = found[1, True][0]
    # 9 starts and the last step; 3 and 3; 1 and 9
    assert [(held, solved) for _, held, solved in found.values()] == [(10, 9), (6, 9), (10, 9), (6, 15)]
    for (_, states), (slope, _, _) in found.items():
        assert slope == pytest.approx(wanted, rel=1e-10 if states else 1e-7)


def test_several_gradients_prepare_each_step_once(monkeypatch, rng):
    monkeypatch.setattr(through_time, "TOGETHER", 0)
    of = model("relaxing", GRID)
    there, prepare, calls = of.evaluate(of.theta), of.tangents.prepare, []
    monkeypatch.setattr(of.tangents, "prepare", lambda *given: (calls.append(1), prepare(*given))[1])
    several = [weights(there.data, rng) for _ in range(3)]
    found = there.gradients(several)
    assert len(calls) == len(of.replay.grid) - 1
    for slope, w in zip(found, several, strict=True):
        assert slope == pytest.approx(there.gradient(w), rel=1e-8, abs=1e-9 * np.abs(slope).max())


@pytest.mark.parametrize("states", [True, False])
def test_by_default_memory_grows_like_the_root(states):
    held = []
    for n in (4, 16, 36):
        of = model("elastic", grid=np.linspace(0, 4, n + 1), states=states)
        held.append(held_in_a_gradient(of, np.ones((n, 8)))[1])
    assert held == [4, 8, 12]


def test_a_run_nearby_starts_from_what_is_known(monkeypatch):
    solve, iterations = Newton.solve, []

    def counted(self, system, x):
        found, record = solve(self, system, x)
        iterations.append(record.iterations)
        return found, record

    monkeypatch.setattr(Newton, "solve", counted)
    counts, data = [], []
    for states in (True, False):
        of = model(states=states)
        of.evaluate(of.theta)
        iterations.clear()
        data.append(of.evaluate(1.001 * of.theta).data)
        counts.append(sum(iterations))
    assert counts[0] < 0.5 * counts[1], counts
    assert data[0] == pytest.approx(data[1], rel=1e-7, abs=1e-10)


# What goes wrong.


def test_a_step_that_fails_is_an_error_that_searches_can_step_back_from():
    of = model(newton=Newton(rtol=1e-10, xtol=1e-10, max_iter=2))
    with pytest.raises(ConvergenceError, match="replayed run"):
        of.evaluate(of.theta)
    of = model()
    theta = of.theta
    with pytest.raises(ConvergenceError):
        of.evaluate(np.array([-1000.0, 0.5, 3.0]))
    assert np.isfinite(of.evaluate(theta).data).all()


def test_part_of_the_way_is_gone_first_where_the_whole_is_too_far(monkeypatch):
    far = (0.0, 4.0, 40.0)
    wanted = model(grid=far).evaluate(model(grid=far).theta).data
    solve, asked = Newton.solve, []

    def shy(self, system, x):
        asked.append(0)
        found, record = solve(self, system, x)
        if len(asked) == 1:
            record.status = Status.STALLED
        return found, record

    monkeypatch.setattr(Newton, "solve", shy)
    of = model(grid=far)
    assert of.evaluate(of.theta).data == pytest.approx(wanted, rel=1e-6, abs=1e-9) and len(asked) > 4


def test_bad_input():
    mesh, materials, parameters, protocol, _ = relaxing()
    drive = Drive(protocol)
    body = Problem(mesh, materials, {"bottom": 0}, contacts=[plate(drive)], element="P2/P1")
    with pytest.raises(InputError, match="grid"):
        RunModel(body, drive, [0.5, 1.0], parameters, [Force("top", (0, 0, 1))], times=[1.0])
    with pytest.raises(InputError, match="times"):
        RunModel(body, drive, GRID, parameters, [Force("top", (0, 0, 1))], times=[50.0])
    with pytest.raises(InputError, match="every"):
        RunModel(body, drive, GRID, parameters, [Force("top", (0, 0, 1))], every=-1)
    with pytest.raises(InputError, match=r"parameters\.mu"):
        RunModel(body, drive, GRID, {"mu": 3.0}, [Force("top", (0, 0, 1))])
    with pytest.raises(InputError, match="direction"):
        RunModel(body, drive, GRID, parameters, [Force("top", (0.0, 0.0, 0.0))])
    with pytest.raises(InputError, match="boundary"):
        RunModel(body, drive, GRID, parameters, [Force("lid")])
    with pytest.raises(InputError, match="outside"):
        RunModel(body, drive, GRID, parameters, [Displacements([[1.0, 0.0, 0.0]])])
    of = RunModel(body, drive, GRID, parameters, [Force("top", (0, 0, 1))])
    with pytest.raises(InputError, match="theta"):
        of.evaluate(np.ones(2))
    with pytest.raises(ConvergenceError, match="not finite; reduce the step"):
        of.evaluate(np.array([1e3, np.inf, 1.0]))


# Each bug is one that was met; rates of a right gradient are above 1.9.


def without_shares(patch):
    """β and e held as τ changes."""
    factors = flow_forms.step_factors
    patch.setattr(step_forms, "step_factors", lambda dt, tau: factors(dt, ngs.Parameter(tau.Get())))


def forgetful(patch):
    """No weights of the history handed from step to step."""
    back = StepForms.adjoint_gradients
    patch.setattr(StepForms, "adjoint_gradients", lambda self, *of: (0 * back(self, *of)[0], back(self, *of)[1]))


def forwards(patch):
    patch.setattr(Replay, "backwards", Replay.forwards)


def force_of_nothing(patch):
    """What presses on a boundary itself counted as a part of the body."""
    patch.setattr(Reaction, "own_stiffness", lambda self, motion: 0 * motion)


def stale_factor(patch):
    here = Tangents.prepare

    def elsewhere(self, sides, exact):
        x = self.body.x
        self.body.x = 0.7 * x
        solve = here(self, FEW + 1, exact)
        self.body.x = x
        return solve

    patch.setattr(Tangents, "prepare", elsewhere)


def unsettled(patch):
    """A step's own minimum differentiated where it is not."""
    settled = MaxwellVariables.step_solution.fget
    patch.setattr(
        MaxwellVariables,
        "step_solution",
        property(lambda self: settled(self) * np.array([[0.5], [0.5], [1], [1], [1]])),
    )


def rest_forgotten(patch):
    """The modulus at rest, by which a first step flows, held."""
    patch.setattr(flow_forms, "initial_modulus", lambda law: 600.0)


def inner_forgotten(patch):
    """What Maxwell branches do in the first half of a step held."""
    patch.setattr(StepForms, "_start_functions", lambda self, m, view: [self._zero_function(10)] * len(self._half))


BUGS = {
    without_shares: ("relaxing", "tau"),
    forgetful: ("relaxing", "g"),
    forwards: ("relaxing", "tau"),
    force_of_nothing: ("relaxing", "mu"),
    stale_factor: ("relaxing", "mu"),
    unsettled: ("flowing", "spring"),
    rest_forgotten: ("flowing", "spring"),
    inner_forgotten: ("flowing", "eta"),
}


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.__name__)
def test_a_bug_lowers_the_rate(bug, monkeypatch, rng):
    kind, name = BUGS[bug]
    bug(monkeypatch)
    of = model(kind)
    theta = of.theta
    direction = dict(directions(of, np.random.default_rng(1)))[name]
    w = weights(of.evaluate(theta).data, rng)
    slope = of.evaluate(theta).gradient(w)
    rates = taylor(lambda x: float(np.sum(w * of.evaluate(x).data)), slope, theta, direction, steps=2, first=4e-4)
    assert np.all(rates < 1.3), rates


@pytest.mark.parametrize("kind", PLAIN)
def test_without_bugs_the_same_has_its_rate(kind, rng):
    of = model(kind)
    theta = of.theta
    w = weights(of.evaluate(theta).data, rng)
    slope = of.evaluate(theta).gradient(w)
    for _, direction in directions(of, np.random.default_rng(1)):
        rates = taylor(lambda x: float(np.sum(w * of.evaluate(x).data)), slope, theta, direction, steps=2, first=2e-2)
        assert np.all((rates > 1.9) & (rates < 2.1)), rates


# What is refused.


def test_what_the_motion_sets_itself_is_no_parameter():
    of = model(grid=GRID[:3])
    with pytest.raises(InputError, match=r"parameters\.way is the motion's own parameter"):
        RunModel(of.body, of.replay.motion, GRID, {"way": of.replay.motion.parameter}, SEEN)


def test_a_law_of_a_parameters_gradient_is_refused():
    """Its derivative by the gradient would be nothing, silently."""
    mesh, drive = block((SIDE,) * 3, SIDE), Drive(HOLD)
    mu = field(mesh, 1e3)
    tissue = Material(NeoHooke(mu + ngs.Norm(ngs.Grad(mu))), 1e6)
    body = Problem(mesh, {"tissue": tissue}, {"bottom": 0}, contacts=[plate(drive)], element="P2/P1")
    with pytest.raises(InputError, match=r"parameters\.mu is used through its gradient"):
        RunModel(body, drive, GRID, {"mu": mu}, SEEN)


def test_nothing_that_is_seen_and_weights_of_another_shape_are_refused():
    of = model(grid=GRID[:3])
    with pytest.raises(InputError, match="observables is none"):
        RunModel(of.body, of.replay.motion, GRID, of.parameters, [])
    there = of.evaluate(of.theta)
    with pytest.raises(InputError, match=r"w is of shape \(2,\)"):
        there.gradient(np.ones(2))
