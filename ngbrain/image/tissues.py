"""From a scan to tissue labels, each step kept on disk: the next mesh of the same scan does not segment it again."""

from __future__ import annotations

import hashlib

import numpy as np

from ngbrain.image import align, bias, segment, strip, topology, ventricles
from ngbrain.image.brain import find_brain
from ngbrain.image.volume import Scan, Volume
from ngbrain.io.cache import Arrays, kept


def tissues(scan: Scan) -> Volume:
    """Tissue of every voxel: stripped of its skull, freed of the coil's field and segmented (`ngbrain.image.segment`).

    Raises `InputError` for a scan that is no T1 of a whole head or brain.
    """
    picture = scan.volume

    def stripped(scan: Scan) -> np.ndarray:
        made_by = (align, bias, strip)
        return kept("brain", picture.digest(), made_by, lambda: {"mask": strip.strip(scan)})["mask"]

    mask = find_brain(scan, stripped)
    seen = [picture.digest(), hashlib.sha256(np.packbits(mask).tobytes()).hexdigest()]

    def make() -> Arrays:
        even = kept("even", seen, (bias,), lambda: {"t1": bias.unbiased(picture, mask).data})["t1"]
        return {"labels": segment.segment(Volume(even, picture.affine), mask).volume.data}

    labels = kept("labels", seen, (segment, topology, ventricles, bias), make)["labels"]
    return Volume(labels, picture.affine)
