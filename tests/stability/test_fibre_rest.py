"""A first load on stiff fibres. Naive: at rest they count as slack, and no step is short enough. Ours: they bear."""

import pytest

from ngbrain.errors import SolverError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import HolzapfelGasserOgden, fibre
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

FIBRES = {"across": (1, 0, 0), "oblique": (1, 2, 0.5)}


def press(direction):
    """Newton iterations of each step while a plate goes 3 mm into 20 mm of tissue with k₁ ten times μ."""
    drive = Drive(ToolMotion("press", (0.0, 4.0), (0.0, 3e-3)))
    contact = RigidContact("top", lambda x: 0.02 - drive.parameter - x[2], 1e8, 2e-5)
    law = HolzapfelGasserOgden(500.0, 5e3, 5.0, 0.05, direction)
    body = Problem(
        block((0.02,) * 3, 0.007), {"tissue": Material(law, 1.5e6)}, {"bottom": 0}, contacts=[contact], element="P2/P1"
    )
    iterations = []
    TimeStepper(body, drive, StepControl(1.0), 1e-3).run(lambda b, at, record: iterations.append(record.iterations))
    return iterations


@pytest.mark.parametrize("direction", FIBRES.values(), ids=FIBRES)
def test_naive_switch_at_rest_gives_up_at_the_first_load(direction, monkeypatch):
    monkeypatch.setattr(fibre, "SLACK", 0.0)
    with pytest.raises(SolverError, match=r"at t = 0\.000 s still fails: no acceptable step"):
        press(direction)


@pytest.mark.parametrize("direction", FIBRES.values(), ids=FIBRES)
def test_ours_goes_all_the_way(direction):
    iterations = press(direction)
    assert len(iterations) <= 10 and max(iterations) <= 35
