"""A soft penalty. Naive: the tissue stays behind the blade by the penetration. Ours: an offset on the wall makes up for it.

And the offset's order. Naive: less than the displacements', as for a multiplier; where a blade's edge is round the pressure is
steeper than it can follow. Ours: the same.
"""

import ngsolve as ngs
import numpy as np

from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact, offsets
from ngbrain.forward.solid import discretisation
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import Ogden
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

PRESS = ToolMotion("press", (0.0, 4.0), (0.0, 4e-3))


def force(penalty, share):
    drive = Drive(PRESS)
    contact = RigidContact("top", lambda x: 0.02 - drive.parameter - x[2], penalty, 2e-5, share)
    body = Problem(
        block((0.02, 0.02, 0.02), 0.01),
        {"tissue": Material(Ogden(1000.0, -15.0), 1e6)},
        {"bottom": 0},
        contacts=[contact],
        element="P2/P1",
    )
    up = ngs.GridFunction(body.fes.components[0])
    up.Set(ngs.CF((0, 0, 1)))
    transient = TimeStepper(body, drive, StepControl(1.0), 2e-3)
    transient.run(lambda *_: None)
    assert body.min_gap() < 0
    return float(up.vec.FV().NumPy() @ body.contact_forces()), -body.min_gap(), transient.progress.work.factorisations


def test_offset_makes_up_for_a_soft_penalty():
    exact, depth, _ = force(1e10, 0.0)
    soft, soft_depth, _ = force(3e7, 0.0)
    ours, _, _ = force(3e7, 0.95)
    assert depth < 2e-5 < 2e-4 < soft_depth
    assert abs(soft / exact - 1) > 0.15
    assert abs(ours / exact - 1) < 0.03


def stamped(penalty):
    """Force (N) of a stamp with round edges that goes 3 mm deep, and how deep (m) tissue is in it at most."""
    drive, radius = Drive(ToolMotion("press", (0.0, 4.0), (0.0, 3e-3))), 2e-3

    def distance(x):
        ahead, beside = 0.02 - drive.parameter - x[2] + radius, ngs.sqrt((x[0] - 0.01) ** 2 + 1e-18) - 5e-3 + radius
        beyond = ngs.sqrt(sum(ngs.IfPos(q, q, 0) ** 2 for q in (ahead, beside)) + 1e-18)
        deeper = ngs.IfPos(ahead - beside, ahead, beside)
        return beyond + ngs.IfPos(deeper, 0, deeper) - radius

    contact = RigidContact("top", distance, penalty, 1e-5, 0.98)
    tissue = {"tissue": Material(Ogden(1000.0, -8.0), 1e5)}
    body = Problem(block((0.02, 0.02, 0.02), 4e-3), tissue, {"bottom": 0}, contacts=[contact], element="P2/P1")
    up = ngs.GridFunction(body.fes.components[0])
    up.Set(ngs.CF((0, 0, 1)))
    TimeStepper(body, drive, StepControl(0.5), 2e-3).run(lambda *_: None)
    return float(up.vec.FV().NumPy() @ body.contact_forces()), -body.min_gap()


def test_an_offset_of_the_displacements_order_follows_round_edges(monkeypatch):
    exact, _ = stamped(1e8)
    ours, depth = stamped(5e6)
    monkeypatch.setattr(discretisation, "offsets", lambda mesh, contacts, order: offsets(mesh, contacts, order - 1))
    poorer, deeper = stamped(5e6)
    assert deeper > 1.3 * depth
    assert abs(poorer / exact - 1) > 0.02 > 0.015 > abs(ours / exact - 1)


def test_nothing_is_left_of_the_offset_when_the_blade_is_off():
    drive = Drive(ToolMotion("press and leave", (0.0, 4.0, 8.0), (0.0, 3e-3, -1e-3)))
    contact = RigidContact("top", lambda x: 0.02 - drive.parameter - x[2], 3e7, 2e-5, 0.95)
    body = Problem(
        block((0.02, 0.02, 0.02), 0.02),
        {"tissue": Material(Ogden(1000.0, -8.0), 1e6)},
        {"bottom": 0},
        contacts=[contact],
        element="P2/P1",
    )
    rows = []
    TimeStepper(body, drive, StepControl(1.0), 2e-3).run(
        lambda b, at, record: rows.append((b.min_gap(), np.abs(b.contact_forces()).max(), np.abs(b.offset.vec).max()))
    )
    gap, f, offset = np.array(rows).T
    assert (gap > 0).any() and np.all(f[gap > 0] == 0) and np.all(offset[gap > 0] < 1e-9)
    assert np.all(f[gap < 0] > 0) and offset.max() > 4e-5
