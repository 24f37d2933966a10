"""From a scan to tissue labels, kept on disk: the next mesh of the same scan does not segment it again."""

from __future__ import annotations

from ngbrain.image import extracted, segment, ventricles
from ngbrain.image.volume import Scan, Volume
from ngbrain.io.cache import Arrays, kept


def tissues(scan: Scan) -> Volume:
    """Tissue of every voxel (see `ngbrain.image.segment`), from the cache if the same scan was segmented before.

    Raises `InputError` for a scan that is no extracted brain.
    """
    mask = extracted.check_extracted(scan)

    def make() -> Arrays:
        return {"labels": segment.segment(scan.volume, mask).volume.data}

    labels = kept("labels", scan.volume.digest(), (segment, ventricles, extracted), make)["labels"]
    return Volume(labels, scan.volume.affine)
