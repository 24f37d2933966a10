"""Constants of a tissue in finite viscoelasticity, as numbers that scenes and the catalogue hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.materials.base import Value
from ngbrain.materials.flow import Maxwell
from ngbrain.materials.isotropic import NeoHooke, Ogden
from ngbrain.materials.viscous import Viscous, step_factors


@dataclass(frozen=True)
class OgdenBranches:
    """Constants of a tissue in finite viscoelasticity: Ogden terms that stay, then a `Maxwell` branch of one for each η.

    `mu` (Pa), `alpha`: of all terms; `eta` (Pa s): of the last ones, τ_k = η_k/μ_k.
    """

    mu: tuple[float, ...]
    alpha: tuple[float, ...]
    eta: tuple[float, ...]

    @property
    def stay(self) -> int:
        """Number of terms that stay."""
        return len(self.mu) - len(self.eta)

    def law(self) -> Viscous:
        """The material, ready for a solver; Neo-Hooke for a term of exponent 2."""
        stay = self.stay
        terms = [NeoHooke(m) if a == 2 else Ogden(m, a) for m, a in zip(self.mu, self.alpha, strict=True)]
        law = terms[0] if stay == 1 else Ogden(self.mu[:stay], self.alpha[:stay])
        return Viscous(law, tuple(Maxwell(term, eta) for term, eta in zip(terms[stay:], self.eta, strict=True)))

    def after(self, dt: float) -> OgdenBranches:
        """The elastic tissue that one step of `dt` > 0 seconds from rest amounts to at small strain: β_k μ_k."""
        stay = self.stay
        shares = (step_factors(dt, np.array(e / m))[1] for m, e in zip(self.mu[stay:], self.eta, strict=True))
        relaxed = (float(beta) * m for beta, m in zip(shares, self.mu[stay:], strict=True))
        return OgdenBranches((*self.mu[:stay], *relaxed), self.alpha, ())

    def times(self, factor: Value) -> OgdenBranches:
        """Moduli and viscosities times a factor, a number or an ngsolve `Parameter`; relaxation keeps its times."""
        mu, eta = (tuple(factor * value for value in values) for values in (self.mu, self.eta))
        return OgdenBranches(mu, self.alpha, eta)

    @property
    def initial_modulus(self) -> float:
        """μ₀ = Σ μ (Pa), the shear modulus of an instantaneous small strain."""
        return sum(self.mu)
