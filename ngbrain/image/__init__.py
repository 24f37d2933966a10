"""Medical images of heads: reading, preprocessing, segmentation, structures, and MR elastography.

- scans: `read_scan`, `Scan`, `Volume`, `mni152` (the MNI152 template), `resample_to_ras`, `border_value`
- label maps: `LabelMap`, `read_labels` (FreeSurfer, SynthSeg and others), `resample_labels`, `write_nifti`
- from a scan to labels: `label_tissues` (`ngbrain.segment`), `Segmentation`, `label_structures`, `label_by_atlas`,
  `template_affine`
- its label numbers: `CSF`, `GREY`, `WHITE`, `VENTRICLE`
- steps of it: `find_brain`, `check_extracted`, `skull_strip`, `correct_bias_field`, `tissue_maps`, `landmarks`
- topology of labels: `topologies`, `clean_labels`, `labels_from_surfaces`
- maps on a grid: `read_map` of a measured quantity, `read_fibre_directions`, `FibreDirections`
- MR elastography: `unwrap_phase`, `phase_to_displacement`, `first_harmonic`, `remove_rigid_motion`, `octahedral_strain`

Modules
-------
- `labelling`: From a scan to labels of tissues and structures, with every step cached.
- `mre`: MR elastography: from phase images to complex displacements.
- `preprocess`: Registration, bias-field correction, skull stripping, contrast.
- `read`: Files of images and labels: NIfTI, MGZ, DICOM, label maps, fibre directions.
- `segment`: Tissue classes, ventricles, and topology of labels.
- `structures`: Hemispheres, cerebellum, brain stem, dura, atlas regions.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.image import labelling, mre, preprocess, read, segment, structures
    from ngbrain.image.labelling import Segmentation, label_by_atlas, label_structures, label_tissues, template_affine
    from ngbrain.image.mre.displacement import first_harmonic, phase_to_displacement, remove_rigid_motion, unwrap_phase
    from ngbrain.image.mre.strain import octahedral_strain
    from ngbrain.image.preprocess.bias_field import correct_bias_field
    from ngbrain.image.preprocess.brain import find_brain
    from ngbrain.image.preprocess.check_brain import check_extracted
    from ngbrain.image.preprocess.contrast import tissue_maps
    from ngbrain.image.preprocess.skull_strip import skull_strip
    from ngbrain.image.read.fibre_directions import FibreDirections, read_fibre_directions
    from ngbrain.image.read.image_file import read_scan
    from ngbrain.image.read.label_file import read_labels
    from ngbrain.image.read.label_map import LabelMap
    from ngbrain.image.read.landmarks import landmarks
    from ngbrain.image.read.nifti import resample_labels, write_nifti
    from ngbrain.image.read.property_maps import read_map
    from ngbrain.image.read.resampling import border_value, resample_to_ras
    from ngbrain.image.read.template import mni152
    from ngbrain.image.read.volume import Scan, Volume
    from ngbrain.image.segment.from_surfaces import labels_from_surfaces
    from ngbrain.image.segment.tissue_classes import CSF, GREY, VENTRICLE, WHITE
    from ngbrain.image.segment.topology import clean_labels, topologies
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "CSF",
    "GREY",
    "VENTRICLE",
    "WHITE",
    "FibreDirections",
    "LabelMap",
    "Scan",
    "Segmentation",
    "Volume",
    "border_value",
    "check_extracted",
    "clean_labels",
    "correct_bias_field",
    "find_brain",
    "first_harmonic",
    "label_by_atlas",
    "label_structures",
    "label_tissues",
    "labelling",
    "labels_from_surfaces",
    "landmarks",
    "mni152",
    "mre",
    "octahedral_strain",
    "phase_to_displacement",
    "preprocess",
    "read",
    "read_fibre_directions",
    "read_labels",
    "read_map",
    "read_scan",
    "remove_rigid_motion",
    "resample_labels",
    "resample_to_ras",
    "segment",
    "skull_strip",
    "structures",
    "template_affine",
    "tissue_maps",
    "topologies",
    "unwrap_phase",
    "write_nifti",
]
