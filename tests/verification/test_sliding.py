"""Walls that slide: against homogeneous deformations, and against turning a ball, which takes nothing."""

import math

import netgen.occ as occ
import ngsolve as ngs
import pytest
from scipy.optimize import brentq

from ngbrain.errors import InputError
from ngbrain.forward.body import Body, Material
from ngbrain.forward.contact import Contact, Sliding
from ngbrain.forward.steps import StepControl
from ngbrain.forward.transient import Transient
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, Protocol

MU, BULK, SIDE, SHORT = 1e3, 1e4, 0.02, 0.9
SIDES = ("left", "right", "front", "back")


def density(wide, tall):
    """Energy (Pa) of even stretches (wide, wide, tall)."""
    J = wide * wide * tall
    return MU / 2 * ((2 * wide * wide + tall * tall) * J ** (-2 / 3) - 3) + BULK / 2 * (J - 1) ** 2


def slope(f, x):
    return (f(x + 1e-6) - f(x - 1e-6)) / 2e-6


def stress(wide):
    """Nominal stress (Pa) at the top."""
    return slope(lambda tall: density(wide, tall), SHORT)


def pressed(walls):
    """A block on some sliding walls, under a plate that presses it to 0.9 of its height: force (N) and the body."""
    drive, mesh = Drive(Protocol("press", (0.0, 1.0), (0.0, SIDE * (1 - SHORT)))), block((SIDE,) * 3, SIDE / 2)
    plate = Contact("top", lambda x: SIDE - drive.parameter - x[2], 1e10, 1e-7)
    sliding = [Sliding.on(mesh, wall, 1e7 * MU) for wall in walls]
    body = Body(mesh, {"tissue": Material(NeoHooke(MU), BULK)}, "", [plate, *sliding])
    Transient(body, drive, StepControl(0.5), 1e-3).run(lambda *_: None)
    top = ngs.Integrate(plate.pressure(body.u) * plate.measure(), mesh)
    return top, body


def test_a_block_between_sliding_walls_is_strained_in_one_direction_alone():
    force, body = pressed(("bottom", *SIDES))
    assert force == pytest.approx(-SIDE**2 * stress(1.0), rel=1e-3)
    assert ngs.Integrate(body.u[0] ** 2 + body.u[1] ** 2, body.mesh) < 1e-12 * SIDE**3


def test_a_block_in_a_sliding_corner_widens_as_if_it_were_free():
    force, body = pressed(("bottom", "left", "front"))
    wide = brentq(lambda x: slope(lambda y: density(y, SHORT), x), 1.0, 1.1)
    assert force == pytest.approx(-SIDE**2 * stress(wide), rel=1e-3)
    assert body.u(body.mesh(SIDE, SIDE, 0.0))[0] == pytest.approx(SIDE * (wide - 1), rel=1e-2)


def test_a_ball_turns_where_it_lies():
    """u · N is of second order in the angle, with normals that turn evenly; facets' own take 2.6 times as much."""
    radius, angle = 0.03, 0.1
    ball = occ.Sphere((0, 0, 0), radius)
    ball.mat("tissue")
    ball.faces.name = "skull"
    mesh = ngs.Mesh(occ.OCCGeometry(ball).GenerateMesh(maxh=0.008))
    body = Body(mesh, {"tissue": Material(NeoHooke(MU), BULK)}, "", [Sliding.on(mesh, "skull", 1e5 * MU)])
    c, s = math.cos(angle), math.sin(angle)
    body.u.Interpolate(ngs.CF(((c - 1) * ngs.x - s * ngs.y, s * ngs.x + (c - 1) * ngs.y, 0)))
    exact = 1e5 * MU / 2 * (1 - c) ** 2 * radius**4 * 2 * math.pi * 16 / 15
    assert body.contact_energy() == pytest.approx(exact, rel=0.2)


def test_a_wall_that_is_held_does_not_slide():
    mesh = block((SIDE,) * 3, SIDE)
    with pytest.raises(InputError, match=r"without bottom"):
        Body(mesh, {"tissue": Material(NeoHooke(MU), BULK)}, "bottom", [Sliding.on(mesh, "bottom", 1.0)])
