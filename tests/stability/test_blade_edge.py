"""Under a blade's sharp edge. Naive: NGSolve's Newton reports convergence of every step, to states with inverted elements.

The residual of an incompressible body with its pressure stays finite at det F < 0, so that it cannot tell. Ours: steps are cut,
and det F stays far from 0 at every quadrature point; a barrier keeps the volume of the elements at the edge.
"""

import ngsolve as ngs
import pytest
from ngsolve.solvers import Newton as NgsolveNewton

from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block
from ngbrain.solvers.newton import Newton
from ngbrain.surgery.protocols import Drive, ToolMotion

SIDE, DEPTH, MU, BULK = 0.02, 5e-3, 1e3, 1e6
SHARP = 1e-5
"""Radius (m) of the edge."""
STEPS = 10


def scene(pointwise=0.0):
    """A cube of 20 mm, and a blade over half of its top that goes 5 mm into it."""
    drive = Drive(ToolMotion("press", (0.0, 1.0), (0.0, DEPTH)))

    def distance(x):
        inward = SIDE - drive.parameter - x[2] + SHARP, x[0] - SIDE / 2 + SHARP
        below, aside = (ngs.IfPos(q, q, 0) for q in inward)
        deepest = ngs.IfPos(inward[0] - inward[1], *inward)
        return ngs.sqrt(below**2 + aside**2 + 1e-18) + ngs.IfPos(deepest, 0, deepest) - SHARP

    contact = RigidContact("top", distance, 2e7, 2e-5)
    return Problem(
        block((SIDE,) * 3, 0.007),
        {"tissue": Material(NeoHooke(MU), BULK, pointwise)},
        {"bottom": 0},
        contacts=[contact],
        element="P2/P1",
    ), drive


def test_naive_newton_takes_inverted_elements_for_an_equilibrium():
    body, drive = scene()
    (u, p, _), state = body.fes.TrialFunction(), ngs.GridFunction(body.fes)
    F = ngs.Id(3) + ngs.Grad(u)
    J = ngs.Det(F)
    form = ngs.BilinearForm(body.fes, symmetric=True)
    energy = MU / 2 * (ngs.InnerProduct(F, F) - 3 - 2 * (J - 1)) + p * (J - 1) - p * p / (2 * BULK)
    form += ngs.Variation(energy.Compile() * ngs.dx)
    form += ngs.Variation(body.contacts[0].energy(u).Compile() * body.contacts[0].measure())
    for i in range(STEPS):
        drive.set((i + 1) / STEPS)
        failed, _ = NgsolveNewton(form, state, maxit=20, maxerr=1e-8, printing=False, inverse="sparsecholesky")
        assert not failed
    reached = state.vec.FV().NumPy()
    print("smallest det F", body.min_det(reached))
    assert body.min_det(reached) < -0.01
    assert "inverted" in Newton().solve(body, reached)[1].reason  # ours does not even start there


@pytest.mark.parametrize(
    ("pointwise", "least"), [(0.0, 0.65), (10 * MU, 0.9)], ids=["pressure alone", "with a barrier"]
)
def test_ours_cuts_steps_and_inverts_nothing(pointwise, least):
    body, drive = scene(pointwise)
    transient = TimeStepper(body, drive, StepControl(1 / STEPS, first=1.0, restart=1.0), 1e-3)
    smallest = []
    transient.run(lambda b, at, record: smallest.append(record.min_det_F))
    print("smallest det F", min(smallest), "steps", transient.progress.steps, "cut", transient.progress.rejected)
    assert transient.progress.t == 1.0 and transient.progress.rejected > 0 and min(smallest) > least
