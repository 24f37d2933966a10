"""Volume change: what a law of shape leaves open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.materials.base import Addable, Deformation, Value, check_positive

STEEPNESS = 30
"""m of `barrier`: its resistance is 10 times κ at J = 0.9 and 400 times at 0.8."""


def perturbed_lagrangian(J: CoefficientFunction, p: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """p (J - 1) - p²/2K, stationary in p at p = K (J - 1), for any bulk modulus K (Pa); p is the mean Cauchy stress."""
    return p * (J - 1) - p * p / (2 * bulk)


def perturbed_logarithm(J: CoefficientFunction, p: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """p ln J - p²/2K, stationary in p at p = K ln J, that of `squared_log`; p is the mean Kirchhoff stress, J times Cauchy's."""
    return p * ngs.log(J) - p * p / (2 * bulk)


def quadratic(J: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """K/2 (J - 1)², the `perturbed_lagrangian` without its p; finite for a body pressed to nothing."""
    return bulk / 2 * (J - 1) * (J - 1)


def logarithmic(J: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """K/4 (J² - 1 - 2 ln J), without bound at J → 0 and J → ∞ and convex between.

    Source (this and others): Doll & Schweizerhof 2000, 10.1115/1.321146.
    """
    return bulk / 4 * (J * J - 1 - 2 * ngs.log(J))


def squared_log(J: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """K/2 (ln J)², without bound at J → 0; softens beyond J = e."""
    log = ngs.log(J)
    return bulk / 2 * log * log


def mixed_form(
    change: Callable[[CoefficientFunction, Value], CoefficientFunction],
) -> Callable[[CoefficientFunction, CoefficientFunction, Value], CoefficientFunction]:
    """The energy of J and a pressure that is stationary in it where U(J) is: the same law in mixed form.

    >>> mixed_form(quadratic) is perturbed_lagrangian
    True
    """
    if change is quadratic:
        return perturbed_lagrangian
    if change is squared_log:
        return perturbed_logarithm
    raise InputError("Material.change", change, "quadratic or squared_log where there are pressures")


@dataclass(frozen=True)
class Compressible(Addable):
    """W = U(J): what a law of shape needs, added to it, for a body without pressure unknowns; bulk modulus K (Pa) at J = 1.

    change  U of J and K: `logarithmic`, `quadratic`, `squared_log` or one of your own

    >>> import ngsolve as ngs
    >>> from ngbrain.materials import Deformation, NeoHooke, density
    >>> density(NeoHooke(1000.0) + Compressible(50e3), Deformation.from_gradient(ngs.Id(3))).dim
    1
    """

    bulk: Value
    change: Callable[[CoefficientFunction, Value], CoefficientFunction] = logarithmic

    def __post_init__(self) -> None:
        check_positive(self.bulk, "Compressible.bulk")

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.change(at.J, self.bulk)

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa) of C with its change of volume."""
        return self.change(ngs.sqrt(ngs.Det(C)), self.bulk)


def barrier(J: CoefficientFunction, kappa: Value) -> CoefficientFunction:
    """κ/m² (cosh(m ln J) - 1), κ/2 (J - 1)² near J = 1 and steep beyond |J - 1| = 0.1.

    A continuous p holds J only in the mean over an element; this keeps single points from collapsing. With κ (Pa) a part
    of a shear modulus it neither locks nor adds to what a bulk modulus of a thousand carries.
    """
    power = ngs.exp(STEEPNESS * ngs.log(J))
    return kappa / (2 * STEEPNESS**2) * (power + 1 / power - 2)
