"""Tissue classes, and the topology of their labels.

- `fluid`: Fluid that other programs' label maps do not name: in sulci, which FreeSurfer leaves empty, and in
  ventricles of tissue maps.
- `from_surfaces`: A map of labels from closed surfaces: what is inside each of them.
- `nuclei`: Deep grey matter: thalamus, caudate, putamen and pallidum, found by place and by the edges of grey values
  around them.
- `partial_volume`: The rim of a brain in a coarse scan: voxels that the brain shares with what is around it.
- `tissue_classes`: From grey values to tissue: fluid, grey and white matter, ventricles, and the share of white
  matter in a voxel.
- `topology`: How the regions of a label map hang together: pieces, tunnels and cavities, counted; and islands and
  holes, removed.
- `topology_correction`: Masks as balls: a region's handles cut and its cavities filled, so that its surface is a
  sphere.
- `ventricles`: Which of the fluid in a brain is the lateral ventricles: told from cisterns and sulci by place, by
  necks and by walls.
"""

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
