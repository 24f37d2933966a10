"""Rheological models of the complex shear modulus G*(ω) for harmonic problems: stress over strain, time factor e^{+iωt}.

A model is called with the angular frequency ω (rad/s) and returns G* (Pa): the storage modulus G' is the real part,
the loss modulus G'' ≥ 0 the imaginary part. Numbers give a complex number, an array of ω gives an array; parameters
(or an ω) that are Parameters, CoefficientFunctions or GridFunctions give a CoefficientFunction. `a + b` is the
parallel connection of two models.

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
from ngbrain.look import BriefText
from ngbrain.materials.base import Law, Value, check_parameter, check_positive
from ngbrain.materials.points import initial_modulus
from ngbrain.materials.viscous import Viscous, viscous

Frequency: TypeAlias = float | np.ndarray | CoefficientFunction
"""Angular frequency ω (rad/s)."""
Complex: TypeAlias = complex | np.ndarray | CoefficientFunction


def modulus_from_stiffness(stiffness: np.ndarray | float, damping_ratio: np.ndarray | float) -> np.ndarray:
    """Complex shear modulus from maps of shear stiffness and damping ratio, as published atlases such as MRE134 store them.

    Shear stiffness is μ = 2|G*|²/(G' + |G*|), ρ times the square of the speed of a plane shear wave, and the
    damping ratio is ξ = G''/2G', so that G' = μ (1 + √(1 + 4ξ²))/(2 (1 + 4ξ²)) and G'' = 2ξG'.
    `ngbrain.inverse.elastography.derived_maps.maps_from_shear` is the inverse.

    Parameters
    ----------
    stiffness : numpy.ndarray or float
        Shear stiffness μ (Pa), at least 0 or NaN.
    damping_ratio : numpy.ndarray or float
        Damping ratio ξ (dimensionless), at least 0 or NaN.

    Returns
    -------
    numpy.ndarray
        Complex shear modulus G* (Pa).

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
    """Base of models of G*(ω); a new one only defines `__call__`."""

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
    """Parallel connection, G* = Σ G*_i, made by `modulus + modulus`: all parts have the same strain."""

    parts: tuple[Modulus, ...]

    def __call__(self, omega: Frequency) -> Complex:
        """G* (Pa) at ω (rad/s)."""
        first, *rest = (part(omega) for part in self.parts)
        return sum(rest, first)


@dataclass(frozen=True)
class KelvinVoigt(Modulus):
    """Kelvin-Voigt model, G* = μ + iωη: a spring and a dashpot in parallel.

    Parameters
    ----------
    mu : float or CoefficientFunction
        Shear modulus of the spring (Pa), positive.
    eta : float or CoefficientFunction
        Viscosity of the dashpot (Pa s), at least 0.

    Examples
    --------
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
    """Maxwell model, G* = μ iωτ/(1 + iωτ), τ = η/μ: a spring and a dashpot in series.

    Parameters
    ----------
    mu : float or CoefficientFunction
        Shear modulus of the spring (Pa), positive.
    eta : float or CoefficientFunction
        Viscosity of the dashpot (Pa s), positive.

    Examples
    --------
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
    """Standard linear solid, G* = μ_∞ + μ iωτ/(1 + iωτ), τ = η/μ: a spring in parallel with a Maxwell element.

    Parameters
    ----------
    mu_inf : float or CoefficientFunction
        Equilibrium shear modulus (Pa), positive.
    mu : float or CoefficientFunction
        Shear modulus of the Maxwell element (Pa), positive.
    eta : float or CoefficientFunction
        Viscosity of the Maxwell element (Pa s), positive.

    Examples
    --------
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
    """Springpot, G* = κ (iω)^a: between a spring (a = 0) and a dashpot (a = 1); the loss tangent is tan(πa/2) at every ω.

    The relaxation function is κ t^(-a)/Γ(1 - a).

    Parameters
    ----------
    kappa : float or CoefficientFunction
        Coefficient κ (Pa s^a), positive.
    exponent : float or CoefficientFunction
        Exponent a, between 0 and 1.

    References
    ----------
    Koeller 1984, 10.1115/1.3167616.

    Examples
    --------
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
    """Power law G* = (G'₀ + iG''₀) (ω/ω₀)^a, as fitted to elastography at several frequencies around ω₀.

    It describes only the measured frequencies. Storage and loss modulus obey the Kramers-Kronig relations only if
    G''₀/G'₀ = tan(πa/2), 0 < a < 1; the model is then the `Springpot` of κ = |G*₀| ω₀^(-a). Any other has no real
    and causal relaxation function.

    Parameters
    ----------
    storage : float or CoefficientFunction
        Storage modulus G'₀ (Pa) at ω₀, positive.
    loss : float or CoefficientFunction
        Loss modulus G''₀ (Pa) at ω₀, at least 0.
    exponent : float or CoefficientFunction
        Exponent a, at least 0.
    reference : float or CoefficientFunction
        Reference frequency ω₀ (rad/s), positive.

    Examples
    --------
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


@dataclass(frozen=True, repr=False)
class PronySeries(BriefText, Modulus):
    """Prony series G* = μ (1 - Σ g_k + Σ g_k iωτ_k/(1 + iωτ_k)).

    It is the transform of the relaxation modulus G(t) = μ (1 - Σ g_k + Σ g_k e^(-t/τ_k)).

    Parameters
    ----------
    mu : float or CoefficientFunction
        Instantaneous shear modulus (Pa), positive.
    g : sequence of float or CoefficientFunction
        Relaxing fractions of it, each positive, with a sum below 1.
    tau : sequence of float or CoefficientFunction
        Relaxation times (s), positive.

    Raises
    ------
    InputError
        An inadmissible value, or different numbers of fractions and times.

    Examples
    --------
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
    """Complex modulus of a viscoelastic material at small strain: initial moduli and relaxation times of all branches.

    >>> from ngbrain.materials import NeoHooke, Prony
    >>> fourier(Prony(NeoHooke(1500.0), g=[2 / 3], tau=[0.01]))(100.0)
    (1000+500j)
    """
    material = viscous(material)
    moduli = [initial_modulus(branch.law) for branch in material.branches]
    total = sum(moduli, initial_modulus(material.equilibrium))
    return PronySeries(total, tuple(mu / total for mu in moduli), tuple(branch.tau for branch in material.branches))


@dataclass(frozen=True, repr=False)
class ShearWave(BriefText):
    """Plane shear wave e^{i(ωt - kz)}.

    Parameters
    ----------
    omega : float or numpy.ndarray
        Angular frequency ω (rad/s).
    k : complex or numpy.ndarray
        Wave number (1/m), Im k ≤ 0.
    """

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
        """Penetration depth (m), over which the amplitude falls to 1/e; infinite without loss."""
        with np.errstate(divide="ignore"):
            return 1 / np.abs(np.imag(self.k))


def shear_wave(G: complex | np.ndarray, rho: float, omega: float | np.ndarray) -> ShearWave:
    """Plane shear wave in a homogeneous medium, k = ω √(ρ/G*).

    Parameters
    ----------
    G : complex or numpy.ndarray
        Complex shear modulus G* (Pa), with an imaginary part of at least 0.
    rho : float
        Density ρ (kg/m³).
    omega : float or numpy.ndarray
        Angular frequency ω (rad/s).

    Returns
    -------
    ShearWave
        The wave.

    Raises
    ------
    InputError
        A negative loss modulus, or a density that is not positive.

    Examples
    --------
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
