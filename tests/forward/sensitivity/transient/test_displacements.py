"""Derivatives of runs by displacements that are prescribed, which grow and fall with a load factor, once and twice."""

import ngsolve as ngs
import numpy as np
import pytest
from force_models import BENT, GRID, SIDE, checked
from friction_blocks import VALUES, Sliding, law_of, mesh_of

from ngbrain.forward.common.loads import PressureLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.force_control import PrescribedForce
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.observables import Force
from ngbrain.forward.sensitivity.parameter_blocks import PrescribedDisplacement
from ngbrain.forward.sensitivity.transient.run_linearisation import RunLinearisation
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.advance import LoadHistory
from ngbrain.forward.solid.inertia import Inertia
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.time_stepper import run_load_history

FACTORS = LoadHistory([0.0, 1.0, 8.0], [0.0, 1.0, 0.7])
CASES = ("alone", "pressure", "friction", "given force", "mass")


def pushed(what):
    """A block whose left side is pushed aside, touched by a plate or not."""
    mesh, p = mesh_of("plane strain", 2), {name: ngs.Parameter(value) for name, value in VALUES.items()}
    plate, loads, contacts = Sliding(5e-4, 1e-3), [], []
    motion, deep, way = plate, plate.down, plate.along
    if what == "given force":
        motion = PrescribedForce((0.0, 1.0, 8.0), (0.0, 0.3, 0.3), away=-1e-3, nudge=1e-5)
        deep = way = motion.parameter
    if what != "alone":
        contacts = [RigidContact("top", lambda x: SIDE - deep - x[1], p["penalty"], 2e-5, 0.9, travel=way)]
    if what == "friction":
        contacts.append(Friction(contacts[0], p["friction"], 5e-5, lambda x, way: way * ngs.CF((1.0, 0.0))))
    loads += [PressureLoad("right", 20.0)] if what == "pressure" else [Inertia(1e5)] if what == "mass" else []
    contacts += [motion] if what == "given force" else []
    supports = {"bottom": 0, "left": (-2e-4 * (1 + ngs.y / SIDE), None)}
    body = Problem(mesh, {".*": Material(law_of("Prony", p), 2e4)}, supports, loads, contacts, element="P2/P1")
    used = {"mu": p["mu"], "tau": p["tau"], "left": PrescribedDisplacement(body, "left")}
    return RunModel(body, motion, GRID, used, [Force("bottom"), BENT], loads=FACTORS)


@pytest.mark.parametrize("what", CASES)
def test_rates_once_and_twice(what, rng):
    of = pushed(what)
    of.evaluate(of.theta)
    rates, twice, apart, uneven = checked(of, rng, 1e-3)
    print(what, rates, twice, apart, uneven)
    assert rates[-1] == pytest.approx(2, abs=0.1) and twice[-1] == pytest.approx(2, abs=0.1)
    assert apart < 1e-7 and uneven < 1e-9


def test_a_run_is_that_of_a_load_history():
    of = pushed("alone")
    seen = Force("bottom").on(of.body)
    factors = [FACTORS.factor(t) for t in GRID]
    rows = run_load_history(of.body, GRID, factors, lambda t: seen.value())
    found = of.evaluate(of.theta).data[:, :2]
    assert found == pytest.approx(np.array(rows), rel=1e-4, abs=1e-6) and np.abs(found).min(axis=0).max() > 1e-2


def test_what_adjoints_take_away_elsewhere_is_what_is_left_there(rng, monkeypatch):
    monkeypatch.setattr(
        RunLinearisation, "_prescribed_gradient", lambda self, step, b, adjoint: np.zeros(self.model.size)
    )
    of = pushed("alone")
    of.evaluate(of.theta)
    rates, *_ = checked(of, rng, 1e-3)
    assert rates[-1] < 1.3, rates
