"""The factorised tangent: bordered by offsets, and renewed in a part beside an older whole."""

import math

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.adjoint.check import taylor
from ngbrain.forward.body import Body, Material
from ngbrain.forward.contact import Contact
from ngbrain.forward.steps import StepControl
from ngbrain.forward.tangent import bordered
from ngbrain.forward.transient import Transient
from ngbrain.materials import Ogden
from ngbrain.mesh import block
from ngbrain.solvers.newton import Newton


@pytest.fixture
def pillar(make_body, plate):
    """A tall block under a plate with an offset, pressed by 1 mm, and the plate's motion."""
    drive = plate((0, 1, 20), (0, 1e-3, 1e-3), height=0.06)
    contact = Contact("top", lambda x: drive.level - x[2], 1e7, 2e-5, share=0.95)
    body = make_body(contacts=[contact], maxh=0.009, size=(0.02, 0.02, 0.06))
    drive.set(1.0)
    body.begin(0.5)
    return body, drive


@pytest.fixture
def pressed(pillar, rng):
    """The pillar, unknowns of a state that is no equilibrium, and a direction."""
    body, _ = pillar
    size = np.where(body.is_u, 3e-5, 20.0)  # the wall stays in touch, where the penalty is smooth
    x, dx = (size * rng.standard_normal(size.size) * (body.weights[:-1] > 0) for _ in range(2))
    return body, np.append(x, 1e-4), np.append(dx, 2e-5)


def near(body, height=0.02):
    """Elements that lie above a height (m)."""
    return np.array([min(body.mesh[v].point[2] for v in e.vertices) > height for e in body.mesh.Elements()])


def test_bordered_solves_with_the_borders(rng):
    A, borders = rng.standard_normal((6, 6)), [(rng.standard_normal(6), rng.standard_normal(6), 0.7) for _ in range(2)]
    b, c = np.array([b for b, _, _ in borders]), np.array([c for _, c, _ in borders])
    whole = np.block([[A, b.T], [c, np.diag([0.7, 0.7])]])
    r = rng.standard_normal(8)
    assert whole @ bordered(lambda r: np.linalg.solve(A, r), borders)(r) == pytest.approx(r, abs=1e-10)


def test_the_offset_equation_has_the_border_as_its_derivative(pressed):
    body, x, dx = pressed

    def residual(y):
        return body.residual(y)[0]

    body.state = x
    ((b, c, d),) = [offset.border() for offset in body._offsets]
    rates = taylor(lambda y: residual(y)[-1], np.append(c, d), x, dx)
    assert np.all(np.abs(rates - 2) < 0.1), rates
    along = np.zeros_like(x)
    along[-1] = 2e-5
    change = (residual(x + along) - residual(x))[:-1]  # in touch everywhere, forces are linear in the offset
    assert change == pytest.approx(b * (body.weights[:-1] > 0) * 2e-5, rel=1e-9, abs=1e-9 * np.abs(change).max())


def test_a_part_renewed_where_nothing_changed_is_the_whole(pressed, rng):
    body, x, _ = pressed
    body.focus(near(body))
    r = body.residual(x)[0]
    exact, same = body.factorise(x)(r), body.refactorise(x)(r)
    assert same == pytest.approx(exact, rel=1e-8, abs=1e-9 * np.abs(exact).max())


def test_a_part_renewed_follows_a_change_inside_it():
    # A dent in the top of a block that is held all around, as a brain is.
    body = Body(block((0.06,) * 3, 0.012), {"tissue": Material(Ogden(1e3, -15.0), 1.5e6)}, "^(?!top).*")
    body.begin(0.5)
    body.focus(near(body))
    kept = body.factorise(body.state)
    above = ngs.IfPos(ngs.z - 0.045, (ngs.z - 0.045) ** 2, 0)
    across = ngs.sin(math.pi * ngs.x / 0.06) * ngs.sin(math.pi * ngs.y / 0.06)
    body.u.Set(ngs.CF((20 * above * across, 0, 0)))
    y = body.state
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
    y = body.state
    r = body.residual(y)[0]
    assert body.refactorise(y, r) is None
    assert body.factorise(y, r) and not body.partial


def test_restart_makes_the_same_factors_again(pillar, make_body):
    def made():
        contact = Contact("top", lambda x: drive.level - x[2], 1e7, 2e-5, share=0.95)
        body = make_body(contacts=[contact], maxh=0.009, size=(0.02, 0.02, 0.06))
        body.focus(near(body))
        newton = Newton(keep=0.0, worth=0, max_factorisations=50)  # renews all the time
        return Transient(body, drive, StepControl(0.5, dt_max=10), 1e-3, newton)

    _, drive = pillar
    whole, half, other = made(), made(), made()
    whole.run(lambda *_: None)
    half.run(lambda *_: None, until=1.0)
    saved = half.checkpoint()
    assert len(saved["factors"]) == 2, "the restart would not have to make a part"
    other.restore(saved)
    other.run(lambda *_: None)
    assert np.array_equal(other.body.state, whole.body.state)
