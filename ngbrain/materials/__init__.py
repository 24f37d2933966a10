"""Tissue laws: an energy density each; stress, tangent and sensitivities are derived from it."""

from ngbrain.materials.base import Deformation, Law, Scaled, Sum, density
from ngbrain.materials.catalogue import CATALOGUE, OgdenBranches, constants
from ngbrain.materials.fibre import Fung, Guccione, HolzapfelGasserOgden
from ngbrain.materials.isotropic import Demiray, Gent, MooneyRivlin, NeoHooke, Ogden, Polynomial, Yeoh
from ngbrain.materials.linear import LinearElastic, SaintVenant, TransverselyIsotropic
from ngbrain.materials.viscous import Branch, Prony, RelaxingPolynomial, Viscous, after, step_factors
from ngbrain.materials.volumetric import (
    Compressible,
    barrier,
    logarithmic,
    perturbed_lagrangian,
    perturbed_logarithm,
    quadratic,
    squared_log,
)

__all__ = [
    "CATALOGUE",
    "Branch",
    "Compressible",
    "Deformation",
    "Demiray",
    "Fung",
    "Gent",
    "Guccione",
    "HolzapfelGasserOgden",
    "Law",
    "LinearElastic",
    "MooneyRivlin",
    "NeoHooke",
    "Ogden",
    "OgdenBranches",
    "Polynomial",
    "Prony",
    "RelaxingPolynomial",
    "SaintVenant",
    "Scaled",
    "Sum",
    "TransverselyIsotropic",
    "Viscous",
    "Yeoh",
    "after",
    "barrier",
    "constants",
    "density",
    "logarithmic",
    "perturbed_lagrangian",
    "perturbed_logarithm",
    "quadratic",
    "squared_log",
    "step_factors",
]
