"""Scans: reading, straightening, brain extraction's checks, tissue labels."""

from ngbrain.image.extracted import check_extracted
from ngbrain.image.volume import Scan, Volume, border, mni152, read_scan, straightened

__all__ = ["Scan", "Volume", "border", "check_extracted", "mni152", "read_scan", "straightened"]
