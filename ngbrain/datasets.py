"""Sample data by name, used by the examples of the README.

Waves, ultrasound, a loaded body and an operation are synthetic and shipped with the true parameters (`benchmarks/_samples.py`
computes them again). The heads come from other packages, the stiffness maps from their authors' repository.

>>> from ngbrain import datasets
>>> waves = datasets.load_waves("waves_plane")
>>> waves.displacement.shape, waves.noise
((2, 961, 2), 0.02)
"""

from __future__ import annotations

import hashlib
import os
import urllib.request
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, nearest
from ngbrain.image.read.image_file import read_scan
from ngbrain.image.read.nifti import write_nifti
from ngbrain.image.read.template import mni152
from ngbrain.image.read.volume import Scan
from ngbrain.io.waves import WaveData, read_waves

__all__ = ["DATASETS", "Dataset", "load_head", "load_waves", "write"]

SHIPPED = Path(__file__).with_name("samples")
COLIN27 = tuple(Path(root) / "share/mricron/templates/ch2.nii.gz" for root in ("/usr", "/usr/local"))
"""Paths of the scan: Debian's package mricron-data, and a local build of MRIcron."""


MRE134 = "https://github.com/mechneurolab/MRE134/raw/befbe5b3596fe46cb00fc829df34747388a88737"
"""Address of the stiffness maps of 134 adults, at a fixed commit."""
SHA256 = {
    "MRE134_Stiffness3D.nii.zip": "360cecd1123649bde20fa04c1afbf2b4087d90dc213b21076bb4e64746602d02",
    "MRE134_Damping3D.nii.zip": "b621f85237db3fecc5bed4c550d7819e2e60c62f858ff5cdad0a02aca72e091a",
}
"""SHA-256 checksum of every downloaded file."""
PATIENCE, MOST = 60, 2**24
"""Time-out (s) and maximum size (bytes) of a download."""


@dataclass(frozen=True)
class Dataset:
    """Description of a data set, the values of `DATASETS`.

    Parameters
    ----------
    summary : str
        One-line description.
    files : tuple of str
        Names of the files that `write` writes.
    kind : str
        "waves" (for `load_waves`), "head" (`load_head`), "maps" (`ngbrain.inverse.data.stiffness_maps.read_stiffness`), or
        "scene": input files of a command.
    external_size : int, optional
        Bytes that come from another package or the network; 0 where the files are shipped.
    """

    summary: str
    files: tuple[str, ...]
    kind: str
    external_size: int = 0

    @property
    def size(self) -> int:
        """Bytes of the files."""
        return self.external_size or sum((SHIPPED / name).stat().st_size for name in self.files)


DATASETS: Mapping[str, Dataset] = MappingProxyType(
    {
        "waves_plane": Dataset(
            "shear waves of 60 Hz in a slice of 72 mm with a stiff and a soft inclusion, two loads, 2 % noise",
            ("waves_plane.npz",),
            "waves",
        ),
        "waves_space": Dataset(
            "shear waves of 60 Hz in a block of 39 mm with a stiff inclusion, two loads, 2 % noise",
            ("waves_space.npz",),
            "waves",
        ),
        "ultrasound": Dataset(
            "axial displacement of a compressed 40 mm square with a lesion three times as stiff, 0.15 % noise",
            ("ultrasound.npz",),
            "waves",
        ),
        "plate": Dataset(
            "a plate pressed into a block of grey matter, with one requested quantity, for `ngbrain simulate`",
            ("plate.toml",),
            "scene",
        ),
        "cohort": Dataset(
            "a list of the samples mni152, waves_plane and plate, for `ngbrain cohort`",
            ("cohort.csv",),
            "scene",
        ),
        "retraction": Dataset(
            "a short retraction of an idealised head, and measurements of it, for `ngbrain simulate` and `calibrate`",
            ("retraction.toml", "retraction_landmarks.csv", "retraction_force.csv"),
            "scene",
        ),
        "twin": Dataset(
            "a patient with a map of stiffness and two surgical plans on an idealised head, for `ngbrain twin`",
            ("twin.toml", "norm_brain.toml", "retraction.toml", "twin_stiffness.nii.gz", "twin_stiffness_sd.nii.gz"),
            "scene",
        ),
        "mni152": Dataset(
            "T1 of the MNI152 template, the average of 152 people without skull, 1 mm, as nilearn ships it",
            ("mni152_t1.nii.gz",),
            "head",
            2_760_000,
        ),
        "colin27": Dataset(
            "T1 of one head with its skull, 1 mm, averaged over 27 scans; from Debian's package mricron-data",
            ("colin27_t1.nii.gz",),
            "head",
            3_510_351,
        ),
        "mre134": Dataset(
            "mean shear stiffness and damping ratio of 134 adults' brains at 50 Hz in MNI space (Hiscox 2020), from GitHub",
            tuple(SHA256),
            "maps",
            1_549_848,
        ),
    }
)
"""Name of a data set → its description."""


