"""A plate of given force on a block: the force is held, the way creeps as it should, and is the one that needs the force."""

import ngsolve as ngs
import numpy as np
import pytest
from plate_contact import Failing, force

from ngbrain.errors import ContactError, ConvergenceError, InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.force_control import CLOSE, PrescribedForce
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact, SlidingSupport
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import ErrorControl, StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import Branch, NeoHooke, Prony, Viscous, lab
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

SIZE, AWAY, NUDGE = 0.02, -1e-3, 1e-5
MU, G, TAU = 1000.0, 0.6, 8.0
PRESS = ((0.0, 4.0, 30.0, 34.0, 50.0, 54.0, 80.0), (0.0, 0.1, 0.1, 0.0, 0.0, 0.05, 0.05))
"""Press, hold, let go, leave, and press again."""
STEPS = ErrorControl(1e-2, touch=0.1, pushing=1.0)


def pressing(
    law, program=PRESS, control=STEPS, share=0.98, films=(), penalty=1e8, softness=2e-5, nudge=NUDGE, limit=np.inf
):
    """A plate on a bonded block, or on one that slides."""
    press = PrescribedForce(*program, AWAY, nudge, limit)
    plate = RigidContact("top", lambda x: SIZE - press.parameter - x[2], penalty, softness, share, press.parameter)
    mesh = block((SIZE,) * 3, SIZE)
    slides = [SlidingSupport.on(mesh, wall, 1e9) for wall in films]
    supports = {} if films else {"bottom": 0}
    body = Problem(
        mesh, {"tissue": Material(law, 1e3 * MU)}, supports, contacts=[plate, *slides, press], element="P2/P1"
    )
    return TimeStepper(body, press, control, 1e-3)


def followed(transient, until=np.inf):
    """Time, way, asked and felt force, nodal force, gap after each step."""
    rows, press = [], transient.motion
    transient.run(
        lambda b, at, _: rows.append(
            (at.t, press.parameter.Get(), press.prescribed_force(at.t), b.tool.reaction_force(), force(b), b.min_gap())
        ),
        until,
    )
    return np.array(rows).T


@pytest.fixture
def relaxing():
    return Viscous(NeoHooke(MU * (1 - G)), (Branch(NeoHooke(MU * G), TAU),))


@pytest.mark.parametrize("share", [0.0, 0.98])
def test_the_force_is_that_asked_for(relaxing, share):
    t, way, asked, felt, nodal, _ = followed(pressing(relaxing, share=share))
    on = asked > 0
    assert on.sum() > 30 and np.allclose(felt[on], asked[on], rtol=1e-3, atol=0)
    assert np.allclose(nodal, felt, rtol=1e-6, atol=1e-12)
    assert set(PRESS[0][1:]) <= set(t)
    assert np.all(np.diff(way[(t >= 4) & (t <= 30)]) > 0), "it creeps"


def test_without_force_the_plate_is_just_clear_and_the_tissue_comes_back(relaxing):
    _, way, asked, felt, nodal, gap = followed(pressing(relaxing))
    off = asked == 0
    assert off.sum() > 3 and not np.any(felt[off]) and not np.any(nodal[off])
    assert gap[off] == pytest.approx(CLOSE, rel=0.02)
    assert np.all(np.diff(way[off]) < 0) and way[off][-1] < 0.5 * way[off][0] < 0.5 * way.max()
    assert np.all(gap[~off] < 0)


@pytest.mark.parametrize(("tolerance", "error"), [(1e-2, 1e-2), (1e-3, 3e-3)])
def test_a_bonded_block_creeps_by_the_compliance_of_its_law(tolerance, error):
    """Small strain: the way is the elastic one times the creep of the law, 1/g - (1/g - 1) exp(-t g/τ), after a ramp."""
    law, hard = Prony(NeoHooke(MU), [G], [TAU]), {"penalty": 2e10, "softness": 1e-8, "nudge": 1e-7}
    program = ((0.0, 4.0, 60.0), (0.0, 1e-3, 1e-3))
    control = ErrorControl(tolerance, touch=0.1, pushing=1.0)
    t, way, *_ = followed(pressing(law, program, control, share=0.0, **hard))
    _, elastic, *_ = followed(pressing(Viscous(NeoHooke(MU)), program, control, share=0.0, **hard))
    stays = 1 - G
    rate, held = stays / TAU, t >= 4
    late = np.exp(-rate * t[held]) * np.expm1(rate * 4.0) / (rate * 4.0)
    assert way.max() < 2e-3 * SIZE and held.sum() > 5
    assert way[held] / elastic[-1] == pytest.approx(1 / stays - (1 / stays - 1) * late, rel=error)


def test_a_block_that_slides_creeps_as_in_the_laboratory(relaxing):
    """A fifth of its height, between plates without friction: a uniaxial test of the same nominal stress."""
    program = ((0.0, 4.0, 60.0), (0.0, 0.3, 0.3))
    more = {"films": ("bottom", "left", "front"), "penalty": 1e9, "softness": 1e-6}
    t, way, *_ = followed(pressing(relaxing, program, ErrorControl(1e-3, touch=0.1, pushing=1.0), **more))
    fine = np.unique(np.concatenate([np.linspace(0, 60, 2401), t]))
    stretch = lab.creep(relaxing, "uniaxial", -np.interp(fine, *program) / SIZE**2, fine)
    assert way.max() > 0.2 * SIZE
    assert way == pytest.approx(SIZE * (1 - np.interp(t, fine, stretch)), rel=0.01)


