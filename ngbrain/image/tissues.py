"""From a scan to labels of its tissues and structures, each step kept on disk: the next mesh does not segment it again."""

from __future__ import annotations

import hashlib

import numpy as np

from ngbrain.errors import InputError, naming
from ngbrain.image import align, atlas, bias, brain, extracted, midsurface, places, segment, strip, topology, ventricles
from ngbrain.image import structures as structures_module
from ngbrain.image.labelmap import LabelMap
from ngbrain.image.midsurface import MidSurface
from ngbrain.image.rim import lifted
from ngbrain.image.structures import NAMES, Structures, structures
from ngbrain.image.volume import Scan, Volume
from ngbrain.io.cache import Arrays, kept


def tissues(scan: Scan) -> Volume:
    """Tissue of every voxel: stripped of its skull, freed of the coil's field and segmented (`ngbrain.image.segment`).

    Raises `InputError` for a scan that is no T1 of a whole head or brain.
    """
    with naming(scan.source):  # the file, which a picture and a mask do not know
        return _tissues(*_brain(scan))


def structured(scan: Scan) -> Structures:
    """Tissues and structures of a scan: `tissues`, split by `ngbrain.image.structures.structures`; raises what they raise.

    >>> from ngbrain.image.volume import mni152
    >>> structured(mni152()).labels.regions[:4]
    ('csf', 'ventricles', 'grey_left', 'grey_right')
    """
    with naming(scan.source):
        return _structured(*_brain(scan))


def by_atlas(scan: Scan, labels: LabelMap, template: Scan) -> LabelMap:
    """Regions of a scan by an atlas: its template bent into the scan's brain takes the labels along (`ngbrain.image.atlas`).

    labels    of the atlas, in the space of the template
    template  the T1 that they were drawn on, with its skull or without

    Raises what `find_brain` raises of either scan and what `transported` raises; `InputError` where no label comes to lie in the
    brain.
    """
    head, drawn = _on_black(scan), _on_black(template)

    def make() -> Arrays:
        return {"labels": atlas.transported(labels, drawn, head).volume.data}

    names = {str(number): name for number, name in labels.names.items()}
    made_from = [head.digest(), drawn.digest(), labels.volume.digest(), names]
    found = LabelMap(Volume(kept("atlas", made_from, (atlas, align), make)["labels"], head.affine), labels.names)
    if not found.regions:
        raise InputError("atlas", f"beside the brain of {template.source}", "labels in the space of the template")
    return found


def _on_black(scan: Scan) -> Volume:
    """The picture of the brain, 0 around it."""
    with naming(scan.source):
        picture, mask = _brain(scan)
    return Volume(np.where(mask, picture.data, 0), picture.affine)


def _brain(scan: Scan) -> tuple[Volume, np.ndarray]:
    """The picture, its rim made even with fluid where voxels are coarse, and the mask of the brain."""
    made_from = [scan.volume.digest(), scan.file_affine.tolist(), list(scan.file_shape)]
    made_by = (align, bias, brain, extracted, strip)
    mask = kept("brain", made_from, made_by, lambda: {"mask": brain.find_brain(scan)})["mask"]
    return lifted(scan, mask), mask


def _seen(picture: Volume, mask: np.ndarray) -> list[str]:
    return [picture.digest(), hashlib.sha256(np.packbits(mask).tobytes()).hexdigest()]


def _even(picture: Volume, mask: np.ndarray) -> Volume:
    """The picture without the coil's field."""
    arrays = kept("even", _seen(picture, mask), (bias,), lambda: {"t1": bias.unbiased(picture, mask).data})
    return Volume(arrays["t1"], picture.affine)


def _tissues(picture: Volume, mask: np.ndarray) -> Volume:
    def make() -> Arrays:
        return {"labels": segment.segment(_even(picture, mask), mask).volume.data}

    labels = kept("labels", _seen(picture, mask), (segment, topology, ventricles, bias), make)["labels"]
    return Volume(labels, picture.affine)


def _structured(picture: Volume, mask: np.ndarray) -> Structures:
    labels = _tissues(picture, mask)

    def make() -> Arrays:
        made = structures(_even(picture, mask), labels)
        return {
            "labels": made.labels.volume.data,
            "parts": made.parts.data,
            "affine": made.affine,
            "offset": made.middle.offset,
        }

    modules = (structures_module, places, midsurface, align, bias)
    found = kept("structures", [*_seen(picture, mask), labels.digest()], modules, make)
    names, affine = LabelMap(Volume(found["labels"], labels.affine), NAMES), labels.affine
    return Structures(names, Volume(found["parts"], affine), found["affine"], MidSurface(found["offset"]))
