"""Volume change: what a law of shape leaves open."""

from __future__ import annotations

from ngsolve import CoefficientFunction

from ngbrain.materials.base import Value


def perturbed_lagrangian(
    J: CoefficientFunction, p: CoefficientFunction, bulk: Value, pointwise: Value = 0.0
) -> CoefficientFunction:
    """p (J - 1) - p²/(2(K - κ)) + κ/2 (J - 1)², for any bulk modulus K (Pa).

    Stationary in p at p = (K - κ)(J - 1), where it is K/2 (J - 1)² whatever κ is. A continuous p holds J only in the
    mean over an element; a `pointwise` share κ (Pa, of the order of the shear modulus so that nothing locks) keeps it
    near 1 at every point. The mean Cauchy stress is p + κ (J - 1).
    """
    return p * (J - 1) - p * p / (2 * (bulk - pointwise)) + pointwise / 2 * (J - 1) ** 2
