"""Walls that slide: against homogeneous deformations, and against turning a ball, which takes nothing."""

import math

import netgen.occ as occ
import ngsolve as ngs
import pytest
from scipy.optimize import brentq

from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact, SelfContact, SlidingSupport
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

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


def pressed(walls, share=0.0):
    """A block on some sliding walls, under a plate that presses it to 0.9 of its height: plate and body."""
    drive, mesh = Drive(ToolMotion("press", (0.0, 1.0), (0.0, SIDE * (1 - SHORT)))), block((SIDE,) * 3, SIDE / 2)
    plate = RigidContact("top", lambda x: SIDE - drive.parameter - x[2], 1e10, 1e-7, share)
    sliding = [SlidingSupport.on(mesh, wall, 1e7 * MU) for wall in walls]
    body = Problem(mesh, {"tissue": Material(NeoHooke(MU), BULK)}, {}, contacts=[plate, *sliding], element="P2/P1")
    TimeStepper(body, drive, StepControl(0.5), 1e-3).run(lambda *_: None)
    return plate, body


def mean_and_spread(plate, body):
    """Mean contact pressure (Pa), and its standard deviation over the wall."""
    pressure = plate.pressure(body.u, body.offset)
    first, second = (ngs.Integrate(pressure**k * plate.measure(), body.mesh) / SIDE**2 for k in (1, 2))
    return first, math.sqrt(max(second - first**2, 0.0))


def test_a_block_between_sliding_walls_is_strained_in_one_direction_alone():
    plate, body = pressed(("bottom", *SIDES))
    assert mean_and_spread(plate, body)[0] == pytest.approx(-stress(1.0), rel=1e-3)
    assert ngs.Integrate(body.u[0] ** 2 + body.u[1] ** 2, body.mesh) < 1e-12 * SIDE**3


@pytest.mark.parametrize("share", [0.0, 0.98])
def test_a_block_in_a_sliding_corner_widens_as_if_it_were_free(share):
    """The patch test of contact: the pressure is the same all over the plate, with and without an offset."""
    plate, body = pressed(("bottom", "left", "front"), share)
    wide = brentq(lambda x: slope(lambda y: density(y, SHORT), x), 1.0, 1.1)
    mean, spread = mean_and_spread(plate, body)
    assert mean == pytest.approx(-stress(wide), rel=1e-3)
    assert spread < 1e-3 * mean, spread / mean
    assert body.u(body.mesh(SIDE, SIDE, 0.0))[0] == pytest.approx(SIDE * (wide - 1), rel=1e-2)


def test_a_ball_turns_where_it_lies():
    """u · N is of second order in the angle, with normals that turn evenly; facets' own take 2.6 times as much."""
    radius, angle = 0.03, 0.1
    ball = occ.Sphere((0, 0, 0), radius)
    ball.mat("tissue")
    ball.faces.name = "skull"
    mesh = ngs.Mesh(occ.OCCGeometry(ball).GenerateMesh(maxh=0.008))
    body = Problem(
        mesh,
        {"tissue": Material(NeoHooke(MU), BULK)},
        {},
        contacts=[SlidingSupport.on(mesh, "skull", 1e5 * MU)],
        element="P2/P1",
    )
    c, s = math.cos(angle), math.sin(angle)
    body.u.Interpolate(ngs.CF(((c - 1) * ngs.x - s * ngs.y, s * ngs.x + (c - 1) * ngs.y, 0)))
    exact = 1e5 * MU / 2 * (1 - c) ** 2 * radius**4 * 2 * math.pi * 16 / 15
    assert body.contact_energy() == pytest.approx(exact, rel=0.2)


def halves(gap):
    """Two blocks, one over the other, that are one mesh; their elements do not match."""
    low, high = occ.Box((0, 0, 0), (SIDE,) * 3), occ.Box((0, 0, SIDE + gap), (SIDE, SIDE, 2 * SIDE + gap))
    for half, below, above in ((low, "bottom", "floor"), (high, "roof", "top")):
        half.mat("tissue")
        half.faces.name = "side"
        half.faces.Min(occ.X).name, half.faces.Min(occ.Y).name = "left", "front"
        half.faces.Min(occ.Z).name, half.faces.Max(occ.Z).name = below, above
    high.maxh = SIDE / 3
    return ngs.Mesh(occ.OCCGeometry(occ.Compound([low, high])).GenerateMesh(maxh=SIDE))


@pytest.mark.parametrize("closing", [True, False])
def test_halves_that_meet_bear_what_a_whole_does(closing):
    """Pressed together by the gap and two tenths of a half: each is as short as the one block above, if they see each other."""
    gap = 2e-3
    way, mesh = gap + 2 * SIDE * (1 - SHORT), halves(gap)
    drive = Drive(ToolMotion("press", (0.0, 1.0), (0.0, way)))
    plate = RigidContact("top", lambda x: 2 * SIDE + gap - drive.parameter - x[2], 1e10, 1e-7)
    walls = [SlidingSupport.on(mesh, wall, 1e7 * MU) for wall in ("bottom", "left", "front")]
    thread = SlidingSupport.on(mesh, "roof", 100.0)  # a weak spring, which what floats hangs on
    meeting = [SelfContact("floor", "roof", 1e8, 2e-5, 2 * gap)] if closing else []
    body = Problem(
        mesh, {"tissue": Material(NeoHooke(MU), BULK)}, {}, contacts=[plate, *walls, thread, *meeting], element="P2/P1"
    )
    TimeStepper(body, drive, StepControl(0.1), 1e-3).run(lambda *_: None)
    force = ngs.Integrate(plate.pressure(body.u) * plate.measure(), mesh)
    wide = brentq(lambda x: slope(lambda y: density(y, SHORT), x), 1.0, 1.1)
    assert (force == pytest.approx(-(SIDE**2) * stress(wide), rel=6e-3)) == closing
    uneven = sum((ngs.Grad(body.u)[i, i] - even) ** 2 for i, even in enumerate((wide - 1, wide - 1, SHORT - 1)))
    off = math.sqrt(ngs.Integrate(uneven, mesh) / 2 / SIDE**3)
    assert (off < 4e-3) == closing, off


def test_a_wall_that_is_held_does_not_slide():
    mesh = block((SIDE,) * 3, SIDE)
    with pytest.raises(InputError, match=r"without bottom"):
        Problem(
            mesh,
            {"tissue": Material(NeoHooke(MU), BULK)},
            {"bottom": 0},
            contacts=[SlidingSupport.on(mesh, "bottom", 1.0)],
            element="P2/P1",
        )


def test_a_wall_that_is_not_there_does_not_slide():
    mesh = block((SIDE,) * 3, SIDE)
    with pytest.raises(InputError, match="skull"):
        Problem(
            mesh,
            {"tissue": Material(NeoHooke(MU), BULK)},
            {"bottom": 0},
            contacts=[SlidingSupport.on(mesh, "skull", 1.0)],
            element="P2/P1",
        )
