"""Maps of a subject as a derivative dataset of BIDS."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable
from pathlib import Path

from ngbrain.errors import InputError
from ngbrain.io import write_json
from ngbrain.io.versions import versions
from ngbrain.io.waves import WaveData

FOLDER = "bids_derivative"
"""Folder of the dataset in that of the results."""
SUFFIX = "mre"
"""BIDS has no suffix for elastography yet; `.bidsignore` names this one."""
_SUBJECT = re.compile(r"sub-[A-Za-z0-9]+(_ses-[A-Za-z0-9]+)?")
_README = "# Property maps from wave data\n\nWritten by ngbrain. `desc` names the map; units are in the sidecars.\n"


def check_subject(subject: str, data: WaveData) -> None:
    """Check that maps can be written for a subject, before they are computed.

    Parameters
    ----------
    subject : str
        Subject and, optionally, session, as in names of BIDS.
    data : WaveData
        The data that will be inverted.

    Raises
    ------
    InputError
        It is no such name, or the data are not from an image.

    Examples
    --------
    >>> check_subject("patient 7", None)
    Traceback (most recent call last):
    ngbrain.errors.InputError: --bids is 'patient 7'; wanted: sub-LABEL or sub-LABEL_ses-LABEL, of letters and digits
    """
    if not _SUBJECT.fullmatch(subject):
        raise InputError("--bids", repr(subject), "sub-LABEL or sub-LABEL_ses-LABEL, of letters and digits")
    if data.affine is None:
        raise InputError("--bids", "given with data that are no image", "a NIfTI image, or left out")


def write_derivative(folder: Path, maps: Iterable[str], subject: str) -> list[str]:
    """Copy maps NAME.nii.gz and their sidecars into a derivative dataset beside them.

    Parameters
    ----------
    folder : Path
        Folder of the maps; the dataset is `bids_derivative` in it.
    maps : iterable of str
        Names of the maps; `desc` has them without underscores (`storage_low`: `storageLow`).
    subject : str
        As in `check_subject`.

    Returns
    -------
    list of str
        The files, relative to the folder.
    """
    dataset = folder / FOLDER
    place = dataset.joinpath(*subject.split("_"), "anat")
    place.mkdir(parents=True, exist_ok=True)
    software = {"Name": "ngbrain", "Version": versions()["ngbrain"]}
    described = {
        "Name": "Property maps",
        "BIDSVersion": "1.10.0",
        "DatasetType": "derivative",
        "GeneratedBy": [software],
    }
    write_json(dataset / "dataset_description.json", described)
    (dataset / "README.md").write_text(_README, encoding="utf-8")
    (dataset / ".bidsignore").write_text(f"*_{SUFFIX}.nii.gz\n*_{SUFFIX}.json\n", encoding="utf-8")
    files = [dataset / name for name in ("dataset_description.json", "README.md", ".bidsignore")]
    for name in maps:
        first, *rest = name.split("_")
        entity = "".join([first, *(word.capitalize() for word in rest)])
        for kind in (".nii.gz", ".json"):
            files.append(place / f"{subject}_desc-{entity}_{SUFFIX}{kind}")
            shutil.copyfile(folder / f"{name}{kind}", files[-1])
    return [path.relative_to(folder).as_posix() for path in files]
