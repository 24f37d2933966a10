"""The complex shear modulus G*(ω) of harmonic work: stress amplitude over strain amplitude, time factor e^{+iωt}.

A modulus is called with ω (rad/s) and answers G* (Pa): the storage modulus G' is its real part, the loss modulus
G'' ≥ 0 its imaginary part. Numbers in give a complex number, an array of ω gives an array; parameters (or an ω) that
are Parameters, CoefficientFunctions or GridFunctions give a CoefficientFunction. `a + b` is both side by side.

>>> fluid_and_solid = KelvinVoigt(mu=2000.0, eta=1.0) + Springpot(kappa=500.0, exponent=0.3)
>>> bool(fluid_and_solid(300.0).imag > 0)
True
"""

from __future__ import annotations

import cmath
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.arguments import check_sequence
from ngbrain.errors import InputError
from ngbrain.materials.base import Law, Value, check_parameter, check_positive
from ngbrain.materials.points import initial_modulus
from ngbrain.materials.viscous import Viscous, viscous

Frequency: TypeAlias = float | np.ndarray | CoefficientFunction
"""Angular frequency ω (rad/s)."""
Complex: TypeAlias = complex | np.ndarray | CoefficientFunction


def modulus_from_stiffness(stiffness: np.ndarray | float, damping_ratio: np.ndarray | float) -> np.ndarray:
    """The complex shear modulus of maps of shear stiffness and damping ratio, as elastography publishes them (MRE134, say).

    Stiffness is μ = 2|G*|²/(G' + |G*|), ρ times the square of the speed of a plane shear wave, and damping ratio ξ = G''/2G', so
    that G' = μ (1 + √(1 + 4ξ²))/(2 (1 + 4ξ²)) and G'' = 2ξG'. `ngbrain.inverse.elastography.derived_maps.maps_from_shear` goes the
    other way.

    Parameters
    ----------
    stiffness : array_like
        μ in Pa, at least 0 or NaN.
    damping_ratio : array_like
        ξ, at least 0 or NaN.

    Returns
    -------
    numpy.ndarray
        G* in Pa, complex.

    Raises
    ------
    InputError
        A negative value.

    Examples
    --------
    >>> modulus_from_stiffness(2234.07, 0.2).round(-1)
    np.complex128(2000+800j)
    """
    found = []
    for name, value in (("stiffness", stiffness), ("damping_ratio", damping_ratio)):
        found.append(np.asarray(value, float))
        if np.any(found[-1] < 0):
            raise InputError(name, float(np.nanmin(found[-1])), "at least 0")
    mu, xi = found
    squared = 1 + 4 * xi**2
    return np.asarray(mu * (1 + np.sqrt(squared)) / (2 * squared) * (1 + 2j * xi))[()]


class Modulus(ABC):
    """G*(ω); a new one needs no more than `__call__`."""

    @abstractmethod
    def __call__(self, omega: Frequency) -> Complex:
        """G* (Pa) at ω (rad/s)."""

    def __add__(self, other: Modulus) -> Parallel:
        parts: list[Modulus] = []
        for modulus in (self, other):
            parts += modulus.parts if isinstance(modulus, Parallel) else (modulus,)
        return Parallel(tuple(parts))


@dataclass(frozen=True)
class Parallel(Modulus):
    """G* = Σ G*_i, made by `modulus + modulus`: all see the same strain."""

    parts: tuple[Modulus, ...]

    def __call__(self, omega: Frequency) -> Complex:
        """G* (Pa) at ω (rad/s)."""
        first, *rest = (part(omega) for part in self.parts)
        return sum(rest, first)


@dataclass(frozen=True)
class KelvinVoigt(Modulus):
    """G* = μ + iωη: a spring μ (Pa) and a dashpot η (Pa s) side by side.

    >>> KelvinVoigt(mu=2000.0, eta=2.0)(100.0)
    (2000+200j)
    """

    mu: Value
    eta: Value

    def __post_init__(self) -> None:
        check_positive(self.mu, "KelvinVoigt.mu")
        _not_negative(self.eta, "KelvinVoigt.eta")

    def __call__(self, omega: Frequency) -> Complex:
        """G* (Pa) at ω (rad/s)."""
        return self.mu + 1j * _checked(omega) * self.eta


