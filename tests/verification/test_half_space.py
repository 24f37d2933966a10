"""Rigid bodies on an incompressible half space: Hertz with Cattaneo's and Mindlin's partial slip; Flamant and Boussinesq, far from
where a cylinder or ball presses; the flat punch.

Incompressible, normal and tangential tractions do not disturb each other (Dundurs' coupling is zero).
Source: Johnson, Contact Mechanics (1985), 10.1017/CBO9781139171731, 2.2, 3.2, 3.8, 4.2, 7.2.
"""

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh
from rigid_indenter import Indenter, forces

from ngbrain.forward import (
    Axisymmetric,
    Friction,
    LoadPath,
    Material,
    PlaneStrain,
    Problem,
    RigidContact,
    StepControl,
    TimeStepper,
)
from ngbrain.materials import NeoHooke

MU, RADIUS, COEFFICIENT = 1e3, 0.05, 0.3
TISSUE = {".*": Material(NeoHooke(MU), 1e6 * MU)}


def graded(near, first, beyond, far):
    """From [0, 1] to lengths (m): `near` even elements up to `first`, then `beyond` growing ones up to `far`."""

    def at(s):
        k = s * (near + beyond)
        return first * k / near if k <= near else first * (far / first) ** ((k - near) / beyond)

    return at


def mirrored(at):
    """The same from [0, 1] to both sides of 0."""
    return lambda s: np.sign(s - 0.5) * at(abs(2 * s - 1))


def dragged(mesh, held, indenter, slip, observe):
    """What `observe` sees of a body at each of the indenter's events, which is pressed into it and dragged along."""
    contact = RigidContact("top", indenter.ball(RADIUS), 1e9, 1e-6, 0.9, indenter.path)
    friction, found = Friction(contact, COEFFICIENT, slip, indenter.moves), []
    body = Problem(mesh, TISSUE, held, contacts=[contact, friction], element="P2/P1")
    control = StepControl(1.0, first=0.03, touch_growth=3.0, restart=1.0, dt_max=1.0)
    TimeStepper(body, indenter, control, 1e-3).run(
        lambda body, at, record: found.append(observe(body)) if at.t in indenter.events else None
    )
    return found


@pytest.mark.slow
def test_a_dragged_cylinder_slips_outside_a_strip_that_sticks():
    """Cattaneo and Mindlin, plane strain: pressed by P and dragged by Q < μ P it sticks where |x| < a √(1 - Q/μP)."""
    size, slip, along = 2e-3, 1e-7, (0, 0, 1.5e-5, 3e-5, 4.5e-5)
    indenter = Indenter(range(5), (0, *[2 * size**2 / RADIUS] * 4), along)
    across, deep = mirrored(graded(16, 1.3 * size, 5, 0.1)), graded(4, 0.8 * size, 5, 0.1)
    mesh = MakeStructured2DMesh(quads=True, nx=42, ny=9, mapping=lambda x, y: (across(x), -deep(1 - y)))
    line = np.linspace(-1.3, 1.3, 1301) * size
    top = mesh(line, 0 * line, VOL_or_BND=ngs.BND)
    held = {"bottom|left|right": 0}
    found = dragged(mesh, held, indenter, slip, lambda body: (forces(body), body.u(top)[:, 0]))
    tangential, normal = np.array([force for force, _ in found]).T
    load = -tangential / (COEFFICIENT * normal)  # Q/μP
    sticks = []
    for (_, u), gone in zip(found, along[1:], strict=True):
        slipped = np.abs(u - found[0][1] - gone)
        sticks.append(np.ptp(line[(slipped < slip) & (np.abs(line) < 1.2 * size)]) / 2)
    a = np.sqrt(normal * RADIUS / (np.pi * MU))
    print(load, sticks / a, np.sqrt(1 - load))
    assert normal == pytest.approx(normal[0], rel=1e-3)
    assert load[1:] == pytest.approx([0.25, 0.5, 0.75], abs=0.03)
    assert sticks[1:] / a[1:] == pytest.approx(np.sqrt(1 - load[1:]), abs=0.015)


@pytest.mark.slow
def test_a_dragged_balls_way_is_mindlins():
    """δ = 3 μ P (2 - ν)/(16 G a) (1 - (1 - Q/μP)^⅔), G the tissue's shear modulus; half of the body, cut along the drag."""
    size, loads = 2e-3, np.array([0.25, 0.5, 0.75])
    full = COEFFICIENT * 3 / 2 * size**2 / RADIUS
    along = (0, 0, *full * (1 - (1 - loads) ** (2 / 3)))
    indenter = Indenter(range(5), (0, *[size**2 / RADIUS] * 4), along)
    across, deep = graded(3, 1.15 * size, 4, 0.12), graded(2, 0.9 * size, 4, 0.12)
    both = mirrored(across)
    mesh = MakeStructured3DMesh(nx=14, ny=7, nz=6, mapping=lambda x, y, z: (both(x), across(y), -deep(1 - z)))
    held = {"bottom|right|back|front": 0, "left": (None, 0, None)}
    (tangential, _, normal) = 2 * np.array(dragged(mesh, held, indenter, 4e-7, forces)).T
    a, load = np.cbrt(3 * normal * RADIUS / (16 * MU)), -tangential / (COEFFICIENT * normal)
    wanted = COEFFICIENT * 9 * normal / (32 * MU * a) * (1 - (1 - load) ** (2 / 3))
    ratio = np.array(along[2:]) / wanted[1:]
    print(load, ratio)
    assert load[1:] == pytest.approx(loads, abs=0.05)
    assert ratio == pytest.approx(1.0, abs=0.03) and np.ptp(ratio) < 0.01


