"""The material laboratory: homogeneous tests of laws without a mesh, fits to measured curves, pictures of both.

Everything is a nominal stress (first Piola-Kirchhoff, Pa) of an incompressible body in one of four tests, "uniaxial",
"equibiaxial", "planar" and "shear". Parameters of laws are numbers or ngsolve `Parameter`s.
"""

from ngbrain.materials.lab.elastic import ellipticity, initial_modulus, stress
from ngbrain.materials.lab.relaxing import creep, history, relaxation, storage_loss

__all__ = ["creep", "ellipticity", "history", "initial_modulus", "relaxation", "storage_loss", "stress"]
