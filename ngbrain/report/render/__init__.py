"""A small software renderer for surfaces.

- `renderer`: shaded triangles with a depth buffer in orthographic projection.
- `surface`: surfaces and plane sections of quadratic tetrahedral meshes.
"""

__all__ = ["renderer", "surface"]
