"""Volume change: what a law of shape leaves open."""

from __future__ import annotations

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.materials.base import Value

STEEPNESS = 30
"""m of `barrier`: its resistance is 10 times κ at J = 0.9 and 400 times at 0.8."""


def perturbed_lagrangian(J: CoefficientFunction, p: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """p (J - 1) - p²/2K, stationary in p at p = K (J - 1), for any bulk modulus K (Pa); p is the mean Cauchy stress."""
    return p * (J - 1) - p * p / (2 * bulk)


def barrier(J: CoefficientFunction, kappa: Value) -> CoefficientFunction:
    """κ/m² (cosh(m ln J) - 1), κ/2 (J - 1)² near J = 1 and steep beyond |J - 1| = 0.1.

    A continuous p holds J only in the mean over an element; this keeps single points from collapsing. With κ (Pa) a part
    of a shear modulus it neither locks nor adds to what a bulk modulus of a thousand carries.
    """
    power = ngs.exp(STEEPNESS * ngs.log(J))
    return kappa / (2 * STEEPNESS**2) * (power + 1 / power - 2)
