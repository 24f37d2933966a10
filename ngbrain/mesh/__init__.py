"""Meshes with named regions and boundaries."""

from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.mesh.geometry.level_set import LevelSet
from ngbrain.mesh.geometry.primitives import Sizes, block, cleft_to, idealised_head
from ngbrain.mesh.shipped import load
from ngbrain.mesh.tet_mesh import Elements, smallest_angles

__all__ = [
    "Cleft",
    "Elements",
    "LevelSet",
    "Sizes",
    "block",
    "cleft_to",
    "idealised_head",
    "load",
    "smallest_angles",
]
