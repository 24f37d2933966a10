"""Closed triangle surfaces: extraction, remeshing, repair, and the surfaces of the cortex.

- `triangle_mesh`: a closed triangle surface: area, enclosed volume, components and genus.
- `mask_surface`: the surface of a voxel mask, with the topology of the mask.
- `remeshing`: triangles on a smooth level set, graded by a size field.
- `manifold`: sets of tetrahedra whose boundary is made a manifold.
- `smoothing`: smoothing that avoids self-intersections, and where triangles intersect.
- `head_outlines`: smooth outlines of a head, its ventricles and lesions, and their repairs.
- `cortex`: white, pial and outer surface, and cortical thickness.
- `cortex_refinement`: placement of the white and pial surface by the grey values of a scan.
- `cortical_files`: files of the cortical surfaces of a subject.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.mesh.surface import (
        cortex,
        cortex_refinement,
        cortical_files,
        head_outlines,
        manifold,
        mask_surface,
        remeshing,
        smoothing,
        triangle_mesh,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "cortex",
    "cortex_refinement",
    "cortical_files",
    "head_outlines",
    "manifold",
    "mask_surface",
    "remeshing",
    "smoothing",
    "triangle_mesh",
]
