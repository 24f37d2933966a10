"""Shapes and size fields: blocks, idealised heads, level sets, clefts.

- `cleft`: The surgeon's opening: a slot from the surface to a target, and the frame that a blade moves in.
- `cleft_walls`: The walls, ends and floor of a cleft as triangles in exact planes, up to where a smooth surface cuts
  them off.
- `curved_elements`: Tetrahedra with curved edges that follow the shape as far as they can without folding.
- `level_set`: A shape given by voxels, as a smooth signed distance that points can be put on.
- `primitives`: Shapes made by Open CASCADE: a block and an idealised head, with named regions and boundaries.
- `sizing`: How fine a mesh is where: fine around a site, coarser away from it.
- `structured`: Structured meshes: quadrilaterals on the points of a grid, as published wave data were made in, or of
  cells, and hexahedra.
"""

__all__ = ["cleft", "cleft_walls", "curved_elements", "level_set", "primitives", "sizing", "structured"]
