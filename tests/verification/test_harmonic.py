"""Waves in closed form: slab, half space, cylinder, sphere, plane waves along and across fibres; rates; stiff volume."""

import ngsolve as ngs
import numpy as np
import pytest
from netgen import occ
from netgen.geom2d import SplineGeometry
from scipy.special import jv
from waves import cube, displacement, error, number, plane_wave, square

from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.material import Material
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import AbsorbingBoundary, Wave
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import NeoHooke, Shearing, TransverselyIsotropic
from ngbrain.materials.modulus import Springpot

RHO, HERTZ = 1000.0, 50.0
OMEGA = 2 * np.pi * HERTZ
G = 2000 + 800j
SIDE = 0.05


def slab(driven, form="P6", modulus=G, **options):
    """A strip in which a shear wave runs along x; its long sides roll, so that it is one-dimensional."""
    held = {"x": ".*", "y": "|".join(driven)}
    waves = [Wave(HERTZ, {end: (0, u) for end, u in driven.items()})]
    return HarmonicProblem(square(4, SIDE), Shearing(modulus), waves, bulk=1e5, form=form, dirichlet=held, **options)


@pytest.mark.parametrize("form", ["P6", "P6/P5", "P6/L2(4)"])
def test_slab_driven_on_one_face(form):
    body, k = slab({"left": 0, "right": 1e-3}, form), number(G, OMEGA)
    exact = 1e-3 / np.sin(k * SIDE) * ngs.CF((0, ngs.sin(k * ngs.x)))
    assert error(displacement(body), exact, body.mesh) < 5e-5


def test_slab_driven_on_both_faces():
    body, k = slab({"left": 1e-3, "right": 1e-3}), number(G, OMEGA)
    exact = 1e-3 / np.cos(k * SIDE / 2) * ngs.CF((0, ngs.cos(k * (ngs.x - SIDE / 2))))
    assert error(displacement(body), exact, body.mesh) < 5e-5


@pytest.mark.parametrize("modulus", [2000 + 0j, G])
def test_half_space(modulus):
    body = slab({"left": 1e-3}, modulus=modulus, absorbing=[AbsorbingBoundary("right", modulus, 1e5)])
    exact = 1e-3 * ngs.CF((0, ngs.exp(-1j * number(modulus, OMEGA) * ngs.x)))
    assert error(displacement(body), exact, body.mesh) < 5e-5


def test_a_pressure_wave_leaves_a_half_space_too():
    bulk, mesh = 6000.0, square(4, SIDE)
    k = OMEGA * np.sqrt(RHO / (bulk + 4 / 3 * G))
    held = {"x": "left", "y": "left|bottom|top"}
    wave = Wave(HERTZ, {"left": (1e-3, 0)})
    body = HarmonicProblem(
        mesh, Shearing(G), [wave], bulk=bulk, form="P6", dirichlet=held, absorbing=[AbsorbingBoundary("right", G, bulk)]
    )
    assert error(displacement(body), 1e-3 * ngs.CF((ngs.exp(-1j * k * ngs.x), 0)), mesh) < 5e-5


@pytest.mark.parametrize("modulus", [2000.0, G])
@pytest.mark.parametrize("fibre", [False, True])
@pytest.mark.parametrize("form", ["P5", "P5/P4"])
def test_axial_waves_in_a_cylinder(form, fibre, modulus):
    """Along fibres that lie along the axis the shear modulus is (1 + φ) times that across them."""
    law = TransverselyIsotropic(modulus, 1.3, 0.7, (0, 1, 0)) if fibre else Shearing(modulus)
    k, mesh = number((1.7 if fibre else 1) * modulus, OMEGA), square(5, SIDE)
    wave, held = Wave(HERTZ, {"right": (0, 1e-3)}), {"x": ".*", "y": "right"}
    body = HarmonicProblem(mesh, law, [wave], bulk=1e5, form=form, dirichlet=held, kinematics=Axisymmetric())
    u = displacement(body)
    for r in (0.001, 0.01, 0.023, 0.04):
        assert abs(u(mesh(r, 0.02))[1] / 1e-3 - jv(0, k * r) / jv(0, k * SIDE)) < 1e-3


