"""Quadratic laws: of the displacement gradient (small strain), or of Green's strain (small strain, any rotation).

The `energy` of the linear laws takes the strain ε itself, real or complex. It is written without complex
conjugates, so that a harmonic bilinear form made of it is complex-symmetric. Linear laws are not objective: a rigid
rotation by 10° has the energy of 3 % shear.
"""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.materials.base import Addable, Deformation, TotalStretchLaw, Value, check_parameter, check_positive
from ngbrain.materials.fibre import Fibre, structural


class SmallStrainLaw(Addable):
    """Base of laws of the small strain ε = sym F - 1."""

    def energy(self, strain: CoefficientFunction) -> CoefficientFunction:
        """Quadratic form (Pa) of a strain ε: 3×3, or 2×2 for plane strain."""
        raise NotImplementedError

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.energy((at.F + at.F.trans) / 2 - ngs.Id(3))


@dataclass(frozen=True, repr=False)
class LinearElastic(SmallStrainLaw):
    """Linear elasticity, W = μ ε:ε + λ/2 (tr ε)².

    Parameters
    ----------
    mu : float or CoefficientFunction
        Shear modulus μ (Pa).
    lam : float or CoefficientFunction, default 0.0
        Lamé's first parameter λ (Pa), above -2/3 μ. The bulk modulus is λ + 2μ/3; without λ it is 2μ/3, for use
        with a pressure.

    Raises
    ------
    InputError
        An inadmissible modulus.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> LinearElastic(mu=1000.0, lam=2000.0).energy(ngs.Id(3)).dim
    1
    """

    mu: Value
    lam: Value = 0.0

    def __post_init__(self) -> None:
        _elastic("LinearElastic", self.mu, self.lam)

    def energy(self, strain: CoefficientFunction) -> CoefficientFunction:
        """Quadratic form (Pa) of a strain ε: 3×3, or 2×2 for plane strain."""
        return _quadratic(strain, self.mu, self.lam)


@dataclass(frozen=True, repr=False)
class Shearing(SmallStrainLaw):
    """W = μ |dev ε|², dev ε = ε - (tr ε/3) 1: deviatoric part alone; μ in Pa, complex in harmonic problems (G* = G' + iG'').

    The volumetric part is left to a bulk modulus.

    >>> import ngsolve as ngs
    >>> Shearing(1000.0 + 200.0j).energy(ngs.Id(3)).dim
    1
    """

    mu: Value

    def __post_init__(self) -> None:
        check_positive(self.mu, "Shearing.mu", complex_too=True)

    def energy(self, strain: CoefficientFunction) -> CoefficientFunction:
        """Quadratic form (Pa) of a strain ε: 3×3, or 2×2 for plane strain."""
        volume = ngs.Trace(strain)
        return self.mu * (ngs.Trace(strain * strain) - 1 / 3 * volume * volume)


@dataclass(frozen=True, repr=False)
class SaintVenant(TotalStretchLaw):
    """Saint Venant-Kirchhoff law, W = μ E:E + λ/2 (tr E)², E = (C - 1)/2; for small strain at any rotation.

    Compressed to less than 1/√3 of its length, the material softens.

    Parameters
    ----------
    mu : float or CoefficientFunction
        Shear modulus μ₀ = μ (Pa).
    lam : float or CoefficientFunction, default 0.0
        Lamé's first parameter λ (Pa), above -2/3 μ; the bulk modulus is λ + 2μ/3.

    Raises
    ------
    InputError
        An inadmissible modulus.

    Examples
    --------
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


@dataclass(frozen=True, repr=False)
class TransverselyIsotropic(SmallStrainLaw):
    """Transversely isotropic law, W = μ |dev ε|² + 2φμ (|εa|² - (a·εa)²) + 2ζμ (a·dev ε a)², with a the unit vector
    along the fibre.

    The volumetric part is left to a bulk modulus.

    Parameters
    ----------
    mu : float or CoefficientFunction
        Shear modulus across the fibre, μ₂ (Pa).
    zeta : float or CoefficientFunction
        Tensile anisotropy E₁/E₂ - 1 without change of volume, above -3/4.
    phi : float or CoefficientFunction
        Shear anisotropy μ₁/μ₂ - 1, above -1; μ₁ is the shear modulus along the fibre.
    fibre : Fibre
        Fibre direction, of two components for 2×2 strains.

    Raises
    ------
    InputError
        An inadmissible parameter.

    References
    ----------
    Tweten, Okamoto, Schmidt, Garbow, Bayly 2015, 10.1016/j.jbiomech.2015.09.009.

    Examples
    --------
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
        """Quadratic form (Pa) of a strain ε: 3×3, or 2×2 for plane strain."""
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
