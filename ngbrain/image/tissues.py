"""From a scan to labels of its tissues and structures, each step kept on disk: the next mesh does not segment it again."""

from __future__ import annotations

import hashlib

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image import align, atlas, bias, midsurface, places, segment, strip, topology, ventricles
from ngbrain.image import structures as structures_module
from ngbrain.image.brain import find_brain
from ngbrain.image.labelmap import LabelMap
from ngbrain.image.midsurface import MidSurface
from ngbrain.image.structures import NAMES, Structures, structures
from ngbrain.image.volume import Scan, Volume
from ngbrain.io.cache import Arrays, kept


def tissues(scan: Scan) -> Volume:
    """Tissue of every voxel: stripped of its skull, freed of the coil's field and segmented (`ngbrain.image.segment`).

    Raises `InputError` for a scan that is no T1 of a whole head or brain.
    """
    return _tissues(scan, _brain(scan))


def structured(scan: Scan) -> Structures:
    """Tissues and structures of a scan: `tissues`, split by `ngbrain.image.structures.structures`; raises what they raise.

    >>> from ngbrain.image.volume import mni152
    >>> structured(mni152()).labels.regions[:4]
    ('csf', 'ventricles', 'grey_left', 'grey_right')
    """
    mask = _brain(scan)
    labels = _tissues(scan, mask)

    def make() -> Arrays:
        made = structures(_even(scan, mask), labels)
        return {
            "labels": made.labels.volume.data,
            "parts": made.parts.data,
            "affine": made.affine,
            "offset": made.middle.offset,
        }

    modules = (structures_module, places, midsurface, align, bias)
    found = kept("structures", [*_seen(scan, mask), labels.digest()], modules, make)
    names, affine = LabelMap(Volume(found["labels"], labels.affine), NAMES), labels.affine
    return Structures(names, Volume(found["parts"], affine), found["affine"], MidSurface(found["offset"]))


def by_atlas(scan: Scan, labels: LabelMap, template: Scan) -> LabelMap:
    """Regions of a scan by an atlas: its template bent into the scan's brain takes the labels along (`ngbrain.image.atlas`).

    labels    of the atlas, in the space of the template
    template  the T1 that they were drawn on, with its skull or without

    Raises what `find_brain` raises of either scan and what `transported` raises; `InputError` where no label comes to lie in the
    brain.
    """
    brains = [Volume(np.where(_brain(each), each.volume.data, 0), each.volume.affine) for each in (scan, template)]

    def make() -> Arrays:
        return {"labels": atlas.transported(labels, brains[1], brains[0]).volume.data}

    made_from = [
        *(each.digest() for each in (*brains, labels.volume)),
        {str(n): name for n, name in labels.names.items()},
    ]
    found = LabelMap(Volume(kept("atlas", made_from, (atlas, align), make)["labels"], scan.volume.affine), labels.names)
    if not found.regions:
        raise InputError("atlas", f"beside the brain of {template.source}", "labels in the space of the template")
    return found


def _brain(scan: Scan) -> np.ndarray:
    def stripped(scan: Scan) -> np.ndarray:
        made_by = (align, bias, strip)
        return kept("brain", scan.volume.digest(), made_by, lambda: {"mask": strip.strip(scan)})["mask"]

    return find_brain(scan, stripped)


def _seen(scan: Scan, mask: np.ndarray) -> list[str]:
    return [scan.volume.digest(), hashlib.sha256(np.packbits(mask).tobytes()).hexdigest()]


def _even(scan: Scan, mask: np.ndarray) -> Volume:
    """The picture without the coil's field."""
    picture = scan.volume
    arrays = kept("even", _seen(scan, mask), (bias,), lambda: {"t1": bias.unbiased(picture, mask).data})
    return Volume(arrays["t1"], picture.affine)


def _tissues(scan: Scan, mask: np.ndarray) -> Volume:
    def make() -> Arrays:
        return {"labels": segment.segment(_even(scan, mask), mask).volume.data}

    labels = kept("labels", _seen(scan, mask), (segment, topology, ventricles, bias), make)["labels"]
    return Volume(labels, scan.volume.affine)
