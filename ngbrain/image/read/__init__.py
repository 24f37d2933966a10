"""Files of images and labels: NIfTI, MGZ, DICOM, label maps, fibre directions.

- `dicom`: A scan from the DICOM files of its slices.
- `fibre_directions`: Directions of fibres over a head: vectors or tensors of diffusion from NIfTI files, in the
  head's own axes, and at points.
- `label_file`: Maps of labels in files, and what their numbers mean.
- `label_map`: A map of labels: which region of the head each voxel belongs to, and what the regions are called.
- `label_schemes`: What the numbers of other programs' label maps mean.
- `landmarks`: Places on a head that go by a name.
- `nifti`: Pictures to NIfTI files.
- `property_maps`: Maps of a measured quantity over a head, such as shear stiffness: from files, and at points.
- `volume`: Pictures of a head: values on a grid of voxels with a place in the world, and the files they come from.
"""

__all__ = [
    "dicom",
    "fibre_directions",
    "label_file",
    "label_map",
    "label_schemes",
    "landmarks",
    "nifti",
    "property_maps",
    "volume",
]
