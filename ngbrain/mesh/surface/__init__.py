"""Closed surfaces of triangles: made, remeshed, repaired, and the cortex between two of them.

- `cortex`: The cortex between two surfaces: white and pial, with the ventricles inside and the head's surface
  outside.
- `cortex_refinement`: The white and the pial surface where the grey values of a scan say, between the voxels.
- `cortical_files`: White and pial surface of a subject in files, with the thickness of the cortex between them.
- `head_outlines`: Smooth outlines of a head, its ventricles and lesions, from labels, and what had to be changed for
  them to be surfaces.
- `manifold`: Sets of tetrahedra whose boundary is a surface: where it is none, tetrahedra are added or taken away
  until it is.
- `mask_surface`: The surface of a mask as triangles: closed, two at every edge, and of the same topology as the mask.
- `remeshing`: Triangles on a smooth closed surface, as fine as a size field asks: samples, spread evenly, and their
  Delaunay facets.
- `self_intersections`: Where triangles of a surface, or of several, go through each other; and smoothing that leaves
  no such place.
- `triangle_mesh`: A closed surface of triangles: its area, the volume that it encloses, its pieces and its genus.
"""

__all__ = [
    "cortex",
    "cortex_refinement",
    "cortical_files",
    "head_outlines",
    "manifold",
    "mask_surface",
    "remeshing",
    "self_intersections",
    "triangle_mesh",
]
