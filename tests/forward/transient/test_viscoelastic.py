"""Problem bodies under loads over time against closed forms."""

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import InputError, SolverError
from ngbrain.forward.common.loads import BodyForce, Spring, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Displacements
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.advance import newton_for
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.time_stepper import run_load_history
from ngbrain.materials import Maxwell, NeoHooke, Ogden, Prony, Viscous
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

SIDE, MU, G, TAU = 0.02, 1e3, 0.6, 2.0
STIFF = 1e3
"""K/μ."""
FREE = {"bottom": (None, None, 0), "left": (0, None, None), "front": (None, 0, None)}
TIMES = np.array([0.0, 0.5, 1.0, 1.5, 2.5, 4.0, 8.0])
RAMP = np.minimum(TIMES, 1.0)


def bar(law, down=None, loads=()):
    supports = FREE if down is None else {**FREE, "top": (None, None, -down)}
    mesh = block((SIDE, SIDE, SIDE), SIDE)
    return Problem(mesh, {"tissue": Material(law, STIFF * MU)}, supports, loads, element="P2/P1")


LAWS = {
    "prony": Prony(NeoHooke(MU), [G], [TAU]),
    "flowing": Viscous(NeoHooke((1 - G) * MU), (Maxwell(NeoHooke(G * MU), G * MU * TAU),)),
}


@pytest.mark.parametrize("name", LAWS)
def test_small_strains_relax_after_a_ramp_as_the_convolution_says(name):
    strain = 1e-4
    body = bar(LAWS[name], strain * SIDE)
    forces = np.array(run_load_history(body, TIMES, RAMP, lambda t: -body.force("top")[2]))
    t = TIMES[1:]
    left = TAU * (np.exp(-(t - np.minimum(t, 1)) / TAU) - np.exp(-t / TAU))
    exact = 3 * MU * strain * SIDE**2 * ((1 - G) * np.minimum(t, 1) + G * left)
    assert forces == pytest.approx(exact, rel=2e-3)


def test_a_dead_load_creeps_as_a_standard_solid_does():
    strain = 1e-4
    pull = TractionLoad("top", (0, 0, 3 * MU * strain))
    body = bar(LAWS["prony"], loads=[pull])
    times = np.array([0, 1e-6, 0.5, 1, 1.5, 2, 3, 4, 6, 8, 12])
    u = np.array(run_load_history(body, times, np.minimum(times / 1e-6, 1), lambda t: body.u(body.mesh(0, 0, SIDE))[2]))
    # ε = σ/3μ (1 + g/(1 - g) (1 - exp(-(1 - g) t/τ)))
    exact = strain * SIDE * (1 + G / (1 - G) * (1 - np.exp(-(1 - G) * times[1:] / TAU)))
    assert u == pytest.approx(exact, rel=5e-3)


def test_in_the_end_it_is_the_elastic_body_of_what_stays():
    stays = Ogden(400.0, -8.0)
    body = bar(Viscous(stays, (Maxwell(NeoHooke(600.0), 60.0),)), 0.2 * SIDE)
    force = -run_load_history(body, [0, 1, 200], [0, 1, 1], lambda t: body.force("top")[2])[-1]
    elastic = bar(Viscous(stays), 0.2 * SIDE)
    assert force == pytest.approx(
        -run_load_history(elastic, [0, 1], [0, 1], lambda t: elastic.force("top")[2])[-1], rel=1e-4
    )


def test_a_step_too_far_is_halved_and_an_impossible_one_given_up():
    body = bar(LAWS["flowing"], 0.75 * SIDE)
    steps = []
    run_load_history(body, [0, 1], [0, 1], steps.append)
    assert steps == [1.0]
    assert body.min_det(body.x) > 0
    with pytest.raises(SolverError, match="time step") as error:
        run_load_history(bar(LAWS["flowing"], 1.2 * SIDE), [0, 1], [0, 1], lambda t: t)
    assert error.value.status and error.value.result.reason in str(error.value)


def test_times_have_to_increase():
    body = bar(LAWS["prony"], 1e-5)
    for times, factors in (([0, 1, 1], [0, 1, 1]), ([0, 1], [0, 1, 1]), ([0], [0])):
        with pytest.raises(InputError, match="times"):
            run_load_history(body, times, factors, lambda t: t)


def test_a_body_of_contacts_bears_loads_as_this_one_does():
    """A block that sticks to a plate, is pulled aside and heavy."""
    mesh, tissue, grid = block((0.02,) * 3, 0.02), Material(Prony(NeoHooke(1e3), [0.5], [3.0]), 1e6), [0, 1, 2.5, 4, 40]
    weight = BodyForce((0.0, -9e3, 0.0))
    supports, loads = {"bottom": 0, "top": (4e-4, 0, -2e-3)}, [TractionLoad("right", (900.0, 0, 0)), weight]
    one = Problem(mesh, {".*": tissue}, supports, loads, element="P2/P1")
    point, share = mesh(0.013, 0.01, 0.012), lambda t: min(t / 4, 1.0)
    tight = newton_for(one, rtol=1e-11, xtol=1e-11)
    wanted = run_load_history(one, grid, [share(t) for t in grid], lambda t: one.u(point), tight)
    drive = Drive(ToolMotion("hold", (0.0, 4.0, 40.0), (0.0, 1.0, 1.0)))
    a = drive.parameter
    plate = Spring("top", 1e10, (4e-4 * a, 0.0, -2e-3 * a))
    loads = [TractionLoad("right", (900.0 * a, 0.0, 0.0)), BodyForce((0.0, -9e3 * a, 0.0)), plate]
    other = Problem(mesh, {"tissue": tissue}, {"bottom": 0}, loads, element="P2/P1")
    of = RunModel(other, drive, grid, {"none": ngs.Parameter(0.0)}, [Displacements([[0.013, 0.01, 0.012]])])
    assert of.evaluate(of.theta).data == pytest.approx(np.array(wanted), abs=1e-5 * np.abs(wanted).max())


def test_loads_on_what_is_not_there_are_refused():
    mesh, tissue = block((0.02,) * 3, 0.02), {"tissue": Material(NeoHooke(1e3), 1e6)}
    with pytest.raises(InputError, match="boundary"):
        Problem(mesh, tissue, {"bottom": 0}, [Spring("nowhere", 1e3)], element="P2/P1")
