"""A replayed step that Newton's method reaches in parts only: a curved plate goes far into a soft block at once.

Parts that start where the last one ended end where Newton's method has no step left; parts that start where the last two lead
arrive.
"""

import numpy as np
import pytest

from ngbrain.errors import ConvergenceError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.sensitivity.transient.replay import Replay
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke, Prony
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

SIDE, DEPTH, CURVATURE = 0.02, 6e-3, 40.0


def replay():
    """A relaxing cube and a stiff plate, a tenth of whose way comes in the first step and the rest in the second."""
    drive = Drive(ToolMotion("press", (0.0, 2.0, 8.0), (0.0, DEPTH, DEPTH)))
    plate = RigidContact(
        "top", lambda x: SIDE - drive.parameter - x[2] + CURVATURE / 2 * (x[0] - SIDE / 2) ** 2, 1e8, 2e-5
    )
    tissue = Material(Prony(NeoHooke(1000.0), [0.5], [3.0]), 1e6)
    body = Problem(block((SIDE,) * 3, 7e-3), {"tissue": tissue}, {"bottom": 0}, contacts=[plate], element="P2/P1")
    return Replay(body, drive, np.array([0.0, 0.2, 2.0, 8.0]))


def test_parts_of_a_step_go_on_where_the_last_two_lead(monkeypatch):
    ends = []
    replay().run(ends.append)
    assert [step.n for step in ends] == [0, 1, 2]
    extrapolated = Replay._extrapolated

    def naive(self, before, last, t):
        return extrapolated(self, before, last, t) if last[0] in self.grid else last[1]

    monkeypatch.setattr(Replay, "_extrapolated", naive)
    with pytest.raises(ConvergenceError, match=r"from 0\.2 to 2 s"):
        replay().run(lambda step: None)
