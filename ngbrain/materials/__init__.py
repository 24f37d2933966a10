"""Tissue laws: an energy density each; stress, tangent and sensitivities are derived from it."""

from ngbrain.materials.base import Deformation, Law, Scaled, Sum, density
from ngbrain.materials.catalogue import BRAIN, CATALOGUE, OgdenBranches, constants, published
from ngbrain.materials.flow import Flow, Maxwell
from ngbrain.materials.isotropic import Demiray, Gent, MooneyRivlin, NeoHooke, Ogden, Polynomial, Yeoh
from ngbrain.materials.modulus import fourier
from ngbrain.materials.viscous import Branch, Prony, Viscous, after, step_factors
from ngbrain.materials.volumetric import barrier, perturbed_lagrangian

__all__ = [
    "BRAIN",
    "CATALOGUE",
    "Branch",
    "Deformation",
    "Demiray",
    "Flow",
    "Gent",
    "Law",
    "Maxwell",
    "MooneyRivlin",
    "NeoHooke",
    "Ogden",
    "OgdenBranches",
    "Polynomial",
    "Prony",
    "Scaled",
    "Sum",
    "Viscous",
    "Yeoh",
    "after",
    "barrier",
    "constants",
    "density",
    "fourier",
    "perturbed_lagrangian",
    "published",
    "step_factors",
]
