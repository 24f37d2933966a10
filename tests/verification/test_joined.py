"""What came together in one mechanics, against closed forms: contact and friction in the plane and axisymmetric, buckling."""

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh
from rigid_indenter import Indenter, forces
from scipy.optimize import brentq

from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import Spring
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper, run_load_history
from ngbrain.materials import NeoHooke, Prony

SIDE, MU = 0.02, 1e3


def slid(quads, along):
    """Forces (N/m) over time of a relaxing block under a plate that presses it and then slides, rubbing with .1.

    along  the way that friction knows the plate by: how far it goes along the block, or the length of its way, which turns
    """
    mesh = MakeStructured2DMesh(quads=quads, nx=4, ny=4, mapping=lambda x, y: (SIDE * x, SIDE * y))
    plate = Indenter((0.0, 1.0, 4.0), (0, 5e-4, 5e-4), (0, 0, 3e-3))
    way, moves = (plate.along, lambda x, way: way * ngs.CF((1.0, 0.0))) if along else (plate.path, plate.moves)
    contact = RigidContact("top", lambda x: SIDE - plate.down - x[1], 1e7, 1e-5, 0.9, way)
    tissue, found = {".*": Material(Prony(NeoHooke(MU), [0.5], [2.0]), 1e4)}, []
    contacts = [contact, Friction(contact, 0.1, 5e-5, moves)]
    body = Problem(mesh, tissue, {"bottom": 0}, contacts=contacts, element="P2/P1")
    TimeStepper(body, plate, StepControl(0.25), 1e-3).run(lambda b, at, record: found.append((at.t, *forces(b))))
    return np.array(found).T


@pytest.mark.parametrize("quads", [False, True])
def test_full_slide_is_amontons(quads):
    """All of the top slides in the end: T = μ N."""
    t, right, up = slid(quads, along=True)
    assert -right[t > 3.0] / up[t > 3.0] == pytest.approx(0.1, rel=1e-6)
    assert np.abs(right[t < 1.01] / up[t < 1.01]).max() < 0.05


def test_a_tool_may_go_down_and_then_along():
    """Friction knows it by one way, which turns; a plate may be known by what it goes along alone, and rubs alike."""
    (_, right, up), (_, right_too, up_too) = (slid(False, along) for along in (True, False))
    assert right_too == pytest.approx(right, rel=1e-9, abs=1e-9 * np.abs(up).max())
    assert up_too == pytest.approx(up, rel=1e-9)


def indented(n, depth, radius=0.02, size=0.02):
    """Force (N) of a rigid ball that goes `depth` into an axisymmetric block ten contact radii wide, with elements graded to it."""
    mesh = MakeStructured2DMesh(
        quads=True, nx=n, ny=n, mapping=lambda x, y: (size * x**2.5, size * (1 - (1 - y) ** 2.5))
    )
    ball = Indenter((0.0, 1.0), (0.0, depth))
    met = RigidContact(
        "top", lambda x: ngs.Norm(x - ngs.CF((0.0, size + radius - ball.down))) - radius, 1e8, 1e-7, 0.99
    )
    body = Problem(
        mesh, {".*": Material(NeoHooke(MU), 1e5)}, {"bottom": (None, 0), "left": (0, None)}, contacts=[met],
        element="P2/P1", kinematics=Axisymmetric(),
    )  # fmt: skip
    LoadPath(body, ball).solve(steps=4)
    return float(body.force("bottom")[1])


def test_a_ball_on_an_axisymmetric_block_is_hertz():
    """F = 4/3 E/(1 - ν²) R^½ d^(3/2); a block of finite depth is stiffer by what Dimitriadis et al. 2002 give."""
    depth, radius, size = 1e-4, 0.02, 0.02
    nu = (3e5 - 2e3) / (2 * (3e5 + 1e3))
    hertz = 4 / 3 * 2 * MU * (1 + nu) / (1 - nu**2) * np.sqrt(radius) * depth**1.5
    chi = np.sqrt(radius * depth) / size
    slab = 1 + 0.884 * chi + 0.781 * chi**2 + 0.386 * chi**3 + 0.0048 * chi**4  # on a foundation that it slides on
    found = indented(16, depth)
    print(found / hertz, found / (hertz * slab))
    assert found == pytest.approx(hertz * slab, rel=0.03)


