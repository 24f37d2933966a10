"""Maps of labels in files, and what their numbers mean."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.labelmap import LabelMap
from ngbrain.image.volume import Volume, stored

_MOST = 255
"""Regions that a map may have."""
_SCAN, _ROUGH = 64, 0.5
"""More numbers than that, which differ across more than this part of the faces between voxels, are grey values of a scan."""
_STRANGE = 5
"""Numbers that are not FreeSurfer's, up to which a map is taken for one of FreeSurfer's with regions of one's own."""

TISSUES = {1: "csf", 2: "grey", 3: "white", 4: "ventricles"}
"""Numbers of the labels that this package writes."""
SPM = {1: "grey", 2: "white", 3: "csf"}
"""Numbers of SPM's tissue classes c1, c2, c3."""
_DEEP = (9, 10, 11, 12, 13, 17, 18, 26, 27, 28, 48, 49, 50, 51, 52, 53, 54, 58, 59, 60)
FREESURFER = {
    **dict.fromkeys((2, 41, 77, 78, 79, 30, 62, 85), "white"),
    **dict.fromkeys((251, 252, 253, 254, 255), "corpus_callosum"),
    **dict.fromkeys((3, 42), "grey"),
    **dict.fromkeys((4, 5, 14, 15, 31, 43, 44, 63, 72), "ventricles"),
    **dict.fromkeys((7, 8, 46, 47), "cerebellum"),
    16: "brain_stem",
    24: "csf",
    **dict.fromkeys(_DEEP, "deep_grey"),
    80: "white",
    **dict.fromkeys((25, 57, 99), "lesion"),
}
"""Numbers of FreeSurfer's aseg; parcels of the cortex (1000 to 2999, 11000 to 12999) are grey, of white matter (3000 to
5002) white."""
SCHEMES: Mapping[str, Mapping[int, str]] = {"ngbrain": TISSUES, "spm": SPM, "freesurfer": FREESURFER}


def read_labels(
    path: str | os.PathLike[str],
    names: str | Mapping[int, str] | None = None,
    others: Mapping[int, str] | None = None,
) -> LabelMap:
    """A map of labels from a NIfTI or MGH file, on its own voxels.

    names   number → region, or "freesurfer", "spm" or "ngbrain"; None: FreeSurfer's if the numbers of both hemispheres'
            white matter (2 and 41) and no other than FreeSurfer's are there, else `label_1`, `label_2`, …: small numbers
            mean something else in every program, so they are not guessed
    others  number → region, besides and before those of `names`: a lesion drawn into FreeSurfer's map, say

    Raises:
        InputError: as `read_scan` does of a file and its place; numbers that are not whole, or negative; more than 255
            regions, or more than 64 that change from voxel to voxel as grey values of a scan do; nothing but zeros; numbers
            without a name, up to five in a map that is FreeSurfer's otherwise among them.

    >>> read_labels("case.mgz", "spm")
    Traceback (most recent call last):
    ngbrain.errors.InputError: case.mgz: image is missing; wanted: one NIfTI or MGH file: .nii, .nii.gz, .mgh or .mgz
    """
    path, file = Path(path), stored(path)
    if isinstance(names, str) and names not in SCHEMES:
        raise InputError("names", repr(names), "number = name for every label, or one of " + ", ".join(SCHEMES))
    try:
        raw = np.asanyarray(file.image.dataobj).reshape(file.shape)
    except (OSError, EOFError, ValueError) as error:
        raise InputError("image", f"cut short ({error})", "a whole file", path) from error
    if raw.dtype.kind not in "iufb" or not np.isfinite(raw).all() or (raw != np.rint(raw)).any():
        raise InputError("labels", "not whole numbers", "an integer for every voxel", path)
    if raw.min() < 0 or raw.max() > np.iinfo(np.int32).max:
        raise InputError("labels", f"from {raw.min():g} to {raw.max():g}", "numbers from 0 on", path)
    data = raw.astype(np.int32)
    numbers = set(np.unique(data).tolist()) - {0}
    if not numbers:
        raise InputError("labels", "0 everywhere", "a number from 1 on where the head is", path)
    if len(numbers) > _MOST and not _freesurfer(numbers):
        raise InputError("labels", f"{len(numbers)} different numbers", f"at most {_MOST} regions: is it a scan?", path)
    others = dict(others or {})
    strange = sorted(number for number in numbers - set(others) if not _of_freesurfer(number))
    if names is None and {2, 41} <= numbers and 0 < len(strange) <= _STRANGE:
        found = f"FreeSurfer's but for {', '.join(map(str, strange))}"
        raise InputError("labels", found, f"names freesurfer,{strange[0]}=NAME,… or a name for every number", path)
    if names is None and not others and len(numbers) > _SCAN and not _freesurfer(numbers) and _rough(data):
        raise InputError(
            "labels", f"{len(numbers)} numbers that change from voxel to voxel", "regions: is it a scan?", path
        )
    try:
        return LabelMap(Volume(data, file.affine), {**_named(numbers - set(others), names), **others})
    except InputError as error:
        raise InputError(error.field, error.value, error.wanted, path) from None


def _named(numbers: set[int], names: str | Mapping[int, str] | None) -> Mapping[int, str]:
    if isinstance(names, Mapping):
        return dict(names)
    if names == "freesurfer" or (names is None and _freesurfer(numbers)):
        return {number: name for number in numbers if (name := _of_freesurfer(number))}
    return SCHEMES[names] if names else {number: f"label_{number}" for number in numbers}


def _rough(data: np.ndarray) -> bool:
    """Whether most neighbours along the first axis that both have a number have two different ones."""
    one, other = data[:-1], data[1:]
    both = (one > 0) & (other > 0)
    return bool((one != other)[both].mean() > _ROUGH) if both.any() else False


def _freesurfer(numbers: set[int]) -> bool:
    return {2, 41} <= numbers and all(_of_freesurfer(number) for number in numbers)


def _of_freesurfer(number: int) -> str | None:
    if 1000 <= number < 3000 or 11000 <= number < 13000:
        return "grey"
    return "white" if 3000 <= number <= 5002 else FREESURFER.get(number)
