"""Mesh improvement: vertex moves, swaps and snapping that raise element quality and keep interfaces.

- `curving`: second-order meshes whose interfaces are curved onto those of the labels.
- `guarded_moves`: vertex moves that never make a bad tetrahedron.
- `octree`: a body-centred cubic lattice of tetrahedra on an octree, graded by a size field.
- `reconnection`: edge and face swaps that replace the worst tetrahedra.
- `vertex_relocation`: optimisation-based vertex smoothing that keeps interfaces.
- `snapped_lattice`: a lattice whose vertices are moved onto the interfaces of volume fractions.
- `snapping`: snapping of vertices to interfaces, and cuts of the edges that still cross one.
- `volume_matching`: interface moves that give regions their target volumes.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.mesh.improve import (
        curving,
        guarded_moves,
        octree,
        reconnection,
        snapped_lattice,
        snapping,
        vertex_relocation,
        volume_matching,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "curving",
    "guarded_moves",
    "octree",
    "reconnection",
    "snapped_lattice",
    "snapping",
    "vertex_relocation",
    "volume_matching",
]
