"""Statics against other codes' digits, Cook's membrane, closed forms and patch tests."""

from math import inf, pi, sin

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh
from scipy.optimize import brentq
from statics import CUBE, SIDE, bonded, cook, cube, tight

from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.common.loads import BodyForce, Spring, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import NeoHooke, UnsplitNeoHooke, squared_log
from ngbrain.mesh import load
from ngbrain.solvers.newton import Newton

# A bonded cube, 4 × 4 × 4 hexahedra, pressed by a fifth: force (N) on the top by FElupe, dolfinx, scikit-fem.
DIGITS = {ElementPair(2): -10.76892364, ElementPair(2, 1): -9.254280487, ElementPair(2, 1, False): -9.412578927}


@pytest.mark.parametrize("form", DIGITS, ids=str)
def test_the_digits_of_other_codes(form):
    body = bonded(cube(4, hexes=True), form)
    LoadPath(body).solve(newton=tight())
    print(form, body.force("top")[2] / DIGITS[form] - 1)
    assert body.force("top")[2] == pytest.approx(DIGITS[form], rel=1e-9)
    assert body.force("top") == pytest.approx(-body.force("bottom"), abs=1e-8)


# The same between rollers, its top pressed to a wave: smooth. Force on the top, weighted by the wave.
WAVE = ngs.cos(pi * ngs.x / SIDE) * ngs.cos(pi * ngs.y / SIDE)
ROLLERS = {"back|front": (0, None, None), "left|right": (None, 0, None), "bottom": 0, "top": (0, 0, -0.1 * SIDE * WAVE)}


@pytest.mark.parametrize(("n", "size"), [(2, 2.5e-4), (3, 5e-5)])
def test_a_smooth_body_gets_fourth_order(n, size):
    body = Problem(cube(n), CUBE, ROLLERS)
    record = LoadPath(body).solve(newton=tight())
    error = body.conjugate(ngs.CF((0, 0, WAVE)), "top") / -2.250171 - 1
    print(n, body.form, error, record.tried)
    assert record.element.startswith("P4/L2(2): ") and "smooth" in record.element
    assert abs(error) < size


@pytest.mark.parametrize(
    ("mesh", "supports", "ratio", "form", "why"),
    [
        (cube(2), {"bottom": 0, "top": (0, 0, -1e-3)}, 1e2, "P2/P1", "a clamped boundary meets a free one"),
        (load("idealised_head"), {"skull": 0}, 1e3, "P2/P1", "4 regions"),
        (cook(8), {".*": 0}, 1e3, "P4/L2(2)", "smooth"),
        (cube(2), {"bottom": 0}, 20.0, "P2", "does not lock"),
        (cube(2), {"bottom": 0}, 20.1, "P2/P1", "clamped"),
    ],
    ids=["free sides", "regions", "held all round", "compressible", "just not"],
)
def test_the_form_is_chosen_with_a_reason(mesh, supports, ratio, form, why):
    chosen = Problem(mesh, {".*": Material(NeoHooke(1e3), ratio * 1e3)}, supports).choice["element"]
    assert chosen.startswith(f"{form}: ") and why in chosen, chosen


# Cook's membrane: N, mm.

MEMBRANE = {".*": Material(UnsplitNeoHooke(80.194), 400889.806, change=squared_log)}


def pulled(mesh, form, traction=6.25, steps=1):
    """Displacements of the upper right corner and of the middle of the pulled side."""
    body = Problem(mesh, MEMBRANE, {"left": 0}, [TractionLoad("right", (0, traction))], element=form)
    LoadPath(body).solve(steps, tight())
    return np.array([*body.u(mesh(48, 60)), body.u(mesh(48, 52))[1]])


def test_cooks_membrane_of_fourth_order():
    for refinements, wanted in ((5, (6.93455, 6.96292)), (8, (6.93485, 6.9632))):
        found = pulled(cook(4, refinements), "P4/P3")
        print(refinements, found)
        assert found[1:] == pytest.approx(wanted, abs=5e-5)
    assert found[1] == pytest.approx(6.9346, abs=5e-4)


COOK = {2: (-5.80283, 6.91786, 6.94965), 4: (-5.76773, 6.90045, 6.93761), 8: (-5.70109, 6.85547, 6.90022)}


@pytest.mark.parametrize("maxh", COOK)
def test_cooks_membrane_of_second_order(maxh):
    found = pulled(cook(maxh), "P2/P1")
    print(maxh, found / COOK[maxh] - 1)
    assert found == pytest.approx(COOK[maxh], rel=5e-3)  # the meshes are not the same ones


def test_displacements_of_first_order_lock_in_cooks_membrane():
    found = [pulled(cook(maxh), "P1", steps=5)[1] for maxh in (8, 4)]
    print("locked", np.array(found) / 6.935)
    assert max(found) < 0.7 * 6.935


def test_an_overload_ends_in_one_state_whatever_the_steps():
    found = [pulled(cook(4), "P2/P1", 25.0, steps) for steps in (1, 2, 5)]
    print(found)
    assert found[0][1] == pytest.approx(18.600739, rel=1e-3)
    assert found[1] == pytest.approx(found[0], rel=1e-8) and found[2] == pytest.approx(found[0], rel=1e-8)


# Closed forms, those of linear theory at strains of 1e-5.

