"""Isotropic laws. Each is an energy of C; each states its initial shear modulus μ₀."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.materials.base import Addable, Value, positive
from ngbrain.tensors import principal_values


@dataclass(frozen=True)
class NeoHooke(Addable):
    """W = μ/2 (tr C - 3), initial shear modulus μ₀ = μ (Pa).

    >>> import ngsolve as ngs
    >>> NeoHooke(mu=1000.0).energy(4 * ngs.Id(3)).dim
    1
    """

    mu: Value

    def __post_init__(self) -> None:
        positive(self.mu, "NeoHooke.mu")

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.mu / 2 * (ngs.Trace(C) - 3)


@dataclass(frozen=True)
class Ogden(Addable):
    """W = Σ 2μ_i/α_i² (λ₁^α_i + λ₂^α_i + λ₃^α_i - 3), initial shear modulus μ₀ = Σ μ_i (Pa); λ² are the eigenvalues of C.

    The convention of Budday 2017 and Miller & Chinzei 2002 (others use μ/α or c/α²). μ and α are one value or a list
    each, any real α but 0. Stress and tangent are good to 1e-10 at equal stretches too.

    Source: Ogden 1972, 10.1098/rspa.1972.0026; brain constants: 10.1016/j.actbio.2016.10.036.

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
            positive(m, "Ogden.mu")
            if isinstance(a, (int, float)) and a == 0:
                raise InputError("Ogden.alpha", a, "a number other than 0")

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        logs = _principal_logs(C)
        terms = [
            2 * m / a**2 * (ngs.exp(a * logs[0]) + ngs.exp(a * logs[1]) + ngs.exp(a * logs[2]) - 3)
            for m, a in zip(_terms(self.mu), _terms(self.alpha), strict=True)
        ]
        return sum(terms[1:], terms[0])


@lru_cache(maxsize=1)
def _principal_logs(C: CoefficientFunction) -> list[CoefficientFunction]:
    # Laws of one C share one expression, which a compiled energy then evaluates once instead of once for each law.
    return [ngs.log(value) / 2 for value in principal_values(C)]


def _terms(value: Value | Sequence[Value]) -> list[Value]:
    return list(value) if isinstance(value, (list, tuple)) else [value]
