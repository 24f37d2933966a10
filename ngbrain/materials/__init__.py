"""Tissue laws: an energy density each; stress, tangent and sensitivities are derived from it."""

from ngbrain.materials.base import Deformation, Law, Scaled, Sum, density
from ngbrain.materials.catalogue import CATALOGUE, constants, find_published
from ngbrain.materials.families import RelaxingOgden, mix
from ngbrain.materials.fibre import Fung, Guccione, HolzapfelGasserOgden
from ngbrain.materials.flow import Flow, Flows, Maxwell
from ngbrain.materials.isotropic import Demiray, Gent, MooneyRivlin, NeoHooke, Ogden, Polynomial, UnsplitNeoHooke, Yeoh
from ngbrain.materials.linear import LinearElastic, SaintVenant, Shearing, TransverselyIsotropic
from ngbrain.materials.modulus import fourier
from ngbrain.materials.viscous import Branch, Prony, RelaxingPolynomial, Viscous, step_factors
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
    "Flow",
    "Flows",
    "Fung",
    "Gent",
    "Guccione",
    "HolzapfelGasserOgden",
    "Law",
    "LinearElastic",
    "Maxwell",
    "MooneyRivlin",
    "NeoHooke",
    "Ogden",
    "Polynomial",
    "Prony",
    "RelaxingOgden",
    "RelaxingPolynomial",
    "SaintVenant",
    "Scaled",
    "Shearing",
    "Sum",
    "TransverselyIsotropic",
    "UnsplitNeoHooke",
    "Viscous",
    "Yeoh",
    "barrier",
    "constants",
    "density",
    "find_published",
    "fourier",
    "logarithmic",
    "mix",
    "perturbed_lagrangian",
    "perturbed_logarithm",
    "quadratic",
    "squared_log",
    "step_factors",
]
