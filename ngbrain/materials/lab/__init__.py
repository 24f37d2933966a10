"""Material laboratory: homogeneous tests of laws without a mesh, fits to measured curves, plots of both.

Stresses are nominal (first Piola-Kirchhoff, Pa), of an incompressible body in one of four tests: "uniaxial",
"equibiaxial", "planar" and "shear". Parameters of laws are numbers or NGSolve `Parameter`s.

- `curves`: measured curves
- `elastic`: stress and ellipticity of elastic laws
- `relaxing`: stress histories, relaxation, creep and complex modulus of viscoelastic materials
- `fit`: least-squares fits of parameters
- `plot`: plots of laws and curves
- `description`: laws and published materials in words
- `modes`, `specimen`: kinematics and equilibrium of the tests
"""

from ngbrain.materials.lab.curves import Curve, budday
from ngbrain.materials.lab.elastic import ellipticity, stress
from ngbrain.materials.lab.fit import Fit, fit
from ngbrain.materials.lab.plot import plot, plot_catalogue, plot_law
from ngbrain.materials.lab.relaxing import creep, history, press, relaxation, storage_loss
from ngbrain.materials.points import initial_modulus

__all__ = [
    "Curve",
    "Fit",
    "budday",
    "creep",
    "ellipticity",
    "fit",
    "history",
    "initial_modulus",
    "plot",
    "plot_catalogue",
    "plot_law",
    "press",
    "relaxation",
    "storage_loss",
    "stress",
]
