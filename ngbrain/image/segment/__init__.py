"""Tissue classes, ventricles, and topology of labels.

- `fluid`: Sulcal fluid and ventricles missing in label maps of other programs.
- `from_surfaces`: Label map from closed surfaces.
- `nuclei`: Deep grey matter: thalamus, caudate, putamen and pallidum.
- `partial_volume`: Partial-volume correction at the boundary of the brain.
- `tissue_classes`: Segmentation of fluid, grey and white matter, and ventricles.
- `topology`: Betti numbers of regions, and removal of islands and holes.
- `topology_correction`: Topology correction: regions with the topology of a ball.
- `ventricles`: Segmentation of the lateral ventricles.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.image.segment import (
        fluid,
        from_surfaces,
        nuclei,
        partial_volume,
        tissue_classes,
        topology,
        topology_correction,
        ventricles,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "fluid",
    "from_surfaces",
    "nuclei",
    "partial_volume",
    "tissue_classes",
    "topology",
    "topology_correction",
    "ventricles",
]
