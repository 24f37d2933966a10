"""Meshes with named regions and boundaries."""

from ngbrain.mesh.cleft import Cleft
from ngbrain.mesh.elements import Elements, smallest_angles
from ngbrain.mesh.levelset import LevelSet
from ngbrain.mesh.library import load
from ngbrain.mesh.shapes import Sizes, block, cleft_to, idealised_head

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