@dataclass(frozen=True)
class MaxwellModulus(Modulus):
    """G* = μ iωτ/(1 + iωτ), τ = η/μ: a spring μ (Pa) and a dashpot η (Pa s) one behind the other.

    >>> MaxwellModulus(mu=1000.0, eta=10.0)(100.0)
    (500+500j)
    """

    mu: Value
    eta: Value

    def __post_init__(self) -> None:
        check_positive(self.mu, "Maxwell.mu")
        check_positive(self.eta, "Maxwell.eta")

    def __call__(self, omega: Frequency) -> Complex:
        """G* (Pa) at ω (rad/s)."""
        return _relaxing(self.mu, self.eta / self.mu, _checked(omega))


@dataclass(frozen=True)
class Zener(Modulus):
    """G* = μ_∞ + μ iωτ/(1 + iωτ), τ = η/μ: a spring beside a `MaxwellModulus` element, the standard linear solid.

    >>> Zener(mu_inf=500.0, mu=1000.0, eta=10.0)(100.0)
    (1000+500j)
    """

    mu_inf: Value
    mu: Value
    eta: Value

    def __post_init__(self) -> None:
        check_positive(self.mu_inf, "Zener.mu_inf")
        check_positive(self.mu, "Zener.mu")
        check_positive(self.eta, "Zener.eta")

    def __call__(self, omega: Frequency) -> Complex:
        """G* (Pa) at ω (rad/s)."""
        return self.mu_inf + _relaxing(self.mu, self.eta / self.mu, _checked(omega))


@dataclass(frozen=True)
class Springpot(Modulus):
    """G* = κ (iω)^a: between a spring (a = 0) and a dashpot (a = 1); loss tangent tan(πa/2) at every ω.

    kappa      κ > 0 (Pa s^a)
    exponent   a, 0 < a < 1

    Its relaxation function is κ t^(-a)/Γ(1 - a). Source: Koeller 1984, 10.1115/1.3167616.

    >>> G = Springpot(kappa=100.0, exponent=0.5)(400.0)
    >>> round(G.imag / G.real, 12)
    1.0
    """

    kappa: Value
    exponent: Value

    def __post_init__(self) -> None:
        check_positive(self.kappa, "Springpot.kappa")
        check_parameter(self.exponent, "Springpot.exponent", lambda a: 0 < a < 1, "a number between 0 and 1")

    def __call__(self, omega: Frequency) -> Complex:
        """G* (Pa) at ω (rad/s)."""
        angle = math.pi / 2 * self.exponent
        if isinstance(angle, CoefficientFunction):
            turn = ngs.cos(angle) + 1j * ngs.sin(angle)
        else:
            turn = cmath.exp(1j * angle)
        return self.kappa * turn * _power(_checked(omega), self.exponent)


@dataclass(frozen=True)
class PowerLaw(Modulus):
    """G* = (G'₀ + iG''₀) (ω/ω₀)^a, as fitted to elastography at several frequencies around ω₀.

    storage, loss   G'₀ > 0 and G''₀ ≥ 0 (Pa), at ω₀
    exponent        a ≥ 0
    reference       ω₀ > 0 (rad/s)

    It is a description of the frequencies measured. Only with G''₀/G'₀ = tan(πa/2), 0 < a < 1, do its parts obey the
    relations of Kramers and Kronig; then it is the `Springpot` of κ = |G*₀| ω₀^(-a). Any other has no relaxation
    function in time that is real and causal.

    >>> PowerLaw(storage=2000.0, loss=800.0, exponent=0.5, reference=300.0)(1200.0)
    (4000+1600j)
    """

    storage: Value
    loss: Value
    exponent: Value
    reference: Value

    def __post_init__(self) -> None:
        check_positive(self.storage, "PowerLaw.storage")
        _not_negative(self.loss, "PowerLaw.loss")
        _not_negative(self.exponent, "PowerLaw.exponent")
        check_positive(self.reference, "PowerLaw.reference")

    def __call__(self, omega: Frequency) -> Complex:
        """G* (Pa) at ω (rad/s)."""
        return (self.storage + 1j * self.loss) * _power(_checked(omega) / self.reference, self.exponent)


