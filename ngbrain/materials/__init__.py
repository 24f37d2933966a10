"""Material laws: an energy density each, from which stress, tangent and sensitivities are derived.

- `base`: interface of a law, sums and multiples of laws
- `isotropic`, `fibre`, `linear`: elastic laws
- `volumetric`: volumetric energies
- `viscous`, `maxwell`: hereditary and finite viscoelasticity
- `modulus`: complex shear modulus of harmonic problems
- `families`: scaling, merging and mixing of laws
- `catalogue`: published constants
- `registry`, `named`, `admission`: laws by name, and checks of user-defined laws
- `points`: evaluation at many points
- `lab`: homogeneous tests, fits and plots
"""

from ngbrain.materials.base import Deformation, Law, Scaled, Sum, density
from ngbrain.materials.catalogue import CATALOGUE, constants, find_entry
from ngbrain.materials.families import RelaxingOgden, mix
from ngbrain.materials.fibre import Fung, Guccione, HolzapfelGasserOgden
from ngbrain.materials.isotropic import Demiray, Gent, MooneyRivlin, NeoHooke, Ogden, Polynomial, UnsplitNeoHooke, Yeoh
from ngbrain.materials.linear import LinearElastic, SaintVenant, Shearing, TransverselyIsotropic
from ngbrain.materials.maxwell import Maxwell, MaxwellTerm, MaxwellVariables
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
    "Fung",
    "Gent",
    "Guccione",
    "HolzapfelGasserOgden",
    "Law",
    "LinearElastic",
    "Maxwell",
    "MaxwellTerm",
    "MaxwellVariables",
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
    "find_entry",
    "fourier",
    "logarithmic",
    "mix",
    "perturbed_lagrangian",
    "perturbed_logarithm",
    "quadratic",
    "squared_log",
    "step_factors",
]
