"""Friction: a block that a plate drags against a spring sticks, then slides with μ times the normal force."""

import numpy as np
import pytest
from dragged_plate import AREA, SIDE, SPRING, Drag, even, forces, on_a_rail, transient

COEFFICIENT, PRESS, FAR = 0.3, 1e-5, 3e-3


@pytest.fixture(scope="module", params=[0.0, 0.98])
def dragged(request):
    """Columns: time, way, force along and down, work into friction, energy stored, of the tissue, of the plate."""
    drag = Drag((0, 1, 3, 5), (0, PRESS, PRESS, PRESS), (0, 0, FAR, FAR))
    body = on_a_rail(drag, COEFFICIENT, request.param)
    rows, last, works = [], [np.zeros(body.fes.components[0].ndof)] * 2 + [0.0, 0.0], np.zeros(3)

    def watch(body, at, record):
        now = [body.u.vec.FV().NumPy().copy(), body.tissue_forces(), drag.way.Get(), body.friction_driving_force()]
        tissue, plate = (np.sum((now[k + 1] + last[k + 1]) / 2 * (now[k] - last[k])) for k in (0, 2))
        last[:], works[:] = now, works + np.array((body.friction_work(), tissue, plate))
        rows.append((at.t, drag.way.Get(), *forces(body), works[0], body.contact_energy(), *works[1:]))

    transient(body, drag, 0.1).run(watch)
    return np.array(rows).T


def test_it_sticks_until_the_spring_pulls_with_the_friction_and_slides_then(dragged):
    t, way, along, down = dragged[:4]
    sticks = (way > 5e-4) & (SPRING * AREA * way < 0.8 * COEFFICIENT * down) & (t <= 3)
    slides = (SPRING * AREA * way > 1.1 * COEFFICIENT * down) & (t <= 3)
    assert sticks.sum() > 5 and slides.sum() > 5
    assert along[sticks] == pytest.approx(SPRING * AREA * way[sticks], rel=0.015)  # less what the block gives
    assert along[slides] == pytest.approx(COEFFICIENT * down[slides], rel=1e-3)


def test_what_sticks_stays_however_many_steps_are_made(dragged):
    """Of a law with the slip's rate in it the friction goes on giving way, by up to r a step."""
    t, along = dragged[0], dragged[2]
    held = along[t >= 3]
    assert held.size > 15 and np.ptp(held) < 1e-6 * held[0] and held[0] > 0.01


def test_the_plates_work_is_in_tissue_spring_and_friction(dragged):
    from_here = np.searchsorted(dragged[0], 1.0 - 1e-9)  # pressed; from now on the plate goes along alone
    rubbed, stored, tissue, plate = dragged[4:, -1] - dragged[4:, from_here]
    assert rubbed > 0.3 * plate > 0
    assert plate == pytest.approx(rubbed + stored + tissue, rel=2e-3)


def pressed_while_sliding(dt):
    """Forces after each step in which a plate that slides already presses three times as much, by and by."""
    drag = Drag((0, 1, 3, 5), (0, PRESS, PRESS, 3 * PRESS), (0, 0, FAR, 4 * FAR))
    body, found = on_a_rail(drag, COEFFICIENT), []
    steps = transient(body, drag, 0.5)
    steps.run(lambda *_: None, until=3.0)
    steps.control = even(dt)
    steps.run(lambda body, at, record: found.append(forces(body)))
    return np.array(found).T


def test_friction_is_that_of_the_pressure_at_the_end_of_a_step():
    """Of the one at its start, it would lag by what the pressure grows in a step."""
    (along, down), (finer, _) = pressed_while_sliding(1.0), pressed_while_sliding(0.5)
    assert along.size == 2 and finer.size == 4 and down[-1] > 1.3 * down[0]
    assert along == pytest.approx(COEFFICIENT * down, rel=1e-3)
    assert along == pytest.approx(finer[1::2], rel=0.01)


def test_friction_on_a_plate_that_only_presses_holds_the_block_from_widening():
    """μ = 1 against a top that is free to slide: the force is higher, and the top stays as wide as it was."""
    found = []
    for coefficient in (0.0, 1.0):
        drag = Drag((0, 1), (0, 1e-3), (0, 0))
        body = on_a_rail(drag, coefficient)
        transient(body, drag, 0.25).run(lambda *_: None)
        found.append((forces(body)[1], body.u(body.mesh(SIDE, SIDE, SIDE))[0] - body.u(body.mesh(0, SIDE, SIDE))[0]))
    (free, widened), (held, stays) = found
    assert held > 1.05 * free and widened > 4e-4 and abs(stays) < 0.05 * widened
