"""Tetrahedral meshes of heads with named regions and boundaries.

- shapes: `block`, `idealised_head` with `Sizes`, `LevelSet` (of voxels), `Cleft`, `cleft_to`; `rectangles` and `boxes` (structured)
- size fields: `RadialSizeField`, `CleftSizeField`
- from labels to a mesh: `mesh_labels`, `mesh_elements` by one of the `ROUTES` (a `Route` each, whose result is a `LabelMesh`);
  `recommend_mesh` says which element size a quantity needs; `Indicators` are labels as smooth functions
- surfaces: `SurfaceMesh`, `Surface`, `outlines` of a head, `cortex` (a `Cortex`)
- meshes as arrays: `Elements`, `named_elements`, `smallest_angles`; `voxelise` transfers a mesh to voxels
- quality: `Quality`, `radius_ratios`, `deviations` from the labels, `volumes_ml`, `volume_errors`
- files: `load` (meshes that come with the package), `HeadMesh`, `write_imported` (meshes of other programs)

Modules
-------
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

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.mesh import (
        files,
        geometry,
        head_mesh,
        imported,
        improve,
        labels,
        quality,
        resolution_study,
        routes,
        shipped,
        surface,
        tet_mesh,
        transfer,
    )
    from ngbrain.mesh.geometry.cleft import Cleft
    from ngbrain.mesh.geometry.level_set import LevelSet
    from ngbrain.mesh.geometry.primitives import Sizes, block, cleft_to, idealised_head
    from ngbrain.mesh.geometry.sizing import CleftSizeField, RadialSizeField
    from ngbrain.mesh.geometry.structured import boxes, rectangles
    from ngbrain.mesh.head_mesh import HeadMesh
    from ngbrain.mesh.imported import write_imported
    from ngbrain.mesh.labels.indicators import Indicators
    from ngbrain.mesh.quality import Quality, deviations, radius_ratios, volume_errors, volumes_ml
    from ngbrain.mesh.resolution_study import recommend_mesh
    from ngbrain.mesh.routes.registry import ROUTES, LabelMesh, Route, mesh_elements, mesh_labels
    from ngbrain.mesh.shipped import load
    from ngbrain.mesh.surface.cortex import Cortex, cortex
    from ngbrain.mesh.surface.head_outlines import outlines
    from ngbrain.mesh.surface.triangle_mesh import SurfaceMesh
    from ngbrain.mesh.tet_mesh import Elements, Surface, named_elements, smallest_angles
    from ngbrain.mesh.transfer import voxelise
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "ROUTES",
    "Cleft",
    "CleftSizeField",
    "Cortex",
    "Elements",
    "HeadMesh",
    "Indicators",
    "LabelMesh",
    "LevelSet",
    "Quality",
    "RadialSizeField",
    "Route",
    "Sizes",
    "Surface",
    "SurfaceMesh",
    "block",
    "boxes",
    "cleft_to",
    "cortex",
    "deviations",
    "files",
    "geometry",
    "head_mesh",
    "idealised_head",
    "imported",
    "improve",
    "labels",
    "load",
    "mesh_elements",
    "mesh_labels",
    "named_elements",
    "outlines",
    "quality",
    "radius_ratios",
    "recommend_mesh",
    "rectangles",
    "resolution_study",
    "routes",
    "shipped",
    "smallest_angles",
    "surface",
    "tet_mesh",
    "transfer",
    "volume_errors",
    "volumes_ml",
    "voxelise",
    "write_imported",
]
