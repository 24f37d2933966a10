"""Rigid bodies pressed into tissue: a plate and a flat punch on a relaxing block, a sphere on a half space."""

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
import pytest
from netgen.geom2d import SplineGeometry
from plate_contact import force

from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import RigidBody
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import NeoHooke, Prony
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

SIZE, DEPTH, RAMP = 0.02, 2e-5, 4.0
"""A thousandth of the block, so that its answer is linear."""
MU, G, TAU = 1000.0, np.array([0.5, 0.3]), np.array([0.7, 30.0])
HARD = {"penalty": 2e10, "softness": 1e-8}


def plate(x, advance):
    return SIZE - advance - x[2]


def punch(x, advance):
    """A flat-ended cylinder of 6 mm, its edge rounded by 1 mm."""
    r = 1e-3
    radial = ngs.sqrt((x[0] - SIZE / 2) ** 2 + (x[1] - SIZE / 2) ** 2 + 1e-18) - 6e-3 + r
    below = SIZE - advance + r - x[2]
    a, b = ngs.IfPos(radial, radial, 0), ngs.IfPos(below, below, 0)
    return (
        ngs.sqrt(a * a + b * b + 1e-18)
        + ngs.IfPos(radial, 0, ngs.IfPos(below, 0, ngs.IfPos(radial - below, radial, below)))
        - r
    )


def pressed(law, shape, times, advance):
    """Time and force of each step."""
    drive = Drive(ToolMotion("press", times, advance))
    contact = RigidContact("top", lambda x: shape(x, drive.parameter), **HARD)
    body = Problem(
        block((SIZE,) * 3, 0.01),
        {"tissue": Material(law, 1e5 * MU)},
        {"bottom": 0},
        contacts=[contact],
        element="P2/P1",
    )
    rows = []
    transient = TimeStepper(body, drive, StepControl(1.0, first=1.0), 1e-3)
    transient.run(lambda b, at, record: rows.append((at.t, force(b))))
    return np.array(rows).T


@pytest.mark.parametrize("shape", [plate, punch])
def test_ramp_and_hold_of_a_relaxing_block_is_the_elastic_one_times_the_relaxation(shape):
    """F(t) = F_elastic ∫ G(t - s) ds/t₀ over the ramp, by the correspondence of elastic and viscoelastic bodies."""
    _, elastic = pressed(NeoHooke(MU), shape, (0.0, RAMP), (0.0, DEPTH))
    t, relaxing = pressed(Prony(NeoHooke(MU), list(G), list(TAU)), shape, (0.0, RAMP, 60.0), (0.0, DEPTH, DEPTH))
    held = t >= RAMP - 1e-9
    wanted = 1 - G.sum() + np.exp(-t[held, None] / TAU) @ (G * TAU * np.expm1(RAMP / TAU)) / RAMP
    assert held.sum() > 4 and np.allclose(relaxing[held] / elastic[-1], wanted, rtol=3e-4)


@pytest.mark.slow
def test_a_sphere_on_a_half_space():
    """Hertz: F = 16/3 μ √R d^1.5 and the largest pressure 8 μ/π √(d/R), incompressible, without friction."""
    half, R, mu = 0.12, 0.05, 1000.0
    box = occ.Box(occ.Pnt(-half, -half, -half), occ.Pnt(half, half, 0.0))
    disc = occ.WorkPlane(occ.Axes((0, 0, 0), occ.Z)).Circle(2.4e-3).Face()
    disc.maxh = 0.35e-3
    solid = occ.Glue([box, disc])
    for face in solid.faces:
        face.name = "top" if face.center.z > -1e-9 and max(abs(face.center.x), abs(face.center.y)) < 1e-9 else "far"
    solid.solids[0].mat("tissue")
    mesh = ngs.Mesh(occ.OCCGeometry(solid).GenerateMesh(maxh=0.06, grading=0.6))
    drive = Drive(ToolMotion("press", (0.0, 1.0, 2.0), (0.0, 4e-5, 8e-5)))

    def sphere(x):
        z = x[2] - R + drive.parameter
        return ngs.sqrt(x[0] ** 2 + x[1] ** 2 + z * z) - R

    body = Problem(
        mesh,
        {"tissue": Material(NeoHooke(mu), 1e5 * mu)},
        {"far": 0},
        contacts=[RigidContact("top", sphere, 1e9, 1e-7)],
        element="P2/P1",
    )
    found = []
    TimeStepper(body, drive, StepControl(1.0, first=1.0), 1e-3).run(
        lambda b, at, record: found.append((at.t, force(b)))
    )
    forces = [f for t, f in found if t in (1.0, 2.0)]
    wanted = [16 / 3 * mu * np.sqrt(R) * d**1.5 for d in (4e-5, 8e-5)]
    assert np.allclose(forces, wanted, rtol=0.045) and np.log2(forces[1] / forces[0]) == pytest.approx(1.5, abs=0.03)
    top = body.contacts[0].pressure(body.u)(mesh(0.0, 0.0, 0.0, ngs.BND))
    assert top == pytest.approx(8 * mu / np.pi * np.sqrt(8e-5 / R), rel=0.05)


def test_a_ball_on_a_body_of_revolution():
    """Hertz, in equilibrium: F = 16/3 μ √R d^1.5, incompressible."""
    size, R, mu, forces = 0.06, 0.01, 1000.0, []
    corners, shape = ((0, 0), (size, 0), (size, size), (2e-3, size), (0, size)), SplineGeometry()
    numbers = [shape.AppendPoint(*corner) for corner in corners]
    for i, (name, maxh) in enumerate((("foot", 6e-3), ("side", 6e-3), ("top", 6e-3), ("top", 1e-4), ("axis", 6e-3))):
        shape.Append(["line", numbers[i], numbers[(i + 1) % 5]], bc=name, maxh=maxh)
    mesh, deep = ngs.Mesh(shape.GenerateMesh(maxh=6e-3, grading=0.2)), (4e-5, 8e-5)
    for d in deep:
        height = size + R

        def distance(x, t, d=d, height=height):
            return ngs.sqrt(x[0] ** 2 + (x[1] - height + t * d) ** 2) - R

        held = {"axis": (0, None), "foot": 0}
        ball, turned = RigidBody("top", distance, 1e9, 1e-6), Axisymmetric()
        body = Problem(mesh, {".*": Material(NeoHooke(mu), 1e6)}, held, [ball], element="P2/P1", kinematics=turned)
        LoadPath(body).solve()
        forces.append(body.force("foot")[1])
    wanted = [16 / 3 * mu * np.sqrt(R) * d**1.5 for d in deep]
    assert np.allclose(forces, wanted, rtol=0.02) and np.log2(forces[1] / forces[0]) == pytest.approx(1.5, abs=0.02)