@pytest.mark.parametrize("form", ["P5", "P5/P4"])
def test_waves_around_the_axis_of_a_cylinder(form):
    R, k = 0.05, number(G, OMEGA)
    geometry = SplineGeometry()
    geometry.AddCircle((0, 0), R, bc="side")
    mesh = ngs.Mesh(geometry.GenerateMesh(maxh=0.014))
    mesh.Curve(5)
    turned = 1e-3 * ngs.CF((-ngs.y, ngs.x)) / R
    u = displacement(HarmonicProblem(mesh, Shearing(G), [Wave(HERTZ, {"side": turned})], bulk=1e5, form=form))
    for r in (0.006, 0.02, 0.037):
        found = u(mesh(r * np.cos(0.3), r * np.sin(0.3)))
        wanted = 1e-3 * jv(1, k * r) / jv(1, k * R)
        assert abs(-found[0] * np.sin(0.3) + found[1] * np.cos(0.3) - wanted) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("form", ["P5", "P5/P4"])
def test_waves_in_a_sphere_turned_about_its_axis(form):
    """An eighth of it: the planes x = 0 and y = 0 see motion along their normals alone, z = 0 none."""
    R, modulus = 0.07, 2000 + 1000j
    ball = occ.Sphere((0, 0, 0), R)
    ball.faces.name = "side"
    brick = occ.Box((0, 0, 0), (R, R, R))
    for axis, name in ((occ.X, "x0"), (occ.Y, "y0"), (occ.Z, "z0")):
        brick.faces.Min(axis).name = name
    mesh = ngs.Mesh(occ.OCCGeometry(brick * ball).GenerateMesh(maxh=0.018))
    mesh.Curve(5)
    wave = Wave(HERTZ, {"side": 1e-3 * ngs.CF((-ngs.y, ngs.x, 0)) / R})
    held = {"x": "side|y0", "y": "side|x0", "z": "side|x0|y0|z0"}
    u = displacement(HarmonicProblem(mesh, Shearing(modulus), [wave], bulk=1e6, form=form, dirichlet=held))
    printed = {0.01: 0.219276 + 0.417868j, 0.03: -0.082345 - 0.345279j, 0.05: -0.317530 + 0.425114j}
    for r, wanted in printed.items():
        found = u(mesh(r * np.cos(0.5), r * np.sin(0.5), 1e-9))
        assert abs((np.cos(0.5) * found[1] - np.sin(0.5) * found[0]) / 1e-3 - wanted) < 0.01


LAWS = {
    "isotropic elastic": Shearing(2000.0),
    "isotropic viscoelastic": Shearing(G),
    "fibres elastic": TransverselyIsotropic(2000.0, 1.0, 0.6, (2.0, 1.0, 0.0)),
    "fibres viscoelastic": TransverselyIsotropic(G, 1.0, 0.6, (2.0, 1.0, 0.0)),
}
BULK = {"compressible": 8e3, "nearly incompressible": 2e6}


@pytest.mark.parametrize("volume", BULK)
@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("dim", [2, 3])
def test_plane_waves(dim, name, volume):
    """All eight bodies, the two shear waves (in the plane the one) and the pressure wave where there is one."""
    law, bulk = LAWS[name], BULK[volume]
    if dim == 2 and isinstance(law, TransverselyIsotropic):
        law = TransverselyIsotropic(law.mu, law.zeta, law.phi, law.fibre[:2])
    mesh = square(4, 0.04) if dim == 2 else cube(2, 0.02)
    mixed = volume != "compressible"
    order = 5 if dim == 2 else 3
    form = f"P{order}/P{order - 1}" if mixed else f"P{order}"
    for which in range(dim - 1 if mixed else dim):
        exact, _ = plane_wave(law, bulk, RHO, OMEGA, (1.0, 0.5, -0.7)[:dim], which, dim)
        body = HarmonicProblem(mesh, law, [Wave(HERTZ, {".*": exact})], bulk=bulk, form=form)
        found = error(displacement(body), exact, mesh)
        assert found < (1e-4 if dim == 2 else 5e-3), (which, found)


@pytest.mark.parametrize("angle", [0, 25, 45, 70, 90])
def test_speeds_along_fibres(angle):
    """Slow ρc² = μ(1 + φ cos²θ), fast ρc² = μ(1 + φ cos²2θ + ζ sin²2θ): the helper's waves are the published ones."""
    mu, zeta, phi, theta = 1500.0, 1.2, 0.5, np.radians(angle)
    law = TransverselyIsotropic(mu, zeta, phi, (1.0, 0.0, 0.0))
    slow = mu * (1 + phi * np.cos(theta) ** 2)
    fast = mu * (1 + phi * np.cos(2 * theta) ** 2 + zeta * np.sin(2 * theta) ** 2)
    found = [
        plane_wave(law, 1e12, RHO, OMEGA, (np.cos(theta), np.sin(theta), 0.0), which, 3)[1].real for which in (0, 1)
    ]
    assert found == pytest.approx(sorted([slow, fast]), rel=1e-6)


