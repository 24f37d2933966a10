"""Sample data by name: what the README's examples run on.

Waves, ultrasound, a loaded body and an operation were computed here and are shipped with the truth that an answer can be held to
(`benchmarks/_samples.py` makes them anew). The heads come from other packages.

>>> from ngbrain import datasets
>>> waves = datasets.load_waves("waves_plane")
>>> waves.displacement.shape, waves.noise
((2, 961, 2), 0.02)
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from ngbrain.errors import InputError, nearest
from ngbrain.image.niftifile import write_nifti
from ngbrain.image.volume import Scan, mni152, read_scan
from ngbrain.io.waves import WaveData, read_waves
from ngbrain.io.whole import whole

__all__ = ["DATASETS", "Dataset", "load_head", "load_waves", "write"]

SHIPPED = Path(__file__).with_name("samples")
COLIN27 = tuple(Path(root) / "share/mricron/templates/ch2.nii.gz" for root in ("/usr", "/usr/local"))
"""Where Debian's package mricron-data puts the scan, and where a build of one's own does."""


@dataclass(frozen=True)
class Dataset:
    """One entry of `DATASETS`.

    Attributes
    ----------
    summary : str
        What it is, in a line.
    files : tuple of str
        Names of the files that `write` writes.
    kind : str
        waves (`load_waves`), head (`load_head`), or scene: the files that a verb of the command line takes.
    external_size : int
        Bytes of what another package brings; 0 where the files are shipped.
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
            "shear waves of 60 Hz in a slice of 72 mm with a stiff lump and a soft spot, two loads, 2 % noise",
            ("waves_plane.npz",),
            "waves",
        ),
        "waves_space": Dataset(
            "shear waves of 60 Hz in 39 mm of a block with a stiff lump, two loads, 2 % noise",
            ("waves_space.npz",),
            "waves",
        ),
        "ultrasound": Dataset(
            "axial displacement alone of a pressed square of 40 mm with a lesion three times as stiff, 0.15 % noise",
            ("ultrasound.npz",),
            "waves",
        ),
        "plate": Dataset(
            "a plate pressed into a block of grey matter, and a question, for `ngbrain solve`",
            ("plate.toml",),
            "scene",
        ),
        "retraction": Dataset(
            "a short retraction of an idealised head, and what was seen of it, for `ngbrain retract` and `calibrate`",
            ("retraction.toml", "retraction_landmarks.csv", "retraction_force.csv"),
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
    }
)
"""Name of a data set → what it is."""


def load_waves(name: str) -> WaveData:
    """Load shipped waves or ultrasound, SI units.

    Parameters
    ----------
    name : str
        A data set of the kind waves.

    Returns
    -------
    WaveData
        With its truth and the noise that it was given.

    Raises
    ------
    InputError
        Another name.
    """
    return read_waves(SHIPPED / _named(name, "waves").files[0])


def load_head(name: str) -> Scan:
    """Load the T1 of a head.

    Parameters
    ----------
    name : str
        A data set of the kind head.

    Returns
    -------
    Scan
        Axes right, front, up; voxels of 1 mm.

    Raises
    ------
    InputError
        Another name; the scan is not on this machine, with how to get it.
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
        One of `DATASETS`.
    folder : path, optional
        Where they go; made if it is missing.
    overwrite : bool, optional
        Replace files that are there.

    Returns
    -------
    list of Path
        The files, each of them whole.

    Raises
    ------
    InputError
        Another name; a file that is there already; the scan is not on this machine.
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
                "file", f"{place}, which is there already", "another folder (-o), or --force (overwrite=True)"
            )
    makers = [_maker(name, file) for file in files]
    Path(folder).mkdir(parents=True, exist_ok=True)
    for place, make in zip(places, makers, strict=True):
        make(place)
    return places


def _maker(name: str, file: str) -> Callable[[Path], None]:
    """What writes a file, whole or not at all; what is missing is said before anything is written."""
    if name == "mni152":
        volume = mni152().volume
        return lambda place: write_nifti(place, volume)
    source = _colin27() if name == "colin27" else SHIPPED / file
    return lambda place: whole(place, lambda part: part.write_bytes(source.read_bytes()))


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
