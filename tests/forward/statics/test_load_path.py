"""Statics: what a solve says of itself, what it refuses, and what it does when a load step fails."""

from math import pi, tanh

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

from ngbrain.adjoint.check import taylor
from ngbrain.errors import CollapseWarning, ConvergenceError, InputError
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import (
    BodyForce,
    CavityPressure,
    CavityVolume,
    RigidBody,
    RigidFace,
    Spring,
    TractionLoad,
)
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.forward.statics.stability import smallest_eigenvalue
from ngbrain.materials import Branch, NeoHooke, UnsplitNeoHooke, Viscous, logarithmic
from ngbrain.mesh import block
from ngbrain.solvers import linear
from ngbrain.solvers.continuation import follow, resume
from ngbrain.solvers.newton import Newton

SOFT = {".*": Material(NeoHooke(1e3), 1e6)}


def square(n=4, size=0.1):
    return MakeStructured2DMesh(quads=False, nx=n, ny=n, mapping=lambda x, y: (size * x, size * y))


def pressed(depth, form="P2/P1", **options):
    return Problem(square(), SOFT, {"bottom": 0, "top": (0, -depth)}, element=form, **options)


def test_a_record_says_what_was_done():
    body, heard = pressed(0.02), []
    record = LoadPath(body).solve(steps=2, callback=heard.append)
    assert record.converged and record.factor == 1 and not record.cuts and heard == [0.5, 1.0]
    assert [t for t, _ in record.history] == heard
    assert set(record.seconds) == {"assemble", "factor", "solve", "residual", "check"}
    assert record.tried == sum(step.iterations for _, step in record.history)
    assert record.work.factorisations >= 1 and record.ndof == body.fes.ndof
    assert 0.5 < record.min_det_F <= 1 and record.min_det_F == pytest.approx(body.min_det(body.x))
    assert record.element == "P2/P1: asked for" and record.solver.startswith("sparsecholesky: ")
    assert not record.guard


def test_forces_of_opposite_sides_balance_and_are_the_slope_of_the_energy():
    energies = {}
    for depth in (0.0099, 0.01, 0.0101):
        body = pressed(depth)
        LoadPath(body).solve(newton=Newton(rtol=1e-10, xtol=1e-9))
        energies[depth] = body.energy
        if depth == 0.01:
            top, bottom = body.force("top"), body.force("bottom")
    assert top == pytest.approx(-bottom, abs=1e-8 * np.linalg.norm(top))
    assert -top[1] == pytest.approx((energies[0.0101] - energies[0.0099]) / 2e-4, rel=1e-5)


RESPONSES = {
    "plane strain": {"element": "P3/P2"},
    "discontinuous": {"element": "P4/L2(2)"},
    "displacements": {"element": "P2"},
    "axisymmetric": {"kinematics": Axisymmetric(), "element": "P2/P1"},
    "rigid face": {"element": "P3/P2", "loads": [RigidFace("top", (0.004, -0.02), 1e6)]},
    "volume control": {
        "element": "P2/P1",
        "boundary_conditions": {"left": (0, None), "bottom": (None, 0)},
        "loads": [CavityVolume("right|top", 1e-4)],
    },
}


@pytest.mark.parametrize("options", RESPONSES.values(), ids=RESPONSES)
def test_residual_and_tangent_are_derivatives_of_the_energy(options, rng):
    loads = [TractionLoad("right", (20.0, 5.0)), BodyForce((0, -30.0)), Spring("top", 1e4)]
    body = Problem(square(2), SOFT, **{"boundary_conditions": {"bottom": 0}, "loads": loads} | options)
    size = np.where(body.is_u, 1e-3, 50.0) * (body.weights > 0)
    x, dx = (body.load(size * rng.uniform(-1, 1, body.fes.ndof), 0.7) for _ in range(2))

    def energy(y):
        body.x = y
        return body.energy

    r = body.residual(x)[0]
    rates = taylor(energy, r, x, dx, first=0.1)
    assert np.all(np.abs(rates - 2) < 0.1), rates
    solve = body.factorise(x, r)
    steps = [np.linalg.norm(size * (solve((body.residual(x + h * dx)[0] - r) / h) - dx)) for h in (1e-2, 5e-3)]
    assert np.log2(steps[0] / steps[1]) == pytest.approx(1, abs=0.1)  # of a difference quotient