@pytest.mark.parametrize("kinematics", [PlaneStrain(), Axisymmetric()], ids=["Flamant", "Boussinesq"])
def test_far_from_a_cylinder_or_ball_its_force_acts_in_a_point(kinematics):
    """Stress is radial there, -2P cos θ/(πr) and -3P cos θ/(2πr²); the surface sinks by P/(2πμ) ln 1/r + c, and P/(4πμr)."""
    size, turned = 1e-3, isinstance(kinematics, Axisymmetric)
    indenter = Indenter((0.0, 1.0), (0, 2 * size**2 / RADIUS))
    at = graded(4, 1.3 * size, 14, 0.5)
    mesh = MakeStructured2DMesh(quads=True, nx=18, ny=18, mapping=lambda x, y: (at(x), -at(1 - y)))
    contact = RigidContact("top", indenter.ball(RADIUS), 1e10, 1e-6, 0.9)
    held = {"bottom|right": 0, "left": (0, None)}
    body = Problem(mesh, TISSUE, held, contacts=[contact], element="P3/P2", kinematics=kinematics)
    LoadPath(body, indenter).solve(steps=2)
    force = -body.force("top")[1] * (1 if turned else 2)  # the plane's mesh is half of it
    a = np.cbrt(3 * force * RADIUS / (16 * MU)) if turned else np.sqrt(force * RADIUS / (np.pi * MU))
    sunk = [-body.u(mesh(r * a, 0.0))[1] for r in (10, 20, 40)]
    wanted = (
        force / (4 * np.pi * MU * a) / np.array([10, 20, 40])
        if turned
        else -force / (2 * np.pi * MU) * np.log([10, 20, 40])
    )
    print(np.diff(sunk) / np.diff(wanted))
    assert np.diff(sunk) == pytest.approx(np.diff(wanted), rel=0.02)
    for r in (10 * a, 20 * a):
        for angle in (0.1, 0.3, 0.6, 0.9):
            away, across = np.array([np.sin(angle), -np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
            point = mesh(*r * away)
            slope = np.reshape(ngs.Grad(body.u)(point), (2, 2))
            stress = MU * (slope + slope.T) + body.p(point) * np.eye(2)
            radial = -force * np.cos(angle) * (1.5 / (np.pi * r**2) if turned else 2 / (np.pi * r))
            print(
                angle, away @ stress @ away / radial, across @ stress @ across / radial, away @ stress @ across / radial
            )
            assert away @ stress @ away == pytest.approx(radial, rel=0.03)
            assert abs(across @ stress @ across) < 0.05 * abs(radial)
            assert abs(away @ stress @ across) < 0.05 * abs(radial)


def test_a_flat_punch_is_boussinesqs():
    """Axisymmetric: F = 8 μ a w, pressure F/(2πa √(a² - r²)), and the surface beside it sinks by 2w/π asin(a/r)."""
    size, depth, far, inside, beyond = 1e-3, 2e-6, 1.0, 8, 14
    indenter, n = Indenter((0.0, 1.0), (0, depth)), inside + beyond

    def across(s):  # small elements on both sides of the edge, which is between two of them
        k = s * n
        if k <= inside:
            return size * (1 - (1 - k / inside) ** 2)
        growth = np.log(far / size) + 2
        return size + (far - size) * np.expm1((k - inside) / beyond * growth) / np.expm1(growth)

    def deep(s):
        return far * np.expm1(9 * s) / np.expm1(9)

    mesh = MakeStructured2DMesh(quads=True, nx=n, ny=n, mapping=lambda x, y: (across(x), -deep(1 - y)))
    flat = RigidContact("top", lambda x: ngs.IfPos(size - ngs.x, -indenter.down - x[1], 1.0), 1e10, 1e-8, 0.99)
    held = {"bottom|right": 0, "left": (0, None)}
    body = Problem(mesh, TISSUE, held, contacts=[flat], element="P2/P1", kinematics=Axisymmetric())
    LoadPath(body, indenter).solve()
    force = -body.force("top")[1]
    r = np.array([0.1, 0.3, 0.5, 0.7, 0.8, 0.9])
    pressure = flat.pressure(body.u, body.offset)(mesh(r * size, 0 * r, VOL_or_BND=ngs.BND)).ravel()
    beside = np.array([1.5, 2.0, 4.0, 8.0])
    sunk = np.array([-body.u(mesh(b * size, 0.0))[1] for b in beside])
    print(force / (8 * MU * size * depth), pressure / (force / (2 * np.pi * size**2 * np.sqrt(1 - r**2))))
    print(sunk / (2 * depth / np.pi * np.arcsin(1 / beside)))
    assert force == pytest.approx(8 * MU * size * depth, rel=0.01)
    assert pressure == pytest.approx(force / (2 * np.pi * size**2 * np.sqrt(1 - r**2)), rel=0.02)
    assert sunk == pytest.approx(2 * depth / np.pi * np.arcsin(1 / beside), rel=0.02)