def manufactured(n, form, kinematics=None, fibre=None, bulk=1e6):
    """Error in L2 of u = curl ψ e^{0.7i} under a modulus that varies; its load by the weak form, stress by hand."""
    mesh = square(n, SIDE)
    x, y = ngs.x / SIDE, ngs.y / SIDE
    if kinematics is None:
        psi = (x * (1 - x) * y * (1 - y)) ** 2
        u = ngs.CF((psi.Diff(ngs.y), -psi.Diff(ngs.x)))
    else:
        psi = ((1 - x) * y * (1 - y)) ** 2
        u = ngs.CF((-ngs.x * psi.Diff(ngs.y), 2 * psi + ngs.x * psi.Diff(ngs.x)))
    exact = ngs.GridFunction(ngs.VectorH1(mesh, order=8, complex=True))
    exact.Set(1e-3 * np.exp(0.7j) * u)
    modulus = (2000 + 700j) * (1 + 0.4 * ngs.sin(60 * ngs.x) + 8 * ngs.y)
    law = Shearing(modulus) if fibre is None else TransverselyIsotropic(modulus, 0.8, 0.5, fibre)
    wave = Wave(HERTZ, {".*": exact})
    body = HarmonicProblem(mesh, law, [wave], bulk=bulk, form=form, kinematics=kinematics)
    test = body.fes.TestFunction()
    v = test[0] if body.mixed else test
    strains = [ngs.Sym(ngs.Grad(w)) for w in (exact, v)]
    weight = 1.0
    if kinematics is not None:
        weight = 2 * np.pi * ngs.x
        strains = [
            ngs.CF((e[0, 0], e[0, 1], 0, e[1, 0], e[1, 1], 0, 0, 0, w[0] / ngs.x), dims=(3, 3))
            for e, w in zip(strains, (exact, v), strict=True)
        ]
    strain, along = strains
    stress = 2 * modulus * strain
    if fibre is not None:
        M = ngs.OuterProduct(fibre, fibre)  # of a unit vector
        stretched = ngs.Trace(M * strain)
        stress += modulus * (2 * 0.5 * (M * strain + strain * M - 2 * stretched * M) + 4 * 0.8 * stretched * M)
        stress -= modulus * 4 * 0.8 / 3 * stretched * ngs.Id(M.dims[0])
    load = ngs.LinearForm(body.fes)
    inertia = OMEGA**2 * RHO * (exact[0] * v[0] + exact[1] * v[1])
    load += weight * (ngs.Trace(stress * along) - inertia) * ngs.dx(bonus_intorder=8)
    load.Assemble()
    body.load_vector = lambda number: load.vec.FV().NumPy().copy()
    return error(displacement(body), exact, mesh, weight)


FIELD = ngs.CF((ngs.cos(20 * ngs.x), ngs.sin(20 * ngs.x)))


@pytest.mark.parametrize("fibre", [None, FIELD], ids=["isotropic", "fibres"])
@pytest.mark.parametrize(("form", "p"), [("P2", 2), ("P3", 3), ("P2/P1", 2), ("P3/P2", 3), ("P4/L2(2)", 4)])
def test_rates(form, p, fibre):
    coarse, fine = (manufactured(n, form, fibre=fibre, bulk=1e6 if "/" in form else 1e4) for n in (6, 12))
    print(form, coarse, fine, np.log2(coarse / fine))
    assert np.log2(coarse / fine) > p + 0.85


@pytest.mark.parametrize("fibre", [None, ngs.CF((*FIELD, 0))], ids=["isotropic", "fibres"])
@pytest.mark.parametrize(("form", "p"), [("P2", 2), ("P3/P2", 3)])
def test_rates_of_bodies_of_revolution(form, p, fibre):
    coarse, fine = (manufactured(n, form, Axisymmetric(), fibre, 1e6 if "/" in form else 1e4) for n in (6, 12))
    print(form, coarse, fine, np.log2(coarse / fine))
    assert np.log2(coarse / fine) > p + 0.85


@pytest.mark.parametrize(("form", "p"), [("P2", 2), ("P2/P1", 2)])
def test_rates_in_space(form, p):
    law = LAWS["fibres viscoelastic"]
    bulk = 2e6 if "/" in form else 8e3
    exact, _ = plane_wave(law, bulk, RHO, OMEGA, (1.0, 0.5, -0.7), 0, 3)
    errors = []
    for n in (2, 4):
        body = HarmonicProblem(cube(n, 0.02), law, [Wave(HERTZ, {".*": exact})], bulk=bulk, form=form)
        errors.append(error(displacement(body), exact, body.mesh))
    assert np.log2(errors[0] / errors[1]) > p + 0.85, errors


