"""One step of a problem: what it starts from is a value, and a step that fails leaves no trace."""

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh

from ngbrain.errors import Breakdown
from ngbrain.forward import Friction, GeneralizedAlpha, Inertia, Material, PrescribedForce, Problem, RigidContact
from ngbrain.forward.solid.advance import LoadHistory, LoadProgram, advance, newton_for
from ngbrain.materials import Branch, Maxwell, NeoHooke, Viscous
from ngbrain.result import Status

SIDE = 0.02


def pressed(forced=False):
    """Hereditary and Maxwell branches, mass, and a plate that rubs: of given way, or force."""
    law = Viscous(NeoHooke(400.0), (Branch(NeoHooke(300.0), 1.0), Maxwell(NeoHooke(300.0), 600.0)))
    given, way = PrescribedForce((0.0, 1.0, 9.0), (0.0, 0.05, 0.05), -1e-3, 1e-6), ngs.Parameter(0.0)

    class Plate:
        events = (9.0,)

        def set(self, t):
            way.Set(2e-3 * min(t, 1.0))

        def travel(self, start, end):
            return 2e-3 * (min(end, 1.0) - min(start, 1.0))

    gone = given.parameter if forced else way
    plate = RigidContact("top", lambda x: SIDE - gone - x[1], 1e6, 2e-4, 0.5, gone)
    rubs = Friction(plate, 0.2, 1e-4, lambda x, way: way * ngs.CF((1.0, 0.0)))
    mesh = MakeStructured2DMesh(quads=True, nx=3, ny=3, mapping=lambda x, y: (SIDE * x, SIDE * y))
    loads, contacts = [Inertia(1000.0, GeneralizedAlpha(0.0))], [plate, rubs, *([given] if forced else [])]
    body = Problem(mesh, {".*": Material(law, 2e4)}, {"bottom": 0}, loads, contacts, element="P2/P1")
    return body, LoadProgram(body, given if forced else Plate())


def stepped(body, prescribed, state, *lengths):
    """The state after steps of some lengths (s); a plate of given force is looked for where it touches."""
    for dt in lengths:
        newton, guess = newton_for(body, rtol=1e-9, xtol=1e-9), state.x.copy()
        if body.tool is not None:
            guess[-1] = max(guess[-1], 3e-4)
        made = advance(body, state, dt, prescribed, lambda x=guess, newton=newton: newton.solve(body, x))
        assert made.failure is None
        state = made.state
    return state


def arrays(value):
    """All arrays and numbers of a state, one after the other."""
    if isinstance(value, dict):
        return [part for each in value.values() for part in arrays(each)]
    if isinstance(value, (list, tuple)):
        return [part for each in value for part in arrays(each)]
    return [np.array(value)]


def same(one, other):
    """Whether two states are the same to the bit."""
    pairs = list(zip(arrays(vars(one)), arrays(vars(other)), strict=True))
    return all(np.array_equal(a, b) for a, b in pairs)


def copied(state):
    """What a state holds now."""
    return [part.copy() for part in arrays(vars(state))]


@pytest.mark.one_thread
@pytest.mark.parametrize("forced", [False, True])
def test_a_state_is_a_value_from_which_one_goes_on_in_two_ways(forced):
    body, prescribed = pressed(forced)
    middle = stepped(body, prescribed, body.reset(), *[0.1] * 3)
    held, names = copied(middle), set(middle.internal)
    assert {"stress", "overstress", "strain", "inner", "slips", "pace"} <= names
    short, long = stepped(body, prescribed, middle, 0.1, 0.1), stepped(body, prescribed, middle, 0.5)
    assert all(np.array_equal(a, b) for a, b in zip(arrays(vars(middle)), held, strict=True))
    assert not same(short, long) and np.abs(short.x - long.x).max() > 1e-6
    assert same(short, stepped(body, prescribed, middle, 0.1, 0.1))
    other, again = pressed(forced)
    again.set(middle.t)
    other.set_state(middle)
    assert same(other.state(middle.t), middle)
    assert same(short, stepped(other, again, middle, 0.1, 0.1))


@pytest.mark.one_thread
def test_a_step_that_is_refused_leaves_no_trace():
    body, prescribed = pressed()
    start = stepped(body, prescribed, body.reset(), *[0.1] * 5)
    wanted = stepped(body, prescribed, start, 0.1)
    newton = newton_for(body, rtol=1e-9, xtol=1e-9)

    def refuse(record):
        return Breakdown("no reason", Status.INACCURATE)

    made = advance(body, start, 0.3, prescribed, lambda: newton.solve(body, start.x), refuse)
    assert made.failure is not None and made.failure.status is Status.INACCURATE and made.state is start
    assert np.array_equal(body.x, start.x) and same(body.state(start.t), start)
    assert same(stepped(body, prescribed, body.state(start.t), 0.1), wanted)


def test_rest_forgets_all():
    body, prescribed = pressed()
    first = body.reset()
    end = stepped(body, prescribed, first, 0.1, 0.2)
    assert not same(end, first)
    assert same(body.reset(), first)


@pytest.mark.one_thread
def test_a_load_history_and_a_motion_are_put_where_they_are_at_a_time():
    body, prescribed = pressed()
    both = LoadProgram(body, prescribed.motion, LoadHistory([0.0, 2.0, 4.0], [0.0, 1.0, 0.5]))
    assert both.events == (2.0, 4.0, 9.0) and both.factor(3.0) == 0.75 and both.travel(0.0, 0.5) == 1e-3
    both.set(3.0)
    assert body.factor.Get() == 0.75