def test_a_foot_bears_all_that_acts_also_where_loads_share_its_nodes():
    loads = [BodyForce((0, -30.0)), TractionLoad("right", (20.0, 0))]
    body = Problem(square(), SOFT, {"bottom": 0}, loads, element="P2/P1")
    LoadPath(body).solve(newton=Newton(rtol=1e-11, xtol=1e-10))
    assert body.force("bottom") == pytest.approx((-20 * 0.1, 30 * 0.01), rel=1e-8)


def test_a_cavity_has_to_be_closed():
    # The wall of a tube around y: its upper end is no plane of symmetry, and a volume down to the origin would be wrong.
    tube = MakeStructured2DMesh(quads=True, nx=2, ny=2, mapping=lambda x, y: (1 + x, y))
    with pytest.raises(InputError, match=r"cavity is 'left', open at .* from the next; wanted: one closed"):
        Problem(tube, SOFT, {"bottom": (None, 0)}, [CavityPressure("left", 1.0)], kinematics=Axisymmetric())


@pytest.mark.parametrize(("foot", "pushed"), [(5e-3, True), (-2e-2, False)])
def test_a_rigid_face_pushes_and_does_not_pull(foot, pushed):
    """Confined: K + 4μ/3 times the strain; a body that is moved away from it farther than it follows is free."""
    walls = {"left|right": (0, None), "bottom": (None, foot)}
    body = Problem(
        square(), {".*": Material(NeoHooke(1e3), 1e4)}, walls, [RigidFace("top", (0, -1e-2), 1e9)], element="P2/P1"
    )
    LoadPath(body).solve()
    down = ngs.Integrate(body.u[1] * ngs.ds("top"), body.mesh) / 0.1
    if pushed:
        assert (
            down == pytest.approx(-1e-2, abs=1e-5) and body.force("top")[1] < -100 and abs(body.force("top")[0]) < 1e-6
        )
    else:
        assert down == pytest.approx(foot, rel=1e-6) and np.abs(body.force("top")).max() < 1e-6


@pytest.mark.parametrize("kinematics", [None, Axisymmetric()])
def test_a_rigid_plate_is_a_rigid_face_that_is_half_its_softness_deeper(kinematics):
    """Soft enough to count: the face is 1 % of its way deep in the body."""
    plate, forces = RigidBody("top", lambda x, t: 0.1 - 5e-3 * t - x[1], 1e6, 1e-5), []
    for load in (plate, RigidFace("top", (0, -5e-3 + 5e-6), 1e6)):
        body = Problem(square(), SOFT, {"left": (0, None), "bottom": 0}, [load], element="P2/P1", kinematics=kinematics)
        LoadPath(body).solve(newton=Newton(rtol=1e-11, xtol=1e-10))
        forces.append(body.force("bottom")[1])
    assert forces[0] == pytest.approx(forces[1], rel=1e-9) and forces[0] > 1


def test_springs_exert_their_force():
    body = Problem(square(), SOFT, {"left": (0, None)}, [Spring("bottom", 1e4), BodyForce((0, -30.0))], element="P2/P1")
    LoadPath(body).solve(newton=Newton(rtol=1e-11, xtol=1e-10))
    assert body.force("bottom")[1] == pytest.approx(30 * 0.01, rel=1e-8)


@pytest.mark.one_thread
def test_a_second_solve_starts_from_rest_and_gives_the_same_bits():
    body = pressed(0.02)
    LoadPath(body).solve()
    first = body.x
    LoadPath(body).solve()
    assert np.array_equal(body.x, first)