def test_a_maxwell_bar_between_plates():
    """Small strain: the plate's force relaxes with the law, whether its bar is compressed by a support or by a plate."""
    g, tau, times = 0.8, 3.0, np.array([0, 0.01, 0.5, 1, 2, 4, 8.0])
    mesh = MakeStructured2DMesh(quads=True, nx=2, ny=2, mapping=lambda x, y: (SIDE * x, SIDE * y))
    tissue = {".*": Material(Prony(NeoHooke(MU), [g], [tau]), 1e7)}
    rollers, strain = {"bottom": (None, 0), "left": (0, None)}, 3e-4
    held = Problem(mesh, tissue, rollers | {"top": (None, -strain * SIDE)}, element="P2/P1")
    by_support = np.array(run_load_history(held, times, np.minimum(times / 0.01, 1), lambda t: held.force("top")[1]))
    plate = Indenter((0.0, 0.01, 8.0), (0, strain * SIDE, strain * SIDE))
    contact = RigidContact("top", lambda x: SIDE - plate.down - x[1], 1e8, 1e-8, 0.999, plate.along)
    pressed, rows = Problem(mesh, tissue, rollers, contacts=[contact], element="P2/P1"), []
    TimeStepper(pressed, plate, StepControl(0.01, dt_max=0.25), 1e-3).run(
        lambda b, at, r: rows.append((at.t, -forces(b)[1]))
    )
    t, by_plate = np.array(rows).T
    ramp = tau / 0.01 * (1 - np.exp(-0.01 / tau))

    def exact(t):
        return -4 * MU * strain * SIDE * (1 - g + g * ramp * np.exp(-(t - 0.01) / tau))

    assert by_support[1:] == pytest.approx(exact(times[2:]), rel=2e-3)
    assert by_plate[t > 0.4] == pytest.approx(exact(t[t > 0.4]), rel=5e-3)


@pytest.mark.filterwarnings("ignore::ngbrain.errors.StabilityWarning")
@pytest.mark.parametrize("slenderness", [4, 20])
def test_a_strut_buckles_where_it_should(slenderness):
    """Plane strain, incompressible, between guides that may sway; the straight state goes on, and after every load step the sign
    of the tangent's smallest eigenvalue says on which side of the critical stretch λ it is.

    A strut of thickness 2h and length π/k, of Neo-Hooke, bends where (1 + λ⁴)² tanh(kh/λ²) = 4λ² tanh(kh) (Biot 1963, by the
    stream function of an increment); a slender one by Euler's strain, (kh)²/3.
    """
    length, thick = 1.0, 1.0 / slenderness
    kh = np.pi / length * thick / 2

    def unbalanced(stretch):
        return (1 + stretch**4) ** 2 * np.tanh(kh / stretch**2) - 4 * stretch**2 * np.tanh(kh)

    euler = kh**2 / 3
    critical = brentq(unbalanced, 1 - 1.5 * euler, 1 - 0.5 * euler)
    assert slenderness < 20 or 1 - critical == pytest.approx(euler, rel=0.02)
    mesh = MakeStructured2DMesh(quads=True, nx=1, ny=10, mapping=lambda x, y: (thick * x, length * y))
    tissue = {".*": Material(NeoHooke(MU), 1e8)}
    guides = {"bottom": (None, 0), "top": (None, 2 * (critical - 1) * length)}
    # A soft spring keeps the strut from drifting sideways; what bends need not stretch it.
    body, pressed = Problem(mesh, tissue, guides, [Spring("bottom", MU)], element="P4/P3"), []
    record = LoadPath(body).solve(steps=15, eigenvalues=True, callback=lambda t: pressed.append(body.force("top")[1]))
    t, found = np.array(record.eigenvalues).T
    stretch = 1 + 2 * t * (critical - 1)
    crossing = 1 - np.interp(0.0, -found, 1 - stretch)
    print(critical, crossing, euler, found)
    assert len(found) == 15 and np.all((found > 0) == (stretch > critical))
    assert 1 - crossing == pytest.approx(1 - critical, rel=0.01)
    assert pressed == pytest.approx(MU * (stretch - stretch**-3) * thick, rel=2e-3)