def test_it_is_the_way_that_a_plate_driven_along_it_needs_the_force_for(relaxing):
    until = 30.0
    forced = pressing(relaxing)
    states = []
    run = forced.problem
    rows = [(0.0, 0.0)]

    def keep(body, at, _):
        rows.append((at.t, forced.motion.parameter.Get()))
        states.append(run.x[:-1])

    forced.run(keep, until)
    times, ways = zip(*rows, strict=True)
    drive = Drive(ToolMotion("found", times, ways))
    plate = RigidContact("top", lambda x: SIZE - drive.parameter - x[2], 1e8, 2e-5, 0.98)
    body = Problem(
        block((SIZE,) * 3, SIZE),
        {"tissue": Material(relaxing, 1e3 * MU)},
        {"bottom": 0},
        contacts=[plate],
        element="P2/P1",
    )
    steps = StepControl(100.0, first=1.0, restart=1.0, dt_max=100.0)
    driven, found = TimeStepper(body, drive, steps, 1e-3), []
    driven.run(lambda b, at, _: found.append((b.x, force(b))))
    assert len(found) == len(states) > 10
    for (state, felt), wanted, t in zip(found, states, times[1:], strict=True):
        assert np.abs(state - wanted)[body.is_u].max() < 1e-5 * np.abs(wanted[body.is_u]).max()
        assert felt == pytest.approx(forced.motion.prescribed_force(t), rel=1e-3)


@pytest.mark.one_thread
@pytest.mark.parametrize("until", [2.0, 10.0, 40.0, 52.0])
def test_restart_goes_on_with_the_same_bits(relaxing, until):
    whole = pressing(relaxing)
    whole.run(lambda *_: None)
    half, other = pressing(relaxing), pressing(relaxing)
    half.run(lambda *_: None, until)
    saved = half.checkpoint()
    other.restore(saved)
    np.testing.assert_equal(other.checkpoint(), saved)
    other.run(lambda *_: None)
    assert np.array_equal(other.problem.x, whole.problem.x)
    assert other.progress.steps == whole.progress.steps


def test_a_step_that_failed_twice_begins_where_the_body_stands(relaxing):
    transient = pressing(relaxing)
    followed(transient, until=2.0)
    assert transient.progress.touching
    transient.newton, stood = Failing(at=(0, 1, 2)), transient.problem.x.copy()
    transient.step()
    ahead = [np.abs(guess - stood).max() for guess in transient.newton.begun]
    assert ahead[0] > ahead[1] > 1e-6 and ahead[2:] == [0, 0]


@pytest.mark.parametrize("until", [10.0, 40.0])
def test_a_step_that_fails_leaves_the_last_state(relaxing, until):
    transient = pressing(relaxing)
    transient.run(lambda *_: None, until)
    before = transient.problem.x
    transient.newton = Failing(at=tuple(range(99)))
    with pytest.raises(ConvergenceError, match="given up"):
        transient.step()
    assert np.array_equal(transient.problem.x, before)


def test_a_force_that_goes_too_far_is_one_error(relaxing):
    transient = pressing(relaxing, limit=1.2e-3)
    with pytest.raises(ContactError, match=r"0\.\d+ N .*1\.\d+ mm, beyond the limit of 1\.2 mm"):
        transient.run(lambda *_: None)
    assert 0.5e-3 < transient.problem.x[-1] <= 1.2e-3


@pytest.mark.parametrize("coefficient", [0.1, 0.3])
def test_a_given_force_bears_pressure_and_friction(coefficient):
    """A plate that goes along the top as far as it goes down, and slides: f = N + μN."""
    press = PrescribedForce((0.0, 4.0, 8.0), (0.0, 2e-2, 2e-2), AWAY, NUDGE)
    plate = RigidContact("top", lambda x: SIZE - press.parameter - x[2], 1e6, 2e-5, 0.0, press.parameter)
    rubs = Friction(plate, coefficient, 1e-6, lambda x, way: way * ngs.CF((1.0, 0.0, 0.0)))
    tissue = {"tissue": Material(NeoHooke(MU), 20 * MU)}
    films = {"bottom": (None, None, 0), "left|right": (0, None, None), "front|back": (None, 0, None)}
    body = Problem(block((SIZE,) * 3, SIZE), tissue, films, contacts=[plate, rubs, press], element="P2/P1")
    run = TimeStepper(body, press, StepControl(1.0), 1e-3)
    run.run(lambda *_: None)
    assert body.tool.reaction_force() == pytest.approx(2e-2, rel=1e-6)
    assert body.force("bottom")[2] == pytest.approx(2e-2 / (1 + coefficient), rel=1e-5)
    assert run.progress.rejected == 0


def test_given_forces_have_a_contact_and_a_run_of_their_own():
    press, other = (PrescribedForce(*PRESS, AWAY, NUDGE) for _ in range(2))
    plate = RigidContact("top", lambda x: SIZE - press.parameter - x[2], 1e8, 2e-5, 0.0, press.parameter)
    mesh, tissue = block((SIZE,) * 3, SIZE), {"tissue": Material(NeoHooke(MU), 1e3 * MU)}
    parts, element = (mesh, tissue, {"bottom": 0}), {"element": "P2/P1"}
    with pytest.raises(InputError, match="a RigidContact whose travel is its parameter"):
        Problem(*parts, contacts=[plate, other], **element)
    with pytest.raises(InputError, match="2 prescribed forces"):
        Problem(*parts, contacts=[plate, press, other], **element)
    with pytest.raises(InputError, match="the PrescribedForce that is among"):
        TimeStepper(Problem(*parts, contacts=[plate], **element), press, StepControl(1.0))
    with pytest.raises(InputError, match="the PrescribedForce that is among"):
        TimeStepper(Problem(*parts, contacts=[plate, press], **element), other, StepControl(1.0))
