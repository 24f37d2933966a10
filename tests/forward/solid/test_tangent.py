"""The factorised tangent: with the offset of a contact, and renewed in a part beside an older whole."""

import math

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.forward.common.loads import PressureLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import Maxwell, NeoHooke, Ogden, Viscous
from ngbrain.mesh import block
from ngbrain.solvers.newton import Newton


@pytest.fixture
def pillar(make_body, plate):
    """A tall block under a plate with an offset, pressed by 1 mm, and the plate's motion."""
    drive = plate((0, 1, 20), (0, 1e-3, 1e-3), height=0.06)
    contact = RigidContact("top", lambda x: drive.level - x[2], 1e7, 2e-5, share=0.95)
    body = make_body(contacts=[contact], maxh=0.009, size=(0.02, 0.02, 0.06))
    drive.set(1.0)
    body.begin(0.5)
    return body, drive


@pytest.fixture
def pressed(pillar, rng):
    """The pillar, unknowns of a state that is no equilibrium, and a direction."""
    body, _ = pillar
    size = 3e-2 * body._scale  # the wall stays in touch, where the penalty is smooth
    x, dx = (size * rng.standard_normal(size.size) * (body.weights > 0) for _ in range(2))
    x[-body.offset.space.ndof :] += 1e-4
    return body, x, dx


def near(body, height=0.02):
    """Elements that lie above a height (m)."""
    return np.array([min(body.mesh[v].point[2] for v in e.vertices) > height for e in body.mesh.Elements()])


def test_factors_are_of_the_residuals_derivative_offsets_and_all(pressed):
    body, x, dx = pressed
    assert body.offset.space.ndof > 4 and body.min_gap() < 0
    change = (body.residual(x + 1e-4 * dx)[0] - body.residual(x - 1e-4 * dx)[0]) / 2e-4
    off = body.factorise(x)(change) - dx
    assert np.sqrt(body.weights @ off**2) < 1e-5 * np.sqrt(body.weights @ dx**2)


def test_a_part_renewed_where_nothing_changed_is_the_whole(pressed, rng):
    body, x, _ = pressed
    body.focus(near(body))
    r = body.residual(x)[0]
    exact, same = body.factorise(x)(r), body.refactorise(x)(r)
    assert same == pytest.approx(exact, rel=1e-8, abs=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("law", [Ogden(1e3, -15.0), Viscous(Ogden(1e2, -15.0), (Maxwell(Ogden(9e2, -15.0), 1e6),))])
def test_a_part_renewed_follows_a_change_inside_it(law):
    # A dent in the top of a block that is held all around, as a brain is.
    body = Problem(block((0.06,) * 3, 0.012), {"tissue": Material(law, 1.5e6)}, {"^(?!top).*": 0}, element="P2/P1")
    body.begin(0.5)
    body.focus(near(body))
    kept = body.factorise(body.x)
    above = ngs.IfPos(ngs.z - 0.045, (ngs.z - 0.045) ** 2, 0)
    across = ngs.sin(math.pi * ngs.x / 0.06) * ngs.sin(math.pi * ngs.y / 0.06)
    body.u.Set(ngs.CF((20 * above * across, 0, 0)))
    y = body.x
    r = body.residual(y)[0]
    stale, part, exact = kept(r), body.refactorise(y)(r), body.factorise(y)(r)

    def off(step):
        return np.sqrt(body.weights @ (step - exact) ** 2 / (body.weights @ exact**2))

    assert off(part) < 0.05 < 0.3 < off(stale), (off(part), off(stale))


def test_what_is_too_rough_for_a_residual_is_not_used(pressed):
    # Everything changes, most of it outside the part.
    body, x, _ = pressed
    body.focus(near(body, 0.05))
    body.factorise(0 * x)
    body.u.Set(ngs.CF((0, 0, -0.15 * ngs.z)))
    y = body.x
    r = body.residual(y)[0]
    assert body.refactorise(y, r) is None
    assert body.factorise(y, r) and not body.partial


@pytest.mark.one_thread
def test_restart_makes_the_same_factors_again(pillar, make_body):
    def made():
        contact = RigidContact("top", lambda x: drive.level - x[2], 1e7, 2e-5, share=0.95)
        body = make_body(contacts=[contact], maxh=0.009, size=(0.02, 0.02, 0.06))
        body.focus(near(body))
        newton = Newton(max_contraction=0.0, spare_iterations=0, max_factorisations=50)  # renews all the time
        return TimeStepper(body, drive, StepControl(0.5, dt_max=10), 1e-3, newton)

    _, drive = pillar
    whole, half, other = made(), made(), made()
    whole.run(lambda *_: None)
    half.run(lambda *_: None, until=1.0)
    saved = half.checkpoint()
    assert len(saved["factors"]) == 2, "the restart would not have to make a part"
    other.restore(saved)
    other.run(lambda *_: None)
    assert np.array_equal(other.problem.x, whole.problem.x)


def test_a_tangent_that_needs_pivots_is_not_renewed_in_part():
    mesh = block((0.02, 0.02, 0.02), 0.02)
    body = Problem(
        mesh, {"tissue": Material(NeoHooke(1e3), 1e5)}, {"bottom": 0}, [PressureLoad("top", 10.0)], element="P2/P1"
    )
    with pytest.raises(InputError, match="renewed in part"):
        body.focus(np.ones(mesh.ne, bool))
