"""Maps of labels in files, and what their numbers mean."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.label_schemes import (
    RECOGNISED,
    SCHEMES,
    recognise_scheme,
    region_name,
    scheme_choices,
    unknown_numbers,
)
from ngbrain.image.read.volume import Volume, fill_nan_background, open_volume

_MOST = 255
"""Regions that a map may have."""
_SCAN, _ROUGH = 64, 0.5
"""More numbers than that, which differ across more than this part of the faces between voxels, are grey values of a scan."""
_STRANGE = 5
"""Numbers that a scheme does not have, up to which a map is taken for one of it with regions of one's own."""
_TISSUES = 4
"""Numbers up to that mean another tissue in every program, so that they are asked for."""
_OFF = 1e-3
"""Distance from whole numbers that scaling leaves."""
_SHARES = {
    "spm": re.compile(r"(?P<before>[a-z]*c)(?P<class>[123])(?P<after>.+)"),
    "cat": re.compile(r"(?P<before>[a-z]*p)(?P<class>[123])(?P<after>.+)"),
    "fast": re.compile(r"(?P<before>.+_(pve|prob)_)(?P<class>[012])(?P<after>\.nii.*)"),
}
"""Names of the files with the share of each tissue, which lie side by side."""
_CLASSES = {"spm": "123", "cat": "123", "fast": "012"}
_OF_CLASSES = {"spm": "spm", "cat": "spm", "fast": "fast"}
"""Whose numbers the classes have: CAT's p1, p2 and p3 are SPM's, its p0 is not."""


def read_labels(
    path: str | os.PathLike[str],
    names: str | Mapping[int, str] | None = None,
    others: Mapping[int, str] | None = None,
) -> LabelMap:
    """A map of labels from a NIfTI or MGH file, on its own voxels.

    Parameters
    ----------
    path
        Whole numbers, or what scaling makes of them (up to 1e-3 off). With "spm", "cat" or "fast" also tissues with partial
        volumes (CAT's p0), which are rounded, and one of three maps of shares that lie side by side (c1, c2, c3 of SPM, p1, p2,
        p3 of CAT, pve_0, pve_1, pve_2 of FAST), of which the largest share counts.
    names
        Number → region, or one of `ngbrain.image.read.label_schemes.SCHEMES`. None: as the numbers say, if they can only be
        those of
        FreeSurfer, FastSurfer and SynthSeg, or of MUSE; else `label_5`, …, but for numbers up to 4, which mean another tissue in
        every program.
    others
        Number → region, besides and before those of `names`: a lesion drawn into FreeSurfer's map, say.

    Raises
    ------
    InputError
        As `read_scan` does of a file and its place; numbers that are not whole, or negative; more than 255 regions, or more than
        64 that change from voxel to voxel as grey values of a scan do; nothing but zeros; numbers without a name.

    Examples
    --------
    >>> read_labels("case.mgz", "spm")
    Traceback (most recent call last):
    ngbrain.errors.InputError: case.mgz: image is missing; wanted: one NIfTI or MGH file: .nii, .nii.gz, .mgh or .mgz
    """
    return read_labels_with_notes(path, names, others)[0]


def read_labels_with_notes(
    path: str | os.PathLike[str],
    names: str | Mapping[int, str] | None = None,
    others: Mapping[int, str] | None = None,
) -> tuple[LabelMap, tuple[str, ...]]:
    """As `read_labels`, and in sentences what was done to the numbers and what they were taken for."""
    path = Path(path)
    if isinstance(names, str) and names not in SCHEMES:
        raise InputError("names", repr(names), "number = name for every label, or one of " + ", ".join(SCHEMES))
    raw, affine = _values(path)
    shares = _share_of(path, raw, names)
    if shares:
        data = _largest_share(path, shares, affine)
        notes = [f"the largest share of {', '.join(other.name for other in _beside(path, shares))} counts"]
        names = _OF_CLASSES[shares]
    else:
        data, notes = _whole(path, raw, names if isinstance(names, str) else None)
    numbers = set(np.unique(data).tolist()) - {0}
    if not numbers:
        raise InputError("labels", "0 everywhere", "a number from 1 on where the head is", path)
    others = dict(others or {})
    if names is None:
        names, said = _guessed(path, data, numbers, others)
        notes += said
    if len(numbers) > _MOST and not isinstance(names, str):
        raise InputError("labels", f"{len(numbers)} different numbers", f"at most {_MOST} regions: is it a scan?", path)
    if isinstance(names, str):
        names = {number: name for number in numbers if (name := region_name(number, names))}
    try:
        return LabelMap(Volume(data, affine), {**names, **others}), tuple(notes)
    except InputError as error:
        raise InputError(error.field, error.value, error.wanted, path) from None