def test_a_solve_goes_on_from_a_state_that_is_near_and_from_rest_where_it_is_not():
    coarse, fine = (pressed(0.02, form) for form in ("P2/P1", "P3/P2"))
    LoadPath(coarse).solve()
    rest = LoadPath(fine).solve()
    wanted = fine.x
    fine.u.Set(coarse.u)
    fine.p.Set(coarse.p)
    record = LoadPath(fine).solve(start=fine.x)
    assert record.converged and [t for t, _ in record.history] == [1.0]
    assert record.work.factorisations <= rest.work.factorisations and record.work.residuals < rest.work.residuals
    assert fine.x == pytest.approx(wanted, abs=1e-6 * np.abs(wanted).max())
    inverted = -60 * wanted
    assert fine.min_det(inverted) < 0
    assert LoadPath(fine).solve(start=inverted).converged
    assert fine.x == pytest.approx(wanted, abs=1e-6 * np.abs(wanted).max())


def test_newtons_settings_serve_several_bodies():
    settings = Newton(rtol=1e-8)
    for form in ("P2/P1", "P3/P2"):  # a factor of the first would not even fit the second
        assert LoadPath(pressed(0.02, form)).solve(newton=settings).converged
    assert settings.inverse is None and settings.largest == 0


@pytest.mark.parametrize("form", ["P2/P1", "P4/L2(2)", "P2"])
def test_a_body_that_nothing_acts_on_is_at_rest_at_once(form):
    """Residual and reactions are round-off, so that neither is small beside the other."""
    heard = []
    for loads in ((), (BodyForce((0, 0)),)):
        body = Problem(square(), SOFT, {"bottom": 0}, loads, element=form)
        record = LoadPath(body).solve(steps=3, callback=heard.append)
        assert record.converged and record.factor == 1 and record.work.factorisations == 1 and not record.tried
        assert not body.x.any() and record.min_det_F == pytest.approx(1) and heard.pop() == 1.0 and not heard


def test_a_body_that_is_strained_already_is_not_taken_for_one_at_rest():
    class Grown(NeoHooke):
        """As large as it is drawn, it would rather be narrower."""

        def energy(self, C):
            return super().energy(C) + 50.0 * C[0, 0]

    body = Problem(square(), {".*": Material(Grown(1e3), 1e5)}, {"bottom": 0}, element="P2/P1")
    assert LoadPath(body).solve().converged and np.ptp(body.x[body.is_u]) > 1e-4


def test_threads_of_a_solve_are_its_own():
    before = ngs.ngsglobals.numthreads
    body = pressed(0.01)
    LoadPath(body).solve(threads=2)
    two, after = body.x, ngs.ngsglobals.numthreads
    LoadPath(body).solve(threads=1)
    assert after == before and body.x == pytest.approx(two, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"element": "P2+P1"}, ["element", "'P2+P1'", "P2/P1"]),
        ({"element": "P2/P2"}, ["P2/P2", "order 2 under displacements of order 2"]),
        ({"element": "P2/L2(1)"}, ["P2/L2(1)", "one order below"]),
        ({"solver": "sparsecholeski"}, ["sparsecholeski", "sparsecholesky"]),
        ({"boundary_conditions": {"botom": 0}}, ["botom", "bottom"]),
        ({"loads": [TractionLoad("topp", (0, 1.0))]}, ["topp", "top"]),
        ({"boundary_conditions": {"bottom": None}}, ["None", "for each component"]),
        ({"boundary_conditions": {"bottom": [0, 0, 0]}}, ["[0, 0, 0]", "2 components"]),
        ({"boundary_conditions": {"bottom": (0, 0, 0)}}, ["(0, 0, 0)", "2 components"]),
        (
            {"materials": {".*": Material(Viscous(NeoHooke(1.0), (Branch(NeoHooke(1.0), 1.0),)), 10.0)}},
            ["viscoelastic"],
        ),
        ({"materials": {".*": Material(NeoHooke(1.0), 100.0, change=logarithmic)}}, ["logarithmic", "squared_log"]),
        ({"materials": {"tissue": SOFT[".*"]}}, ["tissue region", "tissue"]),
    ],
)
def test_what_cannot_be_solved_is_refused_in_one_line(change, words):
    options = {"mesh": square(), "materials": SOFT, "boundary_conditions": {"bottom": 0}} | change
    with pytest.raises(InputError) as error:
        LoadPath(Problem(**options))
    assert all(word in str(error.value) for word in words), str(error.value)


