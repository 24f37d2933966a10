"""A plate that presses a block, holds and lifts off, and the force it has meanwhile."""

from dataclasses import dataclass, field

import ngsolve as ngs
import numpy as np

from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.result import Status
from ngbrain.solvers.newton import Newton

PRESS = ((0, 4, 40, 44, 60), (0, 2e-3, 2e-3, -1e-3, -1e-3))


def force(body):
    """Force (N) of the plate on the top: the contact's nodal forces along z."""
    up = ngs.GridFunction(body.fes.components[0])
    up.Set(ngs.CF((0, 0, 1)))
    return float(up.vec.FV().NumPy() @ body.contact_forces())


def run(body, drive, control, **kwargs):
    """The run, and time, force and gap after each step."""
    transient = TimeStepper(body, drive, control, 1e-3, **kwargs)
    rows = []
    transient.run(lambda b, at, record: rows.append((at.t, force(b), b.min_gap())))
    return transient, np.array(rows)


@dataclass
class Failing(Newton):
    """Gives up at some attempts, counted from 0; where each began is `begun`."""

    at: tuple[int, ...] = ()
    attempts: int = 0
    why: str = "given up"
    status: Status = Status.STALLED
    begun: list = field(default_factory=list)

    def solve(self, system, x):
        self.begun.append(x.copy())
        x, record = super().solve(system, x)
        if self.attempts in self.at:
            record.status, record.reason, self.inverse = self.status, self.why, None
        self.attempts += 1
        return x, record
