"""Friction as an energy: its slope, its steps taken up again, and that without it nothing is changed."""

import ngsolve as ngs
import numpy as np
import pytest
from dragged_plate import Drag, transient

from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.inertia import GeneralizedAlpha, Inertia
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block

PATH = ((0, 1, 2), (0, 1e-3, 1e-3), (0, 0, 1e-3))
SOFT = {"tissue": Material(NeoHooke(1e3), 1e4)}


def rubbed(coefficient, loads=()):
    """A block held at its bottom, and a plate that presses it and then goes along."""
    drag = Drag(*PATH)
    contact = drag.contact(1e7, 0.5)
    frictions = [] if coefficient is None else [drag.friction(contact, coefficient, 2e-5)]
    cube = block((0.02,) * 3, 0.02)
    return drag, Problem(cube, SOFT, {"bottom": 0}, loads, [contact, *frictions], element="P2/P1")


def test_the_forces_are_the_slope_of_the_energy_with_pressures_and_normals_held(rng):
    """A ball against the top, in a step that has begun: Taylor's rest is of second order, sticking and sliding."""
    way = ngs.Parameter(0.0)

    def ball(x):
        return ngs.Norm(x - ngs.CF((0.01, 0.01, 0.05 - way))) - 0.03

    contact = RigidContact("top", ball, 1e6, 1e-4, 0.5, way)
    body = Problem(
        block((0.02,) * 3, 0.01), SOFT, {"bottom": 0}, contacts=[contact, Friction(contact, 0.4, 1e-4)], element="P2/P1"
    )
    x = body.x
    x[body.is_u] = 1e-4 * rng.standard_normal(body.is_u.sum())
    body.x = x
    way.Set(1e-3)
    body.begin(1.0)
    x[body.is_u] += 1e-4 * rng.standard_normal(body.is_u.sum())
    body.x = x
    form, vec = body.friction.form, body.gfu.vec.CreateVector()
    vec.data = body.gfu.vec
    direction = 1e-4 * rng.standard_normal(x.size)
    energy, slope = form.Energy(vec), float(body.friction.forces() @ direction)
    rests = []
    for h in (0.1, 0.05, 0.025):
        vec.FV().NumPy()[:] = x + h * direction
        rests.append(abs(form.Energy(vec) - energy - h * slope))
    assert energy > 0 and np.log2(np.divide(rests[:-1], rests[1:])) == pytest.approx([2, 2], abs=0.1)


@pytest.mark.one_thread
def test_no_friction_is_what_there_was():
    ends = []
    for coefficient in (None, 0.0):
        drag, body = rubbed(coefficient)
        transient(body, drag, 0.25).run(lambda *_: None)
        ends.append(body.x)
        assert body.friction_work() == body.friction_driving_force() == 0
    assert np.array_equal(*ends)


def test_a_load_path_remembers_its_slip_as_time_does():
    """A plate that presses, goes along and comes back rubs against its way back: what it slid on the way there stays slid."""
    path = ((0, 0.25, 0.5, 1.0), (0, 5e-4, 5e-4, 5e-4), (0, 0, 1e-3, 0))
    found = []
    for drive in ("load path", "time"):
        drag = Drag(*path)
        contact = drag.contact(1e6, 0.5)
        cube, contacts = block((0.02,) * 3, 0.02), [contact, drag.friction(contact, 0.2, 2e-5)]
        body = Problem(cube, SOFT, {"bottom": 0}, contacts=contacts, element="P2/P1")
        if drive == "time":
            transient(body, drag, 1 / 16).run(lambda *_: None)
        else:
            LoadPath(body, drag).solve(steps=16)
        found.append(body.force("bottom"))
    assert found[0] == pytest.approx(found[1], rel=2e-3, abs=2e-3 * abs(found[1][2]))
    assert found[0][0] > 0.15 * found[0][2] > 0


MASS = (Inertia(1000.0, GeneralizedAlpha(0.0)),)


@pytest.mark.one_thread
@pytest.mark.parametrize("loads, stop", [((), 1.0), ((), 1.4), (MASS, 1.4)])
def test_restart_goes_on_with_the_same_bits(loads, stop):
    def made():
        drag, body = rubbed(0.2, loads)
        body.focus(np.arange(body.mesh.ne) % 2 == 0)
        return transient(body, drag, 0.2)

    whole, half, other = made(), made(), made()
    whole.run(lambda *_: None)
    half.run(lambda *_: None, until=stop)
    saved = half.checkpoint()
    assert saved["factors"] and np.abs(saved["state"]["internal"]["slips"]).max() > 0
    other.restore(saved)
    np.testing.assert_equal(other.checkpoint(), saved)
    other.run(lambda *_: None)
    assert np.array_equal(other.problem.x, whole.problem.x)
    assert abs(whole.problem.friction_driving_force()) > 0.01


@pytest.mark.parametrize("numbers", [(-0.1, 1e-5), (0.1, 0.0)])
def test_what_is_no_friction_is_named(numbers):
    with pytest.raises(InputError, match="friction"):
        Friction(RigidContact("top", lambda x: x[2], 1e6, 1e-5), *numbers)
