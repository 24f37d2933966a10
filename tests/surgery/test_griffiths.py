"""Griffiths 2024: opening in 150 s and a hold of half an hour, with the published constants."""

import numpy as np
import pytest
from plate_contact import force

from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import ErrorControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.materials import constants
from ngbrain.mesh import block
from ngbrain.surgery.material_point import Column
from ngbrain.surgery.protocols import Drive, continuous_retraction

pytestmark = pytest.mark.filterwarnings("ignore::ngbrain.errors.RangeWarning")

RAMP, END, SIZE = 150.0, 1950.0, 0.02
KEPT = {"cortex": 0.469, "corpus_callosum": 0.414}
"""Remaining share of the force by the published constants, to three digits."""


def left(entry):
    """F(END)/F(RAMP) at small strain: F(t) ∝ ∫ G(t - s) ds over the ramp, G = μ∞ + Σ μ_k exp(-t/τ_k), whatever the shape."""
    stays, (mu, eta) = entry.law().equilibrium.mu, np.array([(b.law.mu, b.eta) for b in entry.law().maxwell_branches]).T
    tau = eta / mu
    opened, ended = ((tau * (np.exp(-(t - RAMP) / tau) - np.exp(-t / tau)) / RAMP) @ mu for t in (RAMP, END))
    return (stays + ended) / (stays + opened)


@pytest.mark.parametrize("region", ["cortex", "corpus_callosum"])
def test_a_pressed_block_keeps_the_share_that_the_constants_say(region):
    """A bonded block and a material point, compressed by 0.1 %."""
    entry, way = constants(f"griffiths2024:{region}"), 1e-3 * SIZE
    protocol, mu = continuous_retraction(way, RAMP, END), entry.initial_modulus
    drive, rows = Drive(protocol), []
    plate = RigidContact("top", lambda x: SIZE - drive.parameter - x[2], 2e5 * mu, 0.02 * way)
    body = Problem(
        block((SIZE,) * 3, 0.02),
        {"tissue": Material(entry.law(), 1000 * mu)},
        {"bottom": 0},
        contacts=[plate],
        element="P2/P1",
    )
    transient = TimeStepper(body, drive, ErrorControl(1e-2, touch=1.0), 1e-3)
    transient.run(lambda b, at, record: rows.append((at.t, force(b))))
    t, f = np.array(rows).T
    point = Column(entry.law(), SIZE, "planar").push(protocol)
    found = f[-1] / f[t == RAMP][0], point.pressure[-1] / point.pressure[point.t == RAMP][0]
    print(region, found, left(entry), len(t))
    assert left(entry) == pytest.approx(KEPT[region], abs=5e-4)
    assert found == pytest.approx((left(entry),) * 2, rel=0.005)
