"""Isotropic laws: each is an energy density of C and states its initial shear modulus μ₀."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.materials.base import Addable, Composite, Deformation, Value, check_parameter, check_positive
from ngbrain.tensors import principal_values


@dataclass(frozen=True, repr=False)
class NeoHooke(Addable):
    """W = μ/2 (tr C - 3), initial shear modulus μ₀ = μ (Pa).

    >>> import ngsolve as ngs
    >>> NeoHooke(mu=1000.0).energy(4 * ngs.Id(3)).dim
    1
    """

    mu: Value

    def __post_init__(self) -> None:
        check_positive(self.mu, "NeoHooke.mu")

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.mu / 2 * (ngs.Trace(C) - 3)


@dataclass(frozen=True, repr=False)
class UnsplitNeoHooke(Composite):
    """W = μ/2 (tr C - 3 - 2 ln J) of the total C, initial shear modulus μ₀ = μ (Pa); to be added to a volumetric energy.

    This is what textbooks and benchmarks (Cook's membrane) call compressible Neo-Hooke. `NeoHooke` is a law of C̄
    and does not contribute to a change of volume; this one does, with a bulk modulus of 2/3 μ at small strain.

    References
    ----------
    Simo & Pister 1984, 10.1016/0045-7825(84)90062-8.

    >>> import ngsolve as ngs
    >>> UnsplitNeoHooke(mu=1000.0).energy(4 * ngs.Id(3)).dim
    1
    """

    mu: Value

    def __post_init__(self) -> None:
        check_positive(self.mu, "UnsplitNeoHooke.mu")

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.mu / 2 * (ngs.Trace(at.C) - 3 - 2 * ngs.log(at.J))


@dataclass(frozen=True, repr=False)
class MooneyRivlin(Addable):
    """W = c₁₀ (I₁ - 3) + c₀₁ (I₂ - 3), initial shear modulus μ₀ = 2 (c₁₀ + c₀₁) (Pa); I₂ = (I₁² - tr C²)/2.

    Parameters
    ----------
    c10, c01 : float or CoefficientFunction
        Coefficients (Pa) of the first and the second invariant; their sum is positive.

    Raises
    ------
    InputError
        The sum of the coefficients is not positive.

    References
    ----------
    Rivlin 1948, 10.1098/rsta.1948.0024.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> MooneyRivlin(c10=300.0, c01=200.0).energy(4 * ngs.Id(3)).dim
    1
    """

    c10: Value
    c01: Value

    def __post_init__(self) -> None:
        _stiff("MooneyRivlin", "c10 + c01", self.c10, self.c01)

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        i1, i2 = _invariants(C)
        return self.c10 * (i1 - 3) + self.c01 * (i2 - 3)


@dataclass(frozen=True, repr=False)
class Polynomial(Addable):
    """W = Σ c_ij (I₁ - 3)^i (I₂ - 3)^j, initial shear modulus μ₀ = 2 (c₁₀ + c₀₁) (Pa).

    Parameters
    ----------
    c : dict of tuple of (int, int) to float or CoefficientFunction
        (i, j) → c_ij (Pa), whole numbers i, j ≥ 0, not both 0. Without (1, 0) and (0, 1) it is a term of a sum,
        without initial stiffness.

    Raises
    ------
    InputError
        Inadmissible powers, no coefficient, or an initial modulus that is not positive.

    References
    ----------
    Rivlin & Saunders 1951, 10.1098/rsta.1951.0004.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> Polynomial({(1, 0): 300.0, (0, 1): 200.0, (1, 1): 50.0}).energy(ngs.Id(3)).dim
    1
    """

    c: Mapping[tuple[int, int], Value]

    def __post_init__(self) -> None:
        for power in self.c:
            if len(power) != 2 or not all(isinstance(n, int) and n >= 0 for n in power) or not any(power):
                raise InputError("Polynomial.c", f"the powers {power}", "two whole numbers of at least 0, not both 0")
        if not self.c:
            raise InputError("Polynomial.c", "empty", "a coefficient or more")
        for power, value in self.c.items():
            check_parameter(value, f"Polynomial.c[{power[0]}, {power[1]}]", lambda _: True, "a finite number")
        if first := [self.c[power] for power in ((1, 0), (0, 1)) if power in self.c]:
            _stiff("Polynomial", "c[1, 0] + c[0, 1]", *first)

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        i1, i2 = _invariants(C)
        terms = [value * _power(i1 - 3, i) * _power(i2 - 3, j) for (i, j), value in self.c.items()]
        return sum(terms[1:], terms[0])


def Yeoh(c1: Value, c2: Value = 0.0, c3: Value = 0.0) -> Polynomial:  # noqa: N802  (reads as a law)
    """W = c₁ (I₁ - 3) + c₂ (I₁ - 3)² + c₃ (I₁ - 3)³, initial shear modulus μ₀ = 2 c₁ (Pa).

    Parameters
    ----------
    c1, c2, c3 : float or CoefficientFunction
        Coefficients (Pa); `c1` is positive.

    Returns
    -------
    Polynomial
        The law as a polynomial.

    References
    ----------
    Yeoh 1993, 10.5254/1.3538343.

    Examples
    --------
    >>> Yeoh(100.0, 20.0) == Polynomial({(1, 0): 100.0, (2, 0): 20.0})
    True
    """
    given = {(i, 0): c for i, c in enumerate((c1, c2, c3), 1) if i == 1 or not (isinstance(c, float | int) and c == 0)}
    return Polynomial(given)


@dataclass(frozen=True, repr=False)
class Gent(Addable):
    """W = -μ J_m/2 ln(1 - (I₁ - 3)/J_m), initial shear modulus μ₀ = μ (Pa); undefined beyond I₁ - 3 = J_m.

    Beyond this locking limit energy and stress are NaN, which Newton's method rejects like an inverted element.

    Parameters
    ----------
    mu : float or CoefficientFunction
        Shear modulus (Pa), positive.
    jm : float or CoefficientFunction
        Locking limit J_m of I₁ - 3, positive.

    References
    ----------
    Gent 1996, 10.5254/1.3538357.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> Gent(mu=1000.0, jm=2.0).energy(ngs.Id(3)).dim
    1
    """

    mu: Value
    jm: Value

    def __post_init__(self) -> None:
        check_positive(self.mu, "Gent.mu")
        check_positive(self.jm, "Gent.jm")

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        # The root makes stresses NaN where the energy is; those of the logarithm alone are finite there, of the wrong sign.
        return -self.mu * self.jm * ngs.log(ngs.sqrt(1 - (ngs.Trace(C) - 3) / self.jm))


@dataclass(frozen=True, repr=False)
class Demiray(Addable):
    """W = μ/(2b) (exp(b (I₁ - 3)) - 1), initial shear modulus μ₀ = μ (Pa).

    Parameters
    ----------
    mu : float or CoefficientFunction
        Shear modulus (Pa), positive.
    b : float or CoefficientFunction
        Exponential stiffening (dimensionless), positive.

    References
    ----------
    Demiray 1972, 10.1016/0021-9290(72)90047-4.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> Demiray(mu=1000.0, b=5.0).energy(ngs.Id(3)).dim
    1
    """

    mu: Value
    b: Value

    def __post_init__(self) -> None:
        check_positive(self.mu, "Demiray.mu")
        check_positive(self.b, "Demiray.b")

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.mu / (2 * self.b) * (ngs.exp(self.b * (ngs.Trace(C) - 3)) - 1)


@dataclass(frozen=True, repr=False)
class Ogden(Addable):
    """W = Σ 2μ_i/α_i² (λ₁^α_i + λ₂^α_i + λ₃^α_i - 3), initial shear modulus μ₀ = Σ μ_i (Pa); λ² are the eigenvalues of C.

    This is the convention of Budday 2017 and Miller & Chinzei 2002; others use μ/α or c/α². Stress and tangent are
    accurate to 1e-10 at equal stretches too.

    Parameters
    ----------
    mu : float or CoefficientFunction or sequence of float or CoefficientFunction
        Shear modulus (Pa) of each term, positive.
    alpha : float or CoefficientFunction or sequence of float or CoefficientFunction
        Exponent of each term, any real number but 0.

    Raises
    ------
    InputError
        The numbers of moduli and exponents differ, or a value is inadmissible.

    References
    ----------
    Ogden 1972, 10.1098/rspa.1972.0026; constants of brain tissue: 10.1016/j.actbio.2016.10.036.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> Ogden(mu=[1000.0, 200.0], alpha=[-20.0, 2.0]).energy(ngs.Id(3)).dim
    1
    """

    mu: Value | Sequence[Value]
    alpha: Value | Sequence[Value]

    def __post_init__(self) -> None:
        mu, alpha = _terms(self.mu), _terms(self.alpha)
        if len(mu) != len(alpha):
            raise InputError("Ogden.alpha", f"{len(alpha)} values", f"as many as mu has: {len(mu)}")
        for m, a in zip(mu, alpha, strict=True):
            check_positive(m, "Ogden.mu")
            check_parameter(a, "Ogden.alpha", lambda exponent: exponent != 0, "a number other than 0")

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.log_strain_energy(_principal_logs(C))

    def log_strain_energy(self, logs: Sequence[CoefficientFunction]) -> CoefficientFunction:
        """Energy density (Pa) of the three ln λ_i."""
        terms = [
            2 * m / a**2 * (ngs.exp(a * logs[0]) + ngs.exp(a * logs[1]) + ngs.exp(a * logs[2]) - 3)
            for m, a in zip(_terms(self.mu), _terms(self.alpha), strict=True)
        ]
        return sum(terms[1:], terms[0])


@lru_cache(maxsize=1)
def _principal_logs(C: CoefficientFunction) -> list[CoefficientFunction]:
    # Laws of one C share one expression, which a compiled energy then evaluates once instead of once for each law.
    return [ngs.log(value) / 2 for value in principal_values(C)]


def _invariants(C: CoefficientFunction) -> tuple[CoefficientFunction, CoefficientFunction]:
    """I₁ = tr C and I₂ = (I₁² - tr C²)/2."""
    i1 = ngs.Trace(C)
    return i1, (i1 * i1 - ngs.InnerProduct(C, C)) / 2


def _power(base: CoefficientFunction, exponent: int) -> CoefficientFunction:
    # By products: NGSolve's power has no derivative where its base is 0, as at rest.
    product: CoefficientFunction = ngs.CF(1.0)
    for _ in range(exponent):
        product = product * base
    return product


def _stiff(law: str, name: str, *parts: Value) -> None:
    """Raise `InputError` if coefficients that are numbers give no initial stiffness."""
    for part in parts:
        check_parameter(part, f"{law}.{name}", lambda _: True, "finite numbers")
    if not any(isinstance(part, CoefficientFunction) for part in parts):
        check_positive(sum(parts), f"{law}.{name}")


def _terms(value: Value | Sequence[Value]) -> list[Value]:
    if isinstance(value, np.ndarray):
        return list(value) if value.ndim else [value.item()]
    return list(value) if isinstance(value, list | tuple) else [value]