def test_of_patterns_that_overlap_the_later_counts():
    body = Problem(square(), SOFT, {".*": 0, "top": (0, -0.001)}, element="P2/P1")
    LoadPath(body).solve()
    assert body.u(body.mesh(0.05, 0.1)) == pytest.approx((0, -0.001), abs=1e-12)
    assert body.u(body.mesh(0.05, 0.0)) == pytest.approx((0, 0), abs=1e-12)


def test_kinematics_have_to_fit_the_mesh():
    with pytest.raises(InputError, match="3-dimensional; wanted: 2 dimensions for Axisymmetric"):
        Problem(MakeStructured3DMesh(nx=1, ny=1, nz=1), SOFT, {"bottom": 0}, kinematics=Axisymmetric())


def test_a_load_beyond_what_a_body_bears_ends_with_its_record_and_the_last_equilibrium():
    body = Problem(square(), SOFT, {"bottom": 0}, [TractionLoad("top", (0, -1e5))], element="P2/P1")
    with pytest.raises(ConvergenceError, match=r"load factor .* was reached") as error:
        LoadPath(body).solve()
    record = error.value.result
    assert 0 < record.factor < 1 and not record.converged and len(record.cuts) > 2
    assert body.factor.Get() == pytest.approx(record.factor, rel=1e-12) and body.min_det(body.x) > 0


def graded(n, steepness):
    def at(s):
        return 0.05 + 0.05 * tanh(steepness * (2 * s - 1)) / tanh(steepness)

    return MakeStructured3DMesh(hexes=False, nx=n, ny=n, nz=n, mapping=lambda x, y, z: (at(x), at(y), at(z)))


@pytest.mark.slow
def test_an_element_that_collapses_gets_a_guard_and_the_user_hears_of_it():
    # Corners of a bonded cube on a mesh graded towards them: without the guard the state ends at det F of .02.
    material = {".*": Material(NeoHooke(1e3), 1e5)}
    body = Problem(graded(6, 3.0), material, {"bottom": 0, "top": (0, 0, -0.02)}, element="P2/P1")
    with pytest.warns(CollapseWarning, match=r"P2/P1 .* barrier of 50 Pa"):
        record = LoadPath(body).solve()
    assert record.converged and record.min_det_F > 0.5 and "det F fell to" in record.guard
    assert body.force("top")[2] == pytest.approx(-9.19, abs=0.1)  # P3/P2 on a coarser mesh, without one: -9.187


def test_a_reused_factor_leads_to_the_same_state(monkeypatch):
    reused, found, forces = linear.reuse_factor, [], []

    def spy(*arguments):
        found.append(reused(*arguments))
        return found[-1]

    monkeypatch.setattr(linear, "reuse_factor", spy)
    for worth in (10**9, 0):
        monkeypatch.setattr("ngbrain.forward.solid.problem.WORTH_REUSING", worth)
        pressing = {"bottom": 0, "top": (0, 0, -0.02)}
        body = Problem(graded(4, 1.0), {".*": Material(NeoHooke(1e3), 1e5)}, pressing, element="P2/P1")
        LoadPath(body).solve(
            newton=Newton(rtol=1e-10, xtol=1e-9, max_contraction=0.0, spare_iterations=0, max_factorisations=40)
        )
        forces.append(body.force("top")[2])
        assert bool(found) == (worth == 0)
    assert any(found) and forces[0] == pytest.approx(forces[1], rel=1e-8)


