"""Gravity, the fluid around a body, and swelling, against closed forms."""

import ngsolve as ngs
import numpy as np
import pytest
from scipy.optimize import brentq
from statics import SIDE, cube, square, tight

from ngbrain.errors import InputError
from ngbrain.forward import BodyForce, FluidPressure, LoadPath, Material, Problem, Spring, run_load_history
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.materials import HolzapfelGasserOgden, NeoHooke, Ogden, Prony
from ngbrain.mesh import block

G, WATER = 9.81, 1000.0
SIDES = {"back|front": (0, None, None), "left|right": (None, 0, None)}
CORNER = {"back": (0, None, None), "left": (None, 0, None), "bottom": (None, None, 0)}


def mean_gradient(body):
    """Mean deformation gradient (3, 3)."""
    F = ngs.Id(3) + ngs.Grad(body.u)
    return np.array(ngs.Integrate(F, body.mesh)).reshape(3, 3) / ngs.Integrate(ngs.CF(1), body.mesh)


@pytest.mark.parametrize("density", [10.0, 6e3])
def test_a_confined_column_under_its_own_weight(density):
    """P₃₃(λ) = -ρ g (H - Z) at every height: u = ∫ (λ - 1) dZ, for small and for large strain."""
    mu, bulk = 1e3, 5e3

    def stretch(Z):
        def nominal(k):
            return mu * (k ** (1 / 3) - (2 + k**2) / 3 * k ** (-5 / 3)) + bulk * (k - 1) + density * G * (SIDE - Z)

        return brentq(nominal, 0.2, 1.0 + 1e-9)

    points, weights = np.polynomial.legendre.leggauss(12)
    top = sum(w / 2 * SIDE * (stretch(SIDE * (1 + x) / 2) - 1) for x, w in zip(points, weights, strict=True))
    loads = [BodyForce((0, 0, -density * G))]
    body = Problem(cube(2), {".*": Material(NeoHooke(mu), bulk)}, {**SIDES, "bottom": 0}, loads, element="P3")
    LoadPath(body).solve(newton=tight())
    assert body.u(body.mesh(SIDE / 2, SIDE / 2, SIDE - 1e-9))[2] == pytest.approx(top, rel=3e-4)
    assert top == pytest.approx(-density * G * SIDE**2 / 2 / (bulk + 4 / 3 * mu), rel=5e-3 if density < 100 else 1)


@pytest.mark.parametrize("element", ["P2", "P2/P1", "P3/P2"])
def test_the_fluid_lifts_by_the_weight_of_what_a_deformed_body_displaces(element):
    """To round-off on straight elements, at any state, with a force through the middle of what is displaced (Archimedes)."""
    mesh = block((0.1, 0.07, 0.12), 0.07)
    way = np.array((0.4, -0.3, -0.8))
    body = Problem(
        mesh,
        {".*": Material(NeoHooke(1e3), 1e4)},
        {"bottom": 0},
        [FluidPressure(tuple(way), 0.4, density=7.0)],
        element=element,
    )
    body.u.Set(0.2 * ngs.CF((ngs.y * ngs.z, ngs.x + ngs.z**2, 0.3 * ngs.x * ngs.y)) * 3)
    body.factor.Set(1.0)
    forces, unit = -body.contact_forces(), ngs.GridFunction(body.u.space)
    J = ngs.Det(ngs.Id(3) + ngs.Grad(body.u))
    displaced = ngs.Integrate(J, mesh, order=12)
    found = []
    for i in range(3):
        unit.Set(ngs.CF(tuple(float(i == j) for j in range(3))))
        found.append(unit.vec.FV().NumPy() @ forces)
    assert abs(displaced / ngs.Integrate(ngs.CF(1), mesh) - 1) > 1e-3
    assert found == pytest.approx(-7.0 * way * displaced, rel=1e-10)


def test_a_floating_body_finds_its_draught():
    hold, k = 1.0, 1.0 / SIDE**2  # a spring of 1 N/m from above
    loads = [BodyForce((0, 0, -600 * G)), FluidPressure((0, 0, -WATER * G), SIDE / 2), Spring("top", k)]
    body = Problem(
        cube(1), {".*": Material(NeoHooke(1e5), 1e8)}, {"back|front|left|right": (0, 0, None)}, loads, element="P2/P1"
    )
    LoadPath(body).solve()
    sunk = -ngs.Integrate(body.u[2], body.mesh) / SIDE**3
    assert sunk == pytest.approx((600 - 500) * G * SIDE**3 / (WATER * G * SIDE**2 + hold), rel=1e-4)


def test_only_what_is_below_the_level_is_lifted():
    for level, share in ((0.07, 0.7), (0.2, 1.0), (-0.01, 0.0)):
        loads = [FluidPressure((0, 0, -WATER * G), level)]
        body = Problem(cube(2), {".*": Material(NeoHooke(1e6), 1e9)}, {"bottom": 0}, loads, element="P2/P1")
        LoadPath(body).solve()
        assert body.force("bottom")[2] == pytest.approx(-share * WATER * G * SIDE**3, rel=1e-3, abs=1e-9)