FORMS = ("P2", "P2/P1", "P3/P2", "P4/L2(2)")


@pytest.mark.parametrize("form", FORMS)
def test_a_column_under_its_own_weight(form):
    # Between rollers: u = -f (L z - z²/2) / (K + 4μ/3).
    mu, bulk, f = 1e3, 5e4, 20.0
    sides = {"back|front": (0, None, None), "left|right": (None, 0, None), "bottom": (None, None, 0)}
    body = Problem(cube(2), {".*": Material(NeoHooke(mu), bulk)}, sides, [BodyForce((0, 0, -f))], element=form)
    LoadPath(body).solve(newton=tight())
    for height in (0.03, 0.1):
        wanted = -f * (SIDE * height - height**2 / 2) / (bulk + 4 / 3 * mu)
        assert body.u(body.mesh(0.02, 0.07, height))[2] == pytest.approx(wanted, rel=1e-4)


def test_the_foot_bears_the_whole_weight():
    body = Problem(cube(2), CUBE, {"bottom": 0}, [BodyForce((0, 0, -20.0))])
    LoadPath(body).solve(newton=tight())
    assert body.force("bottom")[2] == pytest.approx(20 * SIDE**3, rel=1e-8)


@pytest.mark.parametrize("form", FORMS[1:])
@pytest.mark.parametrize("traction", [-900.0, 700.0])
def test_a_pulled_bar_without_change_of_volume(form, traction):
    stretch = brentq(lambda s: 1e3 * (s - s**-2) - traction, 0.5, 2)
    supports = {"back": (0, None, None), "left": (None, 0, None), "bottom": (None, None, 0)}
    bar = {".*": Material(NeoHooke(1e3), inf)}
    body = Problem(cube(2), bar, supports, [TractionLoad("top", (0, 0, traction))], element=form)
    LoadPath(body).solve(newton=tight())
    wide, high = (stretch**-0.5 - 1) * SIDE, (stretch - 1) * SIDE
    assert body.u(body.mesh(SIDE, SIDE, SIDE)) == pytest.approx((wide, wide, high), rel=1e-8)


@pytest.mark.parametrize("form", FORMS)
def test_a_block_on_springs(form):
    # Nothing else holds it: ∫ k u dA over its foot is the load, at any strain.
    stiffness, traction = 3e4, np.array([40.0, -20.0, -90.0])
    loads = [Spring("bottom", stiffness), Spring("top", 2 * stiffness), TractionLoad("top", tuple(traction))]
    body = Problem(cube(2), CUBE, {}, loads, element=form)
    LoadPath(body).solve(newton=tight())
    borne = [
        stiffness * np.array(ngs.Integrate(body.u, body.mesh, ngs.BND, definedon=body.mesh.Boundaries(side)))
        for side in ("bottom", "top")
    ]
    assert borne[0] + 2 * borne[1] == pytest.approx(traction * SIDE**2, rel=1e-8)
    assert np.linalg.norm(borne[0]) > 0.05 * np.linalg.norm(borne[1])


def distorted(dim, solid):
    """A structured mesh of the unit square or cube, its inner vertices moved."""

    def moved(*x):
        bump = 0.12 * np.prod([sin(pi * c) for c in x])
        return tuple(c + bump * (-1) ** i for i, c in enumerate(x))

    if dim == 2:
        return MakeStructured2DMesh(quads=solid, nx=3, ny=3, mapping=lambda x, y: moved(x, y))
    return MakeStructured3DMesh(hexes=solid, nx=2, ny=2, nz=2, mapping=lambda x, y, z: moved(x, y, z))


@pytest.mark.parametrize("nu", [0.3, 0.49, 0.4999])
@pytest.mark.parametrize("form", ["P1", "P2", "P3", "P2/P1", "P3/P2", "P4/L2(2)"])
@pytest.mark.parametrize("solid", [False, True], ids=["simplices", "quads and hexes"])
@pytest.mark.parametrize("dim", [2, 3])
def test_patch(dim, solid, form, nu):
    # The affine state is exact, its pressure constant. J = 1.001: a large pressure costs digits.
    F = np.eye(dim) + 0.1 * np.array([[1.0, 0.5, -0.3], [-0.7, -0.8, 0.4], [0.2, 0.6, 0.9]])[:dim, :dim]
    slope = F * (1.001 / np.linalg.det(F)) ** (1 / dim) - np.eye(dim)
    point = (ngs.x, ngs.y, ngs.z)[:dim]
    affine = ngs.CF(tuple(sum(float(a) * c for a, c in zip(row, point, strict=True)) for row in slope))
    bulk = 2 * (1 + nu) / (3 * (1 - 2 * nu))
    body = Problem(distorted(dim, solid), {".*": Material(NeoHooke(1.0), bulk)}, {".*": affine}, element=form)
    LoadPath(body).solve(newton=Newton(rtol=1e-10, xtol=5e-11))
    apart = ngs.sqrt(ngs.InnerProduct(body.u - affine, body.u - affine))
    points = body.mesh.MapToAllElements(body.tissue.rules, ngs.VOL)
    size = np.max(np.abs(body.u(points)))
    assert np.max(apart(points)) < 1e-10 * size
    if body.p is not None:
        assert body.p(points) == pytest.approx(1e-3 * bulk, rel=1e-7)