def test_uphill_steps_spare_a_displacement_form_its_cuts():
    # K/μ = 5000 without a pressure: the tangent of a state takes the next one, which has turned, for far off.
    beam = MakeStructured2DMesh(quads=False, nx=8, ny=4, mapping=lambda x, y: (2 * x, y))
    tried, tips = {}, []
    for watch in (0, 4):
        body = Problem(
            beam, {".*": Material(NeoHooke(1e3), 5e6)}, {"left": 0}, [TractionLoad("right", (0, 40.0))], element="P2"
        )
        tried[watch] = LoadPath(body).solve(newton=Newton(max_climbs=watch)).tried
        tips.append(body.u(beam(2, 1))[1])
    print(tried, tips)
    assert tips[0] == pytest.approx(tips[1], rel=1e-5) and tips[0] > 0.3
    assert tried[4] < tried[0] / 1.5


def test_a_body_that_folds_is_not_passed_off_as_a_solution():
    # Half its height: the free side folds onto the plates, which it would touch.
    body = Problem(
        square(8, 1.0), {".*": Material(UnsplitNeoHooke(1.0), 1e3)}, {"bottom": 0, "top": (0, -0.5)}, element="P2/P1"
    )
    with pytest.warns(CollapseWarning, match=r"det F is 0\.0\d+ at a point though K/μ is 1e\+03"):
        LoadPath(body).solve()


def test_a_column_buckles_where_euler_says():
    # Both ends clamped: P = 4π² E' I / L², E' = 4μ for an incompressible plane; the softest mode goes unstable there.
    slender, mu = 30.0, 1e3
    mesh = MakeStructured2DMesh(quads=True, nx=2, ny=30, mapping=lambda x, y: (x, slender * y))
    euler = 4 * pi**2 / 12 / slender**2
    lowest = []
    shares = (0.9, 1.1)
    for share in shares:
        supports = {"bottom": 0, "top": (0, -share * euler * slender)}
        body = Problem(mesh, {".*": Material(NeoHooke(mu), 1e6)}, supports, element=f"P{3}/P{2}")
        assert LoadPath(body).solve().converged  # on the straight branch, stable or not
        value, motion = smallest_eigenvalue(body)
        lowest.append(value)
        bent, end = motion(mesh(0.5, slender / 2)), motion(mesh(0.5, 0.0))
        assert abs(bent[0]) > 100 * abs(bent[1]) and abs(bent[0]) > 100 * np.abs(end).max()
    assert lowest[0] > 0 > lowest[1]
    critical = np.interp(0, lowest[::-1], shares[::-1])
    print("buckles at", critical, "of Euler's load")
    assert critical == pytest.approx(1, abs=0.015)


def test_a_pressed_ball_of_revolution_is_the_plane_one_turned():
    # A cylinder pulled freely: homogeneous, so exact in any element.
    law = UnsplitNeoHooke(1e3)
    supports = {"bottom": (None, 0), "top": (None, 0.02), "left": (0, None)}
    body = Problem(square(2), {".*": Material(law, 2e4)}, supports, element="P2", kinematics=Axisymmetric())
    LoadPath(body).solve(newton=Newton(rtol=1e-10, xtol=1e-10))
    radial = body.u(body.mesh(0.1, 0.05))[0] / 0.1 + 1
    J, area = radial**2 * 1.2, pi * 0.1**2
    assert 1e3 * (radial - 1 / radial) + 2e4 * (J - 1) * J / radial == pytest.approx(0, abs=1e-5)
    assert body.force("top")[1] == pytest.approx(area * (1e3 * (1.2 - 1 / 1.2) + 2e4 * (J - 1) * J / 1.2), rel=1e-8)