@dataclass(frozen=True)
class PronySeries(Modulus):
    """G* = μ (1 - Σ g_k + Σ g_k iωτ_k/(1 + iωτ_k)): the image of G(t) = μ (1 - Σ g_k + Σ g_k e^(-t/τ_k)).

    mu    instantaneous shear modulus (Pa)
    g     fractions of it that relax, each > 0, sum < 1
    tau   relaxation times (s)

    >>> PronySeries(mu=1500.0, g=[2 / 3], tau=[0.01])(100.0)
    (1000+500j)
    """

    mu: Value
    g: Sequence[Value]
    tau: Sequence[Value]

    def __post_init__(self) -> None:
        check_positive(self.mu, "PronySeries.mu")
        check_sequence("PronySeries.g", self.g, 0), check_sequence("PronySeries.tau", self.tau, 0)
        if len(self.g) != len(self.tau):
            raise InputError("PronySeries.tau", f"{len(self.tau)} values", f"as many as g has: {len(self.g)}")
        for g, tau in zip(self.g, self.tau, strict=True):
            check_positive(g, "PronySeries.g")
            check_positive(tau, "PronySeries.tau")
        numbers = [g for g in self.g if not isinstance(g, CoefficientFunction)]
        if not sum(numbers) < 1:
            raise InputError("PronySeries.g", list(numbers), "fractions that add up to less than 1")

    def __call__(self, omega: Frequency) -> Complex:
        """G* (Pa) at ω (rad/s)."""
        omega = _checked(omega)
        staying = self.mu * (1 - sum(self.g))
        relaxing = (_relaxing(self.mu * g, tau, omega) for g, tau in zip(self.g, self.tau, strict=True))
        return sum(relaxing, staying + 0j * omega)


def fourier(material: Viscous | Law) -> PronySeries:
    """The modulus of small harmonic strains of a material: every part's `initial_modulus` and time, from its energy.

    >>> from ngbrain.materials import NeoHooke, Prony
    >>> fourier(Prony(NeoHooke(1500.0), g=[2 / 3], tau=[0.01]))(100.0)
    (1000+500j)
    """
    material = viscous(material)
    moduli = [initial_modulus(branch.law) for branch in material.branches]
    total = sum(moduli, initial_modulus(material.equilibrium))
    return PronySeries(total, tuple(mu / total for mu in moduli), tuple(branch.tau for branch in material.branches))


@dataclass(frozen=True)
class ShearWave:
    """A plane shear wave e^{i(ωt - kz)} of angular frequency ω (rad/s) and wave number k (1/m), Im k ≤ 0."""

    omega: float | np.ndarray
    k: complex | np.ndarray

    @property
    def length(self) -> float | np.ndarray:
        """Wavelength 2π/Re k (m)."""
        return 2 * math.pi / np.real(self.k)

    @property
    def speed(self) -> float | np.ndarray:
        """Phase speed ω/Re k (m/s)."""
        return self.omega / np.real(self.k)

    @property
    def depth(self) -> float | np.ndarray:
        """Way (m) on which the amplitude falls to 1/e; infinite without loss."""
        with np.errstate(divide="ignore"):
            return 1 / np.abs(np.imag(self.k))


def shear_wave(G: complex | np.ndarray, rho: float, omega: float | np.ndarray) -> ShearWave:
    """The wave in a medium of modulus G* (Pa) and density ρ (kg/m³): k = ω √(ρ/G*).

    >>> wave = shear_wave(2000 + 800j, rho=1000.0, omega=2 * math.pi * 50)
    >>> round(1e3 * float(wave.length), 1), round(1e3 * float(wave.depth), 1)
    (29.9, 24.7)
    """
    check_positive(rho, "shear_wave.rho")
    if not np.all(np.imag(G) >= 0):
        raise InputError("shear_wave.G", G, "a modulus without gain: an imaginary part of at least 0")
    return ShearWave(omega, omega * np.sqrt(rho / np.asarray(G, complex)))


def _relaxing(mu: Value, tau: Value, omega: Frequency) -> Complex:
    x = 1j * omega * tau
    return mu * (x / (1 + x))


def _power(base: Frequency, exponent: Value) -> Frequency:
    if isinstance(base, CoefficientFunction) or isinstance(exponent, CoefficientFunction):
        return ngs.exp(exponent * _log(base))
    return base**exponent


def _log(value: float | CoefficientFunction) -> float | CoefficientFunction:
    return ngs.log(value) if isinstance(value, CoefficientFunction) else math.log(value)


def _checked(omega: Frequency) -> Frequency:
    if isinstance(omega, CoefficientFunction):
        return omega
    omega = np.asarray(omega, float) if np.ndim(omega) else float(omega)
    if not np.all((omega >= 0) & (omega < np.inf)):
        raise InputError("omega", omega, "an angular frequency of at least 0 rad/s")
    return omega


def _not_negative(value: Value, name: str) -> None:
    check_parameter(value, name, lambda number: number >= 0, "a number of at least 0")