def load_waves(name: str) -> WaveData:
    """Load shipped wave or ultrasound data, in SI units.

    Parameters
    ----------
    name : str
        A data set of kind "waves".

    Returns
    -------
    WaveData
        With the true parameters and the level of the added noise.

    Raises
    ------
    InputError
        The name is unknown.
    """
    return read_waves(SHIPPED / _named(name, "waves").files[0])


def load_head(name: str) -> Scan:
    """Load the T1 scan of a head.

    Parameters
    ----------
    name : str
        A data set of kind "head".

    Returns
    -------
    Scan
        Axes right, front, up (RAS); voxels of 1 mm.

    Raises
    ------
    InputError
        The name is unknown, or the scan is not installed; the message says how to get it.
    MissingExtra
        nilearn or nibabel is not installed.
    """
    _named(name, "head")
    return mni152() if name == "mni152" else read_scan(_colin27())


def write(name: str, folder: str | os.PathLike[str] = ".", overwrite: bool = False) -> list[Path]:
    """Write the files of a data set.

    Parameters
    ----------
    name : str
        A key of `DATASETS`.
    folder : path, optional
        Output folder; created if it does not exist.
    overwrite : bool, optional
        Whether existing files are replaced.

    Returns
    -------
    list of Path
        The files, each written atomically.

    Raises
    ------
    InputError
        The name is unknown; a file exists; the scan is not installed; the maps cannot be downloaded, or their checksum differs
        from the published one.
    MissingExtra
        nilearn or nibabel is not installed.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in write("ultrasound", folder)]
    ['ultrasound.npz']
    """
    files = _named(name).files
    places = [Path(folder) / file for file in files]
    for place in places:
        if place.exists() and not overwrite:
            raise InputError(
                "file", f"{place}, which is there already", "another folder (-o), or --overwrite (overwrite=True)"
            )
    makers = [_maker(name, file) for file in files]
    Path(folder).mkdir(parents=True, exist_ok=True)
    for place, make in zip(places, makers, strict=True):
        make(place)
    return places


def _maker(name: str, file: str) -> Callable[[Path], None]:
    """Function that writes a file atomically; missing sources are reported before anything is written."""
    if name == "mni152":
        volume = mni152().volume
        return lambda place: write_nifti(place, volume)
    if file in SHA256:
        raw = _fetched(file)
        return lambda place: atomic_write(place, lambda part: part.write_bytes(raw))
    source = _colin27() if name == "colin27" else SHIPPED / file
    return lambda place: atomic_write(place, lambda part: part.write_bytes(source.read_bytes()))


def _fetched(file: str) -> bytes:
    """Download a file of `SHA256` and verify its checksum."""
    url = f"{MRE134}/{file}"
    try:
        with urllib.request.urlopen(url, timeout=PATIENCE) as answer:
            raw = bytes(answer.read(MOST))
    except (OSError, ValueError) as error:  # URLError is an OSError
        reason = getattr(error, "reason", error)
        wanted = "a network connection, or the file downloaded by hand: its reader accepts any path"
        raise InputError(file, f"not available from {url} ({reason})", wanted) from error
    if (found := hashlib.sha256(raw).hexdigest()) != SHA256[file]:
        wanted = f"{SHA256[file][:12]}…, the published file"
        raise InputError(file, f"of SHA-256 {found[:12]}… as fetched from {url}", wanted)
    return raw


def _colin27() -> Path:
    for path in COLIN27:
        if path.is_file():
            return path
    wanted = f"{COLIN27[0]}: apt install mricron-data, or give MRIcron's ch2.nii.gz itself to `ngbrain mesh`"
    raise InputError("colin27", "not on this machine", wanted)


def _named(name: str, kind: str | None = None) -> Dataset:
    known = [each for each, dataset in DATASETS.items() if kind in (None, dataset.kind)]
    if name not in known:
        raise InputError("data set", repr(name), nearest(name, known))
    return DATASETS[name]
