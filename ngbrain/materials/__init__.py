"""Material laws: an energy density each, from which stress, tangent and sensitivities are derived.

- elastic: `NeoHooke`, `UnsplitNeoHooke`, `MooneyRivlin`, `Polynomial`, `Yeoh`, `Gent`, `Demiray`, `Ogden`
- with fibres: `HolzapfelGasserOgden`, `Fung`, `Guccione`
- linear: `LinearElastic`, `SaintVenant`, `Shearing`, `TransverselyIsotropic`; their base `SmallStrainLaw`
- viscoelastic: `Viscous` with a `Branch` each, `Prony`, `RelaxingOgden`, `RelaxingPolynomial`, `step_factors`; `Maxwell` branches
  of finite strain, at points `MaxwellTerm` and `MaxwellVariables`
- volumetric: `Compressible`, `quadratic`, `logarithmic`, `squared_log`, `perturbed_lagrangian`, `perturbed_logarithm`, `barrier`
- complex shear moduli of waves: `shear_wave`, `modulus_from_stiffness`, `fourier` of relaxing laws
- published constants: `CATALOGUE`, `constants`, `find_entry`
- laws of your own: `Law`, `Sum`, `Scaled`, `mix`, `Deformation`, `density`; `register` gives those of a file names for scenes
- values at many points: `Points`

Modules
-------
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

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names
from ngbrain.materials.base import Deformation, Law, Scaled, Sum, density
from ngbrain.materials.catalogue import CATALOGUE, constants, find_entry
from ngbrain.materials.families import RelaxingOgden, mix
from ngbrain.materials.fibre import Fung, Guccione, HolzapfelGasserOgden
from ngbrain.materials.isotropic import Demiray, Gent, MooneyRivlin, NeoHooke, Ogden, Polynomial, UnsplitNeoHooke, Yeoh
from ngbrain.materials.linear import LinearElastic, SaintVenant, Shearing, SmallStrainLaw, TransverselyIsotropic
from ngbrain.materials.maxwell import Maxwell, MaxwellTerm, MaxwellVariables
from ngbrain.materials.modulus import fourier, modulus_from_stiffness, shear_wave
from ngbrain.materials.points import Points
from ngbrain.materials.registry import register
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

if TYPE_CHECKING:
    from ngbrain.materials import (
        admission,
        base,
        catalogue,
        families,
        fibre,
        isotropic,
        lab,
        linear,
        maxwell,
        modulus,
        named,
        points,
        registry,
        viscous,
        volumetric,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

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
    "Points",
    "Polynomial",
    "Prony",
    "RelaxingOgden",
    "RelaxingPolynomial",
    "SaintVenant",
    "Scaled",
    "Shearing",
    "SmallStrainLaw",
    "Sum",
    "TransverselyIsotropic",
    "UnsplitNeoHooke",
    "Viscous",
    "Yeoh",
    "admission",
    "barrier",
    "base",
    "catalogue",
    "constants",
    "density",
    "families",
    "fibre",
    "find_entry",
    "fourier",
    "isotropic",
    "lab",
    "linear",
    "logarithmic",
    "maxwell",
    "mix",
    "modulus",
    "modulus_from_stiffness",
    "named",
    "perturbed_lagrangian",
    "perturbed_logarithm",
    "points",
    "quadratic",
    "register",
    "registry",
    "shear_wave",
    "squared_log",
    "step_factors",
    "viscous",
    "volumetric",
]
