"""Scans: reading, straightening, the brain in its skull, the field of the coil, tissue labels and their topology."""

from ngbrain.image.preprocess.brain import find_brain
from ngbrain.image.preprocess.check_brain import check_extracted
from ngbrain.image.read.volume import Scan, Volume, border_value, mni152, read_scan, resample_to_ras

__all__ = ["Scan", "Volume", "border_value", "check_extracted", "find_brain", "mni152", "read_scan", "resample_to_ras"]
