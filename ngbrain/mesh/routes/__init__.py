"""Meshing routes: from a label map to a volume mesh, by name.

- `registry`: the routes by name, with a cache, and summaries of their meshes.
- `hull`: smooth surfaces of head, ventricles and lesions; tissues are a field inside. The smallest model.
- `lattice`: a lattice snapped onto the interfaces of all labels; it works for any labels.
- `conforming`: Delaunay tetrahedra that conform to all interfaces, graded by a size field.
- `craniotomy`: a head opened by a cleft under a craniotomy, by any route.
- `heads`: the head of a scan by any route, closed or opened, as scenes have it.
- `cleft_head`: a hull with a cleft cut out by exact planes.
- `cleft_subtraction`: a cleft subtracted from labels, for the routes that mesh any labels.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.mesh.routes import (
        cleft_head,
        cleft_subtraction,
        conforming,
        craniotomy,
        heads,
        hull,
        lattice,
        registry,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["cleft_head", "cleft_subtraction", "conforming", "craniotomy", "heads", "hull", "lattice", "registry"]
