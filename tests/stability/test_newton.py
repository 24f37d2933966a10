"""A block pressed by a third in one go. Naive: NGSolve's Newton takes whatever step comes. Ours: refuses and cuts."""

import ngsolve as ngs
import numpy as np
from ngsolve.solvers import Newton as NgsolveNewton

from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import Ogden
from ngbrain.mesh import block
from ngbrain.solvers.newton import Newton
from ngbrain.surgery.protocols import Drive, ToolMotion

DEPTH = 7e-3


def pressed():
    """A body of 20 mm and the drive of a plate that goes 7 mm into it in a second."""
    drive = Drive(ToolMotion("press", (0.0, 1.0), (0.0, DEPTH)))
    contact = RigidContact("top", lambda x: 0.02 - drive.parameter - x[2], 1e8, 2e-5)
    return Problem(
        block((0.02,) * 3, 0.01),
        {"tissue": Material(Ogden(1e3, -20.0), 1e6)},
        {"bottom": 0},
        contacts=[contact],
        element="P2/P1",
    ), drive


def test_naive_newton_ends_nowhere():
    body, drive = pressed()
    drive.set(1.0)
    body.begin(1.0)
    try:
        failed, _ = NgsolveNewton(body.form, body.gfu, maxit=40, printing=False, inverse="sparsecholesky")
    except Exception:
        return  # it died in the factorisation: a failure too
    assert failed or not body.min_det(body.x) > 0


def test_ours_gets_there_by_cutting_steps():
    body, drive = pressed()
    transient = TimeStepper(body, drive, StepControl(1.0, first=1.0), penetration_limit=5e-3)
    smallest = []
    transient.run(lambda b, at, record: smallest.append(record.min_det_F))
    assert transient.progress.t == 1.0 and transient.progress.rejected > 0
    assert min(smallest) > 0.2 and np.all(np.isfinite(body.x))


def test_the_mixed_residual_is_finite_at_an_inverted_state_and_ours_refuses_it():
    body, _ = pressed()
    body.begin(1.0)
    body.u.Set(ngs.CF((0, 0, -1.5 * ngs.z)))
    x = body.x
    assert np.all(np.isfinite(body.residual(x)[0]))  # the trap: nothing in the residual says that J < 0
    _, record = Newton().solve(body, x)
    assert not record.converged and "inverted" in record.reason
