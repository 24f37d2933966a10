"""Tetrahedral meshes of heads with named regions and boundaries.

The names below are those that most scripts need. The rest lies in:

- `geometry`: shapes and size fields: blocks, idealised heads, level sets, clefts.
- `labels`: a label map as smooth functions: indicators, volume fractions, sample points, zones of volume matching.
- `surface`: closed triangle surfaces: remeshing, repair, the white and pial surface of the cortex.
- `improve`: mesh improvement: vertex moves, swaps, snapping, volume matching, curved elements.
- `routes`: the meshing routes `hull`, `lattice` and `conforming`, and heads opened by a cleft.
- `tet_mesh`: the mesh as plain arrays, with conversion to NGSolve.
- `quality`: dihedral angles, radius ratios, volume errors and distances from the labels.
- `resolution_study`: which mesh is fine enough for which quantity, by measurements on one head.
- `head_mesh`, `files`, `imported`, `transfer`, `shipped`: the result of meshing, its files, meshes of other programs,
  transfer to voxels, and the meshes that come with the package.
"""

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
