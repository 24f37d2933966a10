"""Volume change: what a law of shape leaves open."""

from __future__ import annotations

from ngsolve import CoefficientFunction

from ngbrain.materials.base import Value


def perturbed_lagrangian(J: CoefficientFunction, p: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """p (J - 1) - p²/(2K): stationary in p at p = K (J - 1), the mean Cauchy stress (Pa), for any bulk modulus K (Pa)."""
    return p * (J - 1) - p * p / (2 * bulk)
