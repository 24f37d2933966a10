"""Tissue laws: an energy density each; stress, tangent and sensitivities are derived from it."""

from ngbrain.materials.base import Deformation, Law, Scaled, Sum, density
from ngbrain.materials.catalogue import CATALOGUE, OgdenBranches, constants
from ngbrain.materials.flow import Flow, Maxwell
from ngbrain.materials.isotropic import Demiray, Gent, MooneyRivlin, NeoHooke, Ogden, Polynomial, Yeoh
from ngbrain.materials.viscous import Branch, Prony, Viscous, after, step_factors
from ngbrain.materials.volumetric import barrier, perturbed_lagrangian

__all__ = [
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
    "perturbed_lagrangian",
    "step_factors",
]
