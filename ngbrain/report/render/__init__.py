"""A small software renderer for surfaces.

- `renderer`: shaded triangles with a depth buffer in orthographic projection.
- `surface`: surfaces and plane sections of quadratic tetrahedral meshes.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.report.render import renderer, surface
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["renderer", "surface"]
