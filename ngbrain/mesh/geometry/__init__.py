"""Shapes and size fields: blocks, idealised heads, level sets, clefts.

- `cleft`: the surgical cleft, a slot from the surface to a target, and its coordinate frame.
- `cleft_walls`: the walls, ends and floor of a cleft as triangles in exact planes, cut by a smooth surface.
- `curved_elements`: second-order tetrahedra that follow the geometry without folding.
- `level_set`: a shape from voxels as a smooth signed distance.
- `primitives`: shapes made by Open CASCADE: a block and an idealised head.
- `sizing`: size fields: element size as a function of position.
- `structured`: structured quadrilateral and hexahedral meshes on grids of points or of cells.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.mesh.geometry import cleft, cleft_walls, curved_elements, level_set, primitives, sizing, structured
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["cleft", "cleft_walls", "curved_elements", "level_set", "primitives", "sizing", "structured"]
