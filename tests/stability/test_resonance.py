"""Near a resonance. Naive: a wave without loss, solved as if nothing were the matter. Ours: the distance is reported.

A clamped slab, kL = 3π at the third resonance. Its peak over that of a slab far from resonance is 1/2ξ-fold but for a
factor: 106 at a damping ratio of 0.001, 10.6 at 0.01, 2.2 at 0.05, 1.24 at 0.1. Without loss it is whatever round-off and
mesh leave: it grows tenfold with each tenfold approach.
"""

from itertools import pairwise

import numpy as np
import pytest
from waves import displacement, strip

from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.materials import Shearing

LENGTH, MODULUS, RHO = 0.05, 2000.0, 1000.0
THIRD = 3 * np.pi / LENGTH * np.sqrt(MODULUS / RHO)
"""rad/s."""


def slab(omega, xi=0.0):
    """Driven on the left, clamped on the right."""
    wave = Wave(omega / (2 * np.pi), {"left": (0, 1.0)})
    held = {"x": ".*", "y": "left|right"}
    return HarmonicProblem(
        strip(12, LENGTH), Shearing(MODULUS * (1 + 2j * xi)), [wave], bulk=1e5, form="P5", dirichlet=held
    )


def peak(omega, xi=0.0):
    """Largest |u| in metres for a metre of drive."""
    body = slab(omega, xi)
    u = displacement(body)
    return max(abs(u(body.mesh(x, 0.001))[1]) for x in np.linspace(0, LENGTH, 201))


@pytest.mark.parametrize(("xi", "published"), [(0.001, 106), (0.01, 10.6), (0.05, 2.2), (0.1, 1.24)])
def test_loss_bounds_the_peak(xi, published):
    assert peak(THIRD, xi) == pytest.approx(published, rel=0.05)


def test_naive_waves_without_loss_have_no_bound():
    peaks = [peak(THIRD * (1 + off)) for off in (1e-2, 1e-3, 1e-4, 1e-5)]
    print(peaks)
    assert all(8 < b / a < 12 for a, b in pairwise(peaks))


@pytest.mark.parametrize("off", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5])
def test_ours_says_how_near_it_is(off):
    body = slab(THIRD * (1 + off))
    found = body.factorise().detuning(0)
    assert found == pytest.approx(off / (1 + off), rel=1e-3, abs=2e-9)


def test_ours_says_what_loss_leaves():
    """With loss the nearest resonance lies off the real axis: ξ away, but for its square."""
    for xi in (0.01, 0.1):
        assert slab(THIRD, xi).factorise().detuning(0) == pytest.approx(xi, rel=xi)