class Scalar:
    """x³ + x = 10 t as a path from 0 to 2; states with |x| near `limit` count as inverted."""

    weights = np.ones(1)

    def __init__(self, limit=10.0):
        self.t, self.limit = 0.0, limit

    def load(self, x, t):
        self.t = t
        return x.copy()

    def residual(self, x):
        return x**3 + x - 10 * self.t, 10.0

    def factorise(self, x, r):
        slope = 3 * x**2 + 1
        return lambda r: r / slope

    def min_det(self, x):
        return self.limit - abs(float(x[0]))

    def step(self, newton, x, t, goal, guess):
        return newton.solve(self, guess)


def test_a_path_cuts_steps_that_fail_and_lengthens_them_again():
    x, record = follow(Scalar(2.2), Newton(rtol=1e-12, xtol=1e-12), np.zeros(1))
    assert x[0] == pytest.approx(2.0) and record.converged and record.factor == 1
    assert "inverted" in record.cuts[0]  # the tangent at 0 leads to 10
    sizes = np.diff([0, *(t for t, _ in record.history)])
    assert np.any(sizes[1:] > sizes[:-1])


def test_states_on_the_way_are_rough_and_the_last_is_not():
    newton = Newton(rtol=1e-12, xtol=1e-12)
    _, record = follow(Scalar(), newton, np.zeros(1), steps=4)
    ends = [step.residuals[-1] for _, step in record.history]
    assert not record.cuts and len(ends) == 4
    assert record.history[-1][1].iterations > record.history[1][1].iterations


def test_a_part_of_a_state_is_gone_on_from_where_it_is_inverted_itself():
    newton, path = Newton(rtol=1e-12, xtol=1e-12), Scalar(2.3)
    x, record = resume(path, newton, np.array([2.35]))
    assert x[0] == pytest.approx(2.0) and record.converged
    assert next(t for t, _ in record.history) == 0.9 and record.history[-1][0] == 1.0
    assert record.tried == sum(step.iterations for _, step in record.history)
    assert resume(path, newton, np.array([50.0])) is None
    assert resume(Scalar(1.9), newton, np.array([1.8])) is None  # 2, where it leads, is out of bounds


def test_a_path_that_leads_nowhere_says_how_far_it_came():
    x, record = follow(Scalar(1.5), Newton(rtol=1e-12, xtol=1e-12), np.zeros(1))
    assert not record.converged and 0.3 < record.factor < 0.5 and x[0] < 1.5
    assert "was reached" in record.reason and record.reason.startswith(f"load factor {record.factor:.4g}")


def test_a_factor_is_asked_for_what_it_is_to_solve():
    # At an equilibrium there is no residual, for which any old factor would seem good enough.
    class Asked(Scalar):
        asked = ()

        def factorise(self, x, r):
            self.asked = (*self.asked, float(abs(r[0])))
            return super().factorise(x, r)

    path = Asked()
    _, record = follow(path, Newton(rtol=1e-12, xtol=1e-12), np.zeros(1))
    assert record.converged and min(path.asked) > 0


def test_the_softest_motion_of_few_unknowns_is_found_whole(monkeypatch):
    tissue, down = {".*": Material(NeoHooke(1e3), 3e3)}, {"bottom": 0, "top": (0, 0, -2e-3)}
    body = Problem(block((0.02, 0.025, 0.03), 0.015), tissue, down, element="P2")
    LoadPath(body).solve()
    nearest, motion = smallest_eigenvalue(body)
    monkeypatch.setattr("ngbrain.forward.statics.stability.FEW", body.fes.ndof)
    whole, same = smallest_eigenvalue(body)
    assert nearest == pytest.approx(whole, rel=1e-8)
    a, b = (each.vec.FV().NumPy() for each in (motion, same))
    assert abs(a @ b) == pytest.approx(np.linalg.norm(a) * np.linalg.norm(b), rel=1e-6)
    held = Problem(MakeStructured3DMesh(nx=1, ny=1, nz=1), tissue, {".*": 0}, element="P1")
    assert np.isinf(smallest_eigenvalue(held)[0])
