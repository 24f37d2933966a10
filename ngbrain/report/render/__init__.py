"""A small software renderer for surfaces.

- `renderer`: A small renderer: shaded triangles through a depth buffer, seen from afar (no perspective, so scale bars
  hold).
- `surface`: Surfaces of a quadratic tetrahedral mesh, and its cuts with a plane, as plain triangles and lines.
"""

__all__ = ["renderer", "surface"]
