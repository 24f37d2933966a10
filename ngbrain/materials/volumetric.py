"""Volumetric energies U(J), which complete isochoric laws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.materials.base import Addable, Deformation, Value, check_positive

STEEPNESS = 30
"""Exponent m of `barrier`: its stiffness is 10 times κ at J = 0.9 and 400 times at 0.8."""


def perturbed_lagrangian(J: CoefficientFunction, p: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """Mixed volumetric energy p (J - 1) - p²/2K, stationary in p at p = K (J - 1).

    Parameters
    ----------
    J : CoefficientFunction
        Volume ratio.
    p : CoefficientFunction
        Pressure unknown (Pa): the mean Cauchy stress.
    bulk : float or CoefficientFunction
        Bulk modulus K (Pa), of any size.

    Returns
    -------
    CoefficientFunction
        Energy density (Pa).
    """
    return p * (J - 1) - p * p / (2 * bulk)


def perturbed_logarithm(J: CoefficientFunction, p: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """Mixed volumetric energy p ln J - p²/2K, stationary in p at p = K ln J, that of `squared_log`.

    Parameters
    ----------
    J : CoefficientFunction
        Volume ratio.
    p : CoefficientFunction
        Pressure unknown (Pa): the mean Kirchhoff stress, J times the Cauchy stress.
    bulk : float or CoefficientFunction
        Bulk modulus K (Pa), of any size.

    Returns
    -------
    CoefficientFunction
        Energy density (Pa).
    """
    return p * ngs.log(J) - p * p / (2 * bulk)


def quadratic(J: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """Volumetric energy K/2 (J - 1)², that of `perturbed_lagrangian`; finite at J = 0.

    Parameters
    ----------
    J : CoefficientFunction
        Volume ratio.
    bulk : float or CoefficientFunction
        Bulk modulus K (Pa).

    Returns
    -------
    CoefficientFunction
        Energy density (Pa).
    """
    return bulk / 2 * (J - 1) * (J - 1)


def logarithmic(J: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """Volumetric energy K/4 (J² - 1 - 2 ln J), unbounded for J → 0 and J → ∞ and convex.

    Parameters
    ----------
    J : CoefficientFunction
        Volume ratio.
    bulk : float or CoefficientFunction
        Bulk modulus K (Pa).

    Returns
    -------
    CoefficientFunction
        Energy density (Pa).

    References
    ----------
    This and other volumetric energies: Doll & Schweizerhof 2000, 10.1115/1.321146.
    """
    return bulk / 4 * (J * J - 1 - 2 * ngs.log(J))


def squared_log(J: CoefficientFunction, bulk: Value) -> CoefficientFunction:
    """Volumetric energy K/2 (ln J)², unbounded for J → 0; it softens beyond J = e.

    Parameters
    ----------
    J : CoefficientFunction
        Volume ratio.
    bulk : float or CoefficientFunction
        Bulk modulus K (Pa).

    Returns
    -------
    CoefficientFunction
        Energy density (Pa).
    """
    log = ngs.log(J)
    return bulk / 2 * log * log


def mixed_form(
    change: Callable[[CoefficientFunction, Value], CoefficientFunction],
) -> Callable[[CoefficientFunction, CoefficientFunction, Value], CoefficientFunction]:
    """Energy of J and a pressure, stationary in the pressure where U(J) is: the same volumetric law in mixed form.

    >>> mixed_form(quadratic) is perturbed_lagrangian
    True
    """
    if change is quadratic:
        return perturbed_lagrangian
    if change is squared_log:
        return perturbed_logarithm
    raise InputError("Material.change", change, "quadratic or squared_log where there are pressures")


@dataclass(frozen=True, repr=False)
class Compressible(Addable):
    """Volumetric energy as a law, W = U(J), to be added to an isochoric law of a body without pressure unknowns.

    Parameters
    ----------
    bulk : float or CoefficientFunction
        Bulk modulus K (Pa) at J = 1, positive.
    change : callable, default logarithmic
        U of J and K: `logarithmic`, `quadratic`, `squared_log` or a user-defined function.

    Examples
    --------
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
        """Energy density (Pa) of the total C."""
        return self.change(ngs.sqrt(ngs.Det(C)), self.bulk)


def barrier(J: CoefficientFunction, kappa: Value) -> CoefficientFunction:
    """Barrier against collapse, κ/m² (cosh(m ln J) - 1): κ/2 (J - 1)² near J = 1 and steep beyond |J - 1| = 0.1.

    A continuous pressure controls J only in the mean over an element; the barrier keeps single points from
    collapsing. With κ a fraction of the shear modulus it neither locks nor adds noticeably to a bulk modulus of a
    thousand times that.

    Parameters
    ----------
    J : CoefficientFunction
        Volume ratio.
    kappa : float or CoefficientFunction
        Stiffness κ (Pa), a fraction of a shear modulus.

    Returns
    -------
    CoefficientFunction
        Energy density (Pa).
    """
    power = ngs.exp(STEEPNESS * ngs.log(J))
    return kappa / (2 * STEEPNESS**2) * (power + 1 / power - 2)
