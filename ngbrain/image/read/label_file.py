"""Read label maps, and identify the scheme of their numbers."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.image_file import fill_nan_background, open_volume
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.label_schemes import (
    RECOGNISED,
    SCHEMES,
    recognise_scheme,
    region_name,
    scheme_choices,
    unknown_numbers,
)
from ngbrain.image.read.volume import Volume

_MOST = 255
"""Maximum number of regions."""
_SCAN, _ROUGH = 64, 0.5
"""A map with more numbers that differ across more than this share of the voxel faces is a scan."""
_STRANGE = 5
"""Maximum number of unknown labels up to which a map is attributed to a scheme with extra regions."""
_TISSUES = 4
"""Numbers up to this mean different tissues in different programs, so that names are required."""
_OFF = 1e-3
"""Tolerance of scaled integers."""
_SHARES = {
    "spm": re.compile(r"(?P<before>[a-z]*c)(?P<class>[123])(?P<after>.+)"),
    "cat": re.compile(r"(?P<before>[a-z]*p)(?P<class>[123])(?P<after>.+)"),
    "fast": re.compile(r"(?P<before>.+_(pve|prob)_)(?P<class>[012])(?P<after>\.nii.*)"),
}
"""File names of tissue probability maps, which are in the same folder."""
_CLASSES = {"spm": "123", "cat": "123", "fast": "012"}
_OF_CLASSES = {"spm": "spm", "cat": "spm", "fast": "fast"}
"""Label scheme of the classes: CAT's p1, p2 and p3 are numbered as SPM's, its p0 is not."""


def read_labels(
    path: str | os.PathLike[str],
    names: str | Mapping[int, str] | None = None,
    others: Mapping[int, str] | None = None,
) -> LabelMap:
    """Read a label map from a NIfTI or MGH file, on its own voxels.

    Parameters
    ----------
    path : str or Path
        Integers, or scaled integers (up to 1e-3 off). With "spm", "cat" or "fast" also partial-volume labels (p0 of CAT), which
        are rounded, or one of three tissue probability maps in the same folder (c1, c2, c3 of SPM, p1, p2, p3 of CAT, pve_0,
        pve_1, pve_2 of FAST), of which the largest wins.
    names : str or mapping, optional
        Number → region, or a key of `ngbrain.image.read.label_schemes.SCHEMES`. By default the scheme is identified from the
        numbers if they can only be those of FreeSurfer, FastSurfer and SynthSeg, or of MUSE; otherwise regions are called
        `label_5`, …, unless all numbers are at most 4, which mean different tissues in different programs.
    others : mapping, optional
        Number → region, in addition to `names` and with priority, for example a lesion drawn into FreeSurfer's map.

    Returns
    -------
    LabelMap

    Raises
    ------
    InputError
        `read_scan` would refuse the file or its affine; numbers are not integers, or negative; there are more than 255 regions,
        or more than 64 that vary between neighbouring voxels as in a scan; all labels are 0; a number has no name.

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
    """Read a label map as `read_labels`, with notes on how the numbers were interpreted.

    Parameters
    ----------
    path, names, others
        As for `read_labels`.

    Returns
    -------
    labels : LabelMap
        The label map.
    notes : tuple of str
        Sentences on rounding and on the identified scheme.
    """
    path = Path(path)
    if isinstance(names, str) and names not in SCHEMES:
        raise InputError("names", repr(names), "number = name for every label, or one of " + ", ".join(SCHEMES))
    raw, affine = _values(path)
    shares = _share_of(path, raw, names)
    if shares:
        data = _largest_share(path, shares, affine)
        notes = [f"the largest share of {', '.join(other.name for other in _probability_maps(path, shares))} counts"]
        names = _OF_CLASSES[shares]
    else:
        data, notes = _to_integers(path, raw, names if isinstance(names, str) else None)
    numbers = set(np.unique(data).tolist()) - {0}
    if not numbers:
        raise InputError("labels", "0 everywhere", "a number from 1 on where the head is", path)
    others = dict(others or {})
    if names is None:
        names, said = _guess_names(path, data, numbers, others)
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
    """Values of a file, scaled as in its header, and its affine (4, 4)."""
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


def _to_integers(path: Path, raw: np.ndarray, scheme: str | None) -> tuple[np.ndarray, list[str]]:
    """Integer labels, and a note on rounding."""
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
    """The program whose tissue probability map a file is, by its name and its values from 0 to 1."""
    if raw.dtype.kind != "f" or raw.min() < 0 or raw.max() > 1 + _OFF or np.abs(raw - np.rint(raw)).max() <= _OFF:
        return None
    for program, pattern in _SHARES.items():
        if names in (None, program) and pattern.fullmatch(path.name):
            return program
    if isinstance(names, str) and names in _SHARES:
        wanted = "c1, c2 and c3 of SPM, p1, p2 and p3 of CAT, or pve_0, pve_1 and pve_2 of FAST, by these names"
        raise InputError("labels", "numbers from 0 to 1, as the share of one tissue", wanted, path)
    return None


def _probability_maps(path: Path, program: str) -> list[Path]:
    """Files of the three probability maps."""
    found = _SHARES[program].fullmatch(path.name)
    assert found
    return [path.with_name(f"{found['before']}{number}{found['after']}") for number in _CLASSES[program]]


def _largest_share(path: Path, program: str, affine: np.ndarray) -> np.ndarray:
    """1, 2, 3 for the most probable tissue, 0 where the outside is more probable."""
    shares: list[np.ndarray] = []
    for other in _probability_maps(path, program):
        if not other.exists():
            raise InputError("labels", f"without {other.name}", "the shares of all three tissues side by side", path)
        share, place = _values(other)
        if (shares and share.shape != shares[0].shape) or not np.allclose(place, affine, atol=1e-6):
            raise InputError("labels", f"on other voxels than {path.name}", "three maps on the same voxels", other)
        shares.append(share.astype(np.float32))
    return np.argmax([1 - np.sum(shares, axis=0), *shares], axis=0).astype(np.int32)


def _guess_names(
    path: Path, data: np.ndarray, numbers: set[int], others: Mapping[int, str]
) -> tuple[str | Mapping[int, str], list[str]]:
    """Names for numbers without given names, and a note on their scheme."""
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
    if len(numbers) > _SCAN and _is_noisy(data):
        found = f"{len(numbers)} numbers that change from voxel to voxel"
        raise InputError("labels", found, "regions: is it a scan?", path)
    few = ", ".join(map(str, sorted(rest)[:5])) + (", …" if len(rest) > 5 else "")
    if max(rest) <= _TISSUES:
        raise InputError(
            "labels", f"numbered {few} without names", f"--names {scheme_choices(rest)}, or N=NAME,…", path
        )
    named = {number: f"label_{number}" for number in rest}
    return named, [f"numbers {few} have no names, so that no ventricles are known: --names gives them some"]


def _is_noisy(data: np.ndarray) -> bool:
    """Whether most neighbours along the first axis that both have a label have different ones."""
    one, other = data[:-1], data[1:]
    both = (one > 0) & (other > 0)
    return bool((one != other)[both].mean() > _ROUGH) if both.any() else False
