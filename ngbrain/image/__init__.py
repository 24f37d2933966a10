"""Medical images of heads: reading, preprocessing, segmentation, structures, and MR elastography.

- `labelling`: From a scan to labels of tissues and structures, with every step cached.
- `mre`: MR elastography: from phase images to complex displacements.
- `preprocess`: Registration, bias-field correction, skull stripping, contrast.
- `read`: Files of images and labels: NIfTI, MGZ, DICOM, label maps, fibre directions.
- `segment`: Tissue classes, ventricles, and topology of labels.
- `structures`: Hemispheres, cerebellum, brain stem, dura, atlas regions.
"""

from ngbrain.image.preprocess.brain import find_brain
from ngbrain.image.preprocess.check_brain import check_extracted
from ngbrain.image.read.template import mni152
from ngbrain.image.read.volume import Scan, Volume, border_value, read_scan, resample_to_ras

__all__ = ["Scan", "Volume", "border_value", "check_extracted", "find_brain", "mni152", "read_scan", "resample_to_ras"]