def test_a_section_and_a_body_of_revolution_float_too():
    mesh = square(2, size=SIDE)
    for kinematics, size in ((None, SIDE**2), (Axisymmetric(), np.pi * SIDE**3)):
        loads, held = [FluidPressure((0, -WATER * G), 1.0)], {"bottom": 0, "left": (0, None)}
        body = Problem(mesh, {".*": Material(NeoHooke(1e6), 1e9)}, held, loads, element="P2/P1", kinematics=kinematics)
        LoadPath(body).solve()
        assert body.force("bottom")[1] == pytest.approx(-WATER * G * size, rel=1e-3)


def test_nothing_presses_in_a_fluid_of_the_same_density():
    """A closed space full of fluid: an incompressible body of that density only carries the fluid's pressure."""
    loads = [BodyForce((0, 0, -WATER * G)), FluidPressure((0, 0, -WATER * G), SIDE, drained=False)]
    body = Problem(cube(2), {".*": Material(NeoHooke(1e3), np.inf)}, {"bottom": 0}, loads, element="P2/P1")
    LoadPath(body).solve()
    assert np.abs(body.u.vec.FV().NumPy()).max() < 1e-9
    assert body.p(body.mesh(0.03, 0.04, 0.02)) == pytest.approx(-WATER * G * 0.08)


def test_a_fluid_needs_a_weight():
    with pytest.raises(InputError, match=r"FluidPressure\.weight"):
        FluidPressure((0, 0, 0), 0.1)


# Swelling.

LAWS = {
    "Neo-Hooke": NeoHooke(1e3),
    "Ogden": Ogden(1e3, -19.0),
    "fibres": NeoHooke(1e3) + HolzapfelGasserOgden(1.0, 2e3, 1.0, 0.0, (1.0, 0.0, 0.0)),
}


@pytest.mark.parametrize("element", ["P2", "P2/P1", "P4/L2(2)"])
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_free_body_swells_without_stress(law, element):
    body = Problem(cube(1), {".*": Material(law, 1e4, swelling=0.331)}, CORNER, element=element)
    LoadPath(body).solve(newton=tight())
    assert mean_gradient(body) == pytest.approx(1.1 * np.eye(3), abs=1e-7)
    assert np.abs(body.force("bottom")).max() < 1e-6 and abs(body.energy) < 1e-9


def test_an_enclosed_body_that_swells_is_pressed():
    """J = 1: the Cauchy stress is -K s/(1 + s), the same in all directions."""
    K, s = 1e5, 0.05
    for element in ("P2", "P2/P1"):
        body = Problem(cube(2), {".*": Material(Ogden(1e3, -19.0), K, swelling=s)}, {".*": 0}, element=element)
        LoadPath(body).solve()
        assert np.abs(body.u.vec.FV().NumPy()).max() < 1e-12
        if body.p is not None:
            assert body.p(body.mesh(0.03, 0.04, 0.02)) == pytest.approx(-K * s / (1 + s))
    with pytest.raises(InputError, match=r"Material.swelling is -1"):
        Material(NeoHooke(1e3), 1e5, swelling=-1.0)


def test_between_two_plates_it_stretches_sideways():
    """Plane strain without stress sideways: μ̃ from the energy of F_e = diag(a, a, 1)/(1 + s)^(1/3), minimised by hand."""
    mu, K, s = 1e3, 5e3, 0.2
    held = {**CORNER, "top": (None, None, 0)}
    body = Problem(cube(1), {".*": Material(NeoHooke(mu), K, swelling=s)}, held, element="P2")
    LoadPath(body).solve(newton=tight())

    def slope(a):
        h = 1e-6

        def energy(a):
            J = a * a
            return (1 + s) * (mu / 2 * (J ** (-2 / 3) * (2 * a * a + 1) - 3) + K / 2 * (J / (1 + s) - 1) ** 2)

        return (energy(a + h) - energy(a - h)) / (2 * h)

    assert mean_gradient(body)[0, 0] == pytest.approx(brentq(slope, 1.0, 1.2), rel=1e-6)


def test_viscoelastic_tissue_swells_without_stress_at_every_moment():
    body = Problem(
        cube(1), {".*": Material(Prony(NeoHooke(1e3), [0.5], [1.0]), 1e5, swelling=0.331)}, CORNER, element="P2/P1"
    )
    times = np.linspace(0.0, 4.0, 5)
    found = run_load_history(body, times, np.minimum(times / 2, 1), lambda t: (t, mean_gradient(body)[0, 0]))
    assert [a for _, a in found] == pytest.approx([(1 + 0.331 * min(t / 2, 1)) ** (1 / 3) for t, _ in found], rel=1e-6)
