"""Quadratic laws: of the displacement gradient for small strain, of Green's strain for small strain at any rotation.

The linear ones' `energy` takes the strain ε itself, real or complex: written without conjugates, so that a harmonic form
made of it is complex-symmetric. They know no rotation: turned as a whole by 10°, a body has the energy of 3 % shear.
"""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.materials.base import Addable, Deformation, TotalStretchLaw, Value, check_parameter, check_positive
from ngbrain.materials.fibre import Fibre, structural


class SmallStrainLaw(Addable):
    """A law of ε = sym F - 1."""

    def energy(self, strain: CoefficientFunction) -> CoefficientFunction:
        """The quadratic form (Pa) of a strain ε: 3×3, or 2×2 for plane strain."""
        raise NotImplementedError

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.energy((at.F + at.F.trans) / 2 - ngs.Id(3))


@dataclass(frozen=True)
class LinearElastic(SmallStrainLaw):
    """W = μ ε:ε + λ/2 (tr ε)²; shear modulus μ (Pa), bulk modulus λ + 2μ/3 (2μ/3 without λ: for use with a pressure).

    >>> import ngsolve as ngs
    >>> LinearElastic(mu=1000.0, lam=2000.0).energy(ngs.Id(3)).dim
    1
    """

    mu: Value
    lam: Value = 0.0

    def __post_init__(self) -> None:
        _elastic("LinearElastic", self.mu, self.lam)

    def energy(self, strain: CoefficientFunction) -> CoefficientFunction:
        """The quadratic form (Pa) of a strain ε: 3×3, or 2×2 for plane strain."""
        return _quadratic(strain, self.mu, self.lam)


@dataclass(frozen=True)
class Shearing(SmallStrainLaw):
    """W = μ |dev ε|², dev ε = ε - (tr ε/3) 1: shear alone, μ in Pa and complex for harmonic work (G* = G' + iG'').

    Change of volume is left to a bulk modulus.

    >>> import ngsolve as ngs
    >>> Shearing(1000.0 + 200.0j).energy(ngs.Id(3)).dim
    1
    """

    mu: Value

    def __post_init__(self) -> None:
        check_positive(self.mu, "Shearing.mu", complex_too=True)

    def energy(self, strain: CoefficientFunction) -> CoefficientFunction:
        """The quadratic form (Pa) of a strain ε: 3×3, or 2×2 for plane strain."""
        volume = ngs.Trace(strain)
        return self.mu * (ngs.Trace(strain * strain) - 1 / 3 * volume * volume)


@dataclass(frozen=True)
class SaintVenant(TotalStretchLaw):
    """W = μ E:E + λ/2 (tr E)², E = (C - 1)/2; initial shear modulus μ₀ = μ (Pa), bulk modulus λ + 2μ/3 as in linear theory.

    For small strain at any rotation: pressed to less than 1/√3 of its length it resists ever less.

    >>> import ngsolve as ngs
    >>> SaintVenant(mu=1000.0, lam=2000.0).energy(ngs.Id(3)).dim
    1
    """

    mu: Value
    lam: Value = 0.0

    def __post_init__(self) -> None:
        _elastic("SaintVenant", self.mu, self.lam)

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        return _quadratic((C - ngs.Id(3)) / 2, self.mu, self.lam)


@dataclass(frozen=True)
class TransverselyIsotropic(SmallStrainLaw):
    """W = μ |dev ε|² + 2φμ (|εa|² - (a·εa)²) + 2ζμ (a·dev ε a)², with a the unit vector along the fibre.

    mu     shear modulus across the fibre, μ₂ (Pa)
    zeta   E₁/E₂ - 1 without change of volume, above -3/4
    phi    μ₁/μ₂ - 1, above -1; μ₁ is the shear modulus along the fibre
    fibre  a direction, in 2×2 use one of two components

    Change of volume is left to a bulk modulus.

    Source: Tweten, Okamoto, Schmidt, Garbow, Bayly 2015, 10.1016/j.jbiomech.2015.09.009.

    >>> import ngsolve as ngs
    >>> TransverselyIsotropic(mu=1000.0, zeta=1.0, phi=0.5, fibre=(1, 0, 0)).energy(ngs.Id(3)).dim
    1
    """

    mu: Value
    zeta: Value
    phi: Value
    fibre: Fibre

    def __post_init__(self) -> None:
        check_positive(self.mu, "TransverselyIsotropic.mu", complex_too=True)
        check_parameter(
            self.zeta, "TransverselyIsotropic.zeta", lambda z: z > -0.75, "a number above -3/4", complex_too=True
        )
        check_parameter(self.phi, "TransverselyIsotropic.phi", lambda p: p > -1, "a number above -1", complex_too=True)
        self._structural()

    def _structural(self) -> CoefficientFunction:
        return structural(self.fibre, "TransverselyIsotropic.fibre", (2, 3))

    def energy(self, strain: CoefficientFunction) -> CoefficientFunction:
        """The quadratic form (Pa) of a strain ε: 3×3, or 2×2 for plane strain."""
        M = self._structural()
        if M.dims[0] != strain.dims[0]:
            found, wanted = f"a direction of {M.dims[0]} components", f"{strain.dims[0]} of them, as the strain has"
            raise InputError("TransverselyIsotropic.fibre", found, wanted)
        squared = strain * strain
        third, along = ngs.Trace(strain) / 3, ngs.Trace(M * strain)
        sheared, stretched = ngs.Trace(M * squared) - along * along, along - third
        shape = ngs.Trace(squared) - 3 * third * third
        return self.mu * (shape + 2 * self.phi * sheared + 2 * self.zeta * stretched * stretched)


def _quadratic(strain: CoefficientFunction, mu: Value, lam: Value) -> CoefficientFunction:
    volume = ngs.Trace(strain)
    return mu * ngs.Trace(strain * strain) + lam / 2 * volume * volume


def _elastic(law: str, mu: Value, lam: Value) -> None:
    check_positive(mu, f"{law}.mu", complex_too=True)
    if not isinstance(mu, CoefficientFunction):
        least = -2 / 3 * mu.real
        check_parameter(
            lam, f"{law}.lam", lambda value: value > least, f"a number above -2/3 mu, {least:.6g}", complex_too=True
        )
