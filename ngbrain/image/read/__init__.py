"""Files of images and labels: NIfTI, MGZ, DICOM, label maps, fibre directions.

- `dicom`: DICOM series.
- `fibre_directions`: Fibre directions from vector or diffusion-tensor images.
- `image_file`: Scans and other images from NIfTI, MGH and DICOM files.
- `label_file`: Label maps from files of FreeSurfer, SynthSeg, MUSE, SPM, CAT and FAST.
- `label_map`: Label maps: the region of each voxel.
- `label_schemes`: Label numbers of other programs.
- `landmarks`: Named points of a head.
- `nifti`: Write NIfTI files, and resample label maps.
- `property_maps`: Maps of a measured quantity, such as shear stiffness.
- `resampling`: Volumes on other axes.
- `template`: The MNI152 template.
- `volume`: Volumes on a voxel grid, and T1 scans.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.image.read import (
        dicom,
        fibre_directions,
        image_file,
        label_file,
        label_map,
        label_schemes,
        landmarks,
        nifti,
        property_maps,
        resampling,
        template,
        volume,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "dicom",
    "fibre_directions",
    "image_file",
    "label_file",
    "label_map",
    "label_schemes",
    "landmarks",
    "nifti",
    "property_maps",
    "resampling",
    "template",
    "volume",
]
