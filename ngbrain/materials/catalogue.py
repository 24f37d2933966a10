"""Published constants of brain tissue, by name."""

from __future__ import annotations

from dataclasses import dataclass

from ngbrain.errors import InputError, nearest
from ngbrain.materials.isotropic import Ogden
from ngbrain.materials.viscous import Branch, Viscous


@dataclass(frozen=True)
class OgdenBranches:
    """Constants of a relaxing one-term Ogden tissue; moduli in Pa, viscosities in Pa s, τ_k = η_k/μ_k.

    `mu`, `alpha`: first the part that stays, then the branches; `eta`: the branches.
    """

    mu: tuple[float, ...]
    alpha: tuple[float, ...]
    eta: tuple[float, ...]
    source: str
    fitted_strain: float
    """Largest stretch change (|λ - 1|) of the data behind the constants."""

    def law(self) -> Viscous:
        """The material, ready for a solver."""
        branches = zip(self.mu[1:], self.alpha[1:], self.eta, strict=True)
        return Viscous(Ogden(self.mu[0], self.alpha[0]), tuple(Branch(Ogden(m, a), eta / m) for m, a, eta in branches))

    @property
    def initial_modulus(self) -> float:
        """μ₀ = Σ μ (Pa), the shear modulus of an instantaneous small strain."""
        return sum(self.mu)


# Region-wise parameter files (the *_med.prm) of human tissue, fitted to ±10 % strain; one convention with Ogden here.
_GRIFFITHS = "Griffiths, Jayamohan, Budday 2024, 10.1007/s10237-023-01806-2"
_BUDDAY_STRAIN = 0.10

CATALOGUE: dict[str, OgdenBranches] = {
    "griffiths2024:cortex": OgdenBranches(
        (420.0, 1400.0, 560.0), (-21.27, -14.66, -23.76), (3050.0, 289370.0), _GRIFFITHS, _BUDDAY_STRAIN
    ),
    "griffiths2024:white_matter": OgdenBranches(
        (160.0, 970.0, 250.0), (-25.66, -25.35, -29.22), (2190.0, 299790.0), _GRIFFITHS, _BUDDAY_STRAIN
    ),
    "griffiths2024:corpus_callosum": OgdenBranches(
        (40.0, 630.0, 160.0), (-28.41, -27.01, -30.8), (1620.0, 232530.0), _GRIFFITHS, _BUDDAY_STRAIN
    ),
    "griffiths2024:deep_grey": OgdenBranches(
        (170.0, 680.0, 270.0), (-21.52, -15.5, -22.76), (2270.0, 240170.0), _GRIFFITHS, _BUDDAY_STRAIN
    ),
}


def constants(name: str) -> OgdenBranches:
    """Published constants by name, for example "griffiths2024:cortex"; an unknown name raises `InputError`."""
    if name not in CATALOGUE:
        raise InputError("constants", repr(name), nearest(name, CATALOGUE))
    return CATALOGUE[name]