@pytest.mark.parametrize("form", ["P2/P1", "P3/P2", "P4/L2(2)"])
def test_mixed_forms_do_not_see_the_bulk_modulus(form):
    errors = [manufactured(6, form, bulk=ratio * 2000) for ratio in (10, 1e2, 1e4, 1e6, 1e8)]
    assert max(errors) < 1.01 * min(errors), errors


def test_a_bulk_modulus_with_loss():
    bulk, mesh = 6000 + 1500j, square(4, 0.04)
    exact, value = plane_wave(Shearing(G), bulk, RHO, OMEGA, (1.0, 0.4), 1, 2)
    assert value == pytest.approx(bulk + 4 / 3 * G, rel=1e-12)  # the pressure wave
    for form in ("P5", "P5/P4"):
        body = HarmonicProblem(mesh, Shearing(G), [Wave(HERTZ, {".*": exact})], bulk=bulk, form=form)
        assert error(displacement(body), exact, mesh) < 1e-4


def test_loads_of_several_frequencies_and_a_law_of_frequency():
    springpot = Springpot(kappa=120.0, exponent=0.4)
    waves = [Wave(hertz, {"left": (0, 0), "right": (0, u)}) for hertz, u in ((30, 1e-3), (50, 1e-3), (30, 2e-3j))]
    held = {"x": ".*", "y": "left|right"}
    body = HarmonicProblem(
        square(4, SIDE), lambda omega: Shearing(springpot(omega)), waves, bulk=1e5, form="P6", dirichlet=held
    )
    factors = body.factorise()
    for k, g in enumerate(body.prescribed):
        factors.solve_wave(k, g)
    assert factors.solves.factorisations == 2
    for wave, u, found in zip(waves, (1e-3, 1e-3, 2e-3j), body.solve(), strict=True):
        k = number(springpot(wave.omega), wave.omega)
        exact = u / np.sin(k * SIDE) * ngs.CF((0, ngs.sin(k * ngs.x)))
        assert error(found, exact, body.mesh) < 3e-4


@pytest.mark.parametrize("form", ["P6", "P6/P5"])
def test_a_traction_and_a_force(form):
    """Shaken by a traction on one face, and by gravity's like inside, clamped on the other."""
    k, held = number(G, OMEGA), {"x": ".*", "y": "left"}
    waves = [Wave(HERTZ, traction={"right": (0, 3.0)}), Wave(HERTZ, force=(0, 500 + 100j))]
    body = HarmonicProblem(square(4, SIDE), Shearing(G), waves, bulk=1e5, form=form, dirichlet=held)
    pulled, shaken = (u.components[0] if body.mixed else u for u in body.solve())
    exact = 3.0 / (G * k * np.cos(k * SIDE)) * ngs.CF((0, ngs.sin(k * ngs.x)))
    assert error(pulled, exact, body.mesh) < 1e-4
    shape = ngs.cos(k * (ngs.x - SIDE)) / np.cos(k * SIDE) - 1
    exact = (500 + 100j) / (RHO * OMEGA**2) * ngs.CF((0, shape))
    assert error(shaken, exact, body.mesh) < 1e-4


@pytest.mark.parametrize("form", ["P3", "P3/P2"])
def test_without_frequency_it_is_statics(form):
    mesh, drive = square(4, SIDE), {"bottom": 0, "top": (1e-8, -2e-8)}
    static = Problem(mesh, {".*": Material(NeoHooke(2000.0), bulk=1e5)}, drive, element=form)
    LoadPath(static).solve()
    waves = [Wave(0.0, {"top": (1e-8, -2e-8)})]
    body = HarmonicProblem(mesh, Shearing(2000.0), waves, bulk=1e5, form=form, dirichlet="bottom|top")
    assert error(displacement(body), static.u, mesh) < 1e-5


def test_held_boundaries_that_meet_share_nothing_else():
    mesh = square(3, SIDE)
    wave = Wave(HERTZ, {"left": (1e-3, 0), "top": (0, 2e-3j), "right": (0, 0)})
    u = displacement(HarmonicProblem(mesh, Shearing(G), [wave], bulk=1e5, form="P3", dirichlet="left|right|top"))
    assert u(mesh(0, 0.02)) == pytest.approx((1e-3, 0), abs=1e-12)
    assert u(mesh(0.02, SIDE)) == pytest.approx((0, 2e-3j), abs=1e-12)
    assert u(mesh(SIDE, 0.02)) == pytest.approx((0, 0), abs=1e-12)