def _values(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """What is in a file, as scaled by its header, and where (4, 4)."""
    file = open_volume(path)
    try:
        raw = np.asanyarray(file.image.dataobj).reshape(file.shape)
    except (OSError, EOFError, ValueError) as error:
        raise InputError("image", f"cut short ({error})", "a whole file", path) from error
    if raw.dtype.kind not in "iufb":
        raise InputError("labels", f"made of {raw.dtype} numbers", "an integer for every voxel", path)
    if raw.dtype.kind == "f":
        raw = fill_nan_background(raw, 0.0)
    if bad := raw.size - int(np.isfinite(raw).sum()):
        raise InputError("labels", f"not a finite number in {bad} voxels", "a number for every voxel, 0 outside", path)
    return raw, file.affine


def _whole(path: Path, raw: np.ndarray, scheme: str | None) -> tuple[np.ndarray, list[str]]:
    """Whole numbers, and in words what was rounded."""
    if raw.min() < 0 or raw.max() > np.iinfo(np.int32).max:
        raise InputError("labels", f"from {raw.min():g} to {raw.max():g}", "numbers from 0 on", path)
    nearest = np.rint(raw)
    off = float(np.abs(raw - nearest).max())
    if off > _OFF and scheme not in _SHARES:
        wanted = "an integer for every voxel, or --names spm, cat or fast for tissues with partial volumes"
        raise InputError("labels", f"not whole numbers, up to {off:.2g} off", wanted, path)
    said = []
    if off > _OFF:
        said = ["partial volumes take the nearest tissue"]
    elif off:
        said = [f"numbers up to {off:.1g} off whole numbers are rounded"]
    return nearest.astype(np.int32), said


def _share_of(path: Path, raw: np.ndarray, names: str | Mapping[int, str] | None) -> str | None:
    """The program of which a file is the share of one tissue, by its name and its values from 0 to 1."""
    if raw.dtype.kind != "f" or raw.min() < 0 or raw.max() > 1 + _OFF or np.abs(raw - np.rint(raw)).max() <= _OFF:
        return None
    for program, pattern in _SHARES.items():
        if names in (None, program) and pattern.fullmatch(path.name):
            return program
    if isinstance(names, str) and names in _SHARES:
        wanted = "c1, c2 and c3 of SPM, p1, p2 and p3 of CAT, or pve_0, pve_1 and pve_2 of FAST, by these names"
        raise InputError("labels", "numbers from 0 to 1, as the share of one tissue", wanted, path)
    return None


def _beside(path: Path, program: str) -> list[Path]:
    """The files of all three shares."""
    found = _SHARES[program].fullmatch(path.name)
    assert found
    return [path.with_name(f"{found['before']}{number}{found['after']}") for number in _CLASSES[program]]


def _largest_share(path: Path, program: str, affine: np.ndarray) -> np.ndarray:
    """1, 2, 3 for the tissue of the largest share, 0 where that of none of them is."""
    shares: list[np.ndarray] = []
    for other in _beside(path, program):
        if not other.exists():
            raise InputError("labels", f"without {other.name}", "the shares of all three tissues side by side", path)
        share, place = _values(other)
        if (shares and share.shape != shares[0].shape) or not np.allclose(place, affine, atol=1e-6):
            raise InputError("labels", f"on other voxels than {path.name}", "three maps on the same voxels", other)
        shares.append(share.astype(np.float32))
    return np.argmax([1 - np.sum(shares, axis=0), *shares], axis=0).astype(np.int32)


def _guessed(
    path: Path, data: np.ndarray, numbers: set[int], others: Mapping[int, str]
) -> tuple[str | Mapping[int, str], list[str]]:
    """Names for numbers that were given none, and whose they are."""
    rest = numbers - set(others)
    if not rest:
        return {}, []
    if known := recognise_scheme(rest):
        return known[0], [f"numbers are taken for those of {known[1]}"]
    for scheme, needed, whose in RECOGNISED:
        odd = unknown_numbers(rest, scheme)
        if needed <= rest and len(odd) <= _STRANGE:
            found = f"numbered as by {whose}, but for {', '.join(map(str, odd))}"
            raise InputError("labels", found, f"names {scheme},{odd[0]}=NAME,… or a name for every number", path)
    if len(numbers) > _SCAN and _rough(data):
        found = f"{len(numbers)} numbers that change from voxel to voxel"
        raise InputError("labels", found, "regions: is it a scan?", path)
    few = ", ".join(map(str, sorted(rest)[:5])) + (", …" if len(rest) > 5 else "")
    if max(rest) <= _TISSUES:
        raise InputError(
            "labels", f"numbered {few} without names", f"--names {scheme_choices(rest)}, or N=NAME,…", path
        )
    named = {number: f"label_{number}" for number in rest}
    return named, [f"numbers {few} have no names, so that no ventricles are known: --names gives them some"]


def _rough(data: np.ndarray) -> bool:
    """Whether most neighbours along the first axis that both have a number have two different ones."""
    one, other = data[:-1], data[1:]
    both = (one > 0) & (other > 0)
    return bool((one != other)[both].mean() > _ROUGH) if both.any() else False
