"""Output folders of commands: checked before the work, and locked until it ends."""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from glob import escape
from pathlib import Path

from ngbrain.errors import InputError

RESULT, REPORT = "result.json", "report.html"
PREVIEW = "preview.html"
MESH = ".vtkhdf"
MAPS = (
    "youngs", "storage", "loss", "mu", "zeta", "phi", "shear_along", "shear_stretch", "magnitude", "phase", "damping_ratio",
    "stiffness", "oss", "oss_snr",
)  # fmt: skip
"""Names of maps (`ngbrain.report.pages.parameters.PARAMETERS`, whose import would take a second; a test compares them)."""
IMAGES = (
    "maps.npz",
    "rounds.json",
    "bids_derivative",
    *(
        f"{name}{end}.{kind}"
        for name in MAPS
        for end in ("", "_low", "_high", "_deviation")
        for kind in ("nii.gz", "json")
    ),
)
OPERATION = "*.vtkhdf", "head.npz", "scene.glb", "*_series.csv"
OF_VERBS = {
    "demo": OPERATION,
    "simulate": OPERATION,
    "invert": IMAGES,
    "predict": IMAGES,
    "calibrate": ("scene.toml", "factors.json"),
    "twin": ("work",),
}
"""Files, beside result and report, that a verb writes or continues from; those of `mesh` depend on its -o."""


def mesh_file(output: Path) -> Path:
    """The mesh file that -o of `mesh` means: of a name with a suffix that file, else `head.vtkhdf` in the folder.

    >>> mesh_file(Path("meshed")).as_posix(), mesh_file(Path("meshed/other.msh")).as_posix()
    ('meshed/head.vtkhdf', 'meshed/other.msh')
    """
    return output if output.suffix and not output.is_dir() else output / f"head{MESH}"


@contextmanager
def reserve_output(arguments: argparse.Namespace) -> Iterator[None]:
    """Make the output folder of a command, and lock it while the command works.

    Raises
    ------
    InputError
        A file of that name exists, or nothing can be written; another command works there; or there are files already that the
        command would replace, and neither --overwrite nor --resume is given.
    """
    output: Path = arguments.output
    folder = output.absolute().parent if arguments.verb == "mesh" else output
    if folder.exists() and not folder.is_dir():
        raise InputError("-o", str(output), "a folder, or a name that is free")
    if not (arguments.overwrite or getattr(arguments, "resume", False) or getattr(arguments, "preview", False)):
        _refuse_replacement(arguments, folder)
    with lock_folder(folder):
        yield


def _refuse_replacement(arguments: argparse.Namespace, folder: Path) -> None:
    """`InputError` where a file is that the command would replace."""
    names = RESULT, REPORT, *(_beside(arguments.output) if arguments.verb == "mesh" else OF_VERBS[arguments.verb])
    found = next((path for name in names for path in sorted(folder.glob(name))), None)
    if found is None:
        return
    results = (folder / RESULT).exists()
    instead = "--resume to continue, " if hasattr(arguments, "resume") else ""
    what = "where results are already" if results else "where a file is already that results would replace"
    wanted = f"{instead}--overwrite to replace {'them' if results else 'it'}, or another folder"
    raise InputError("-o", f"{arguments.output}, {what} ({found})", wanted)


def _beside(mesh: Path) -> tuple[str, ...]:
    """Patterns of the files that belong to a mesh."""
    stem = escape(mesh.name.removesuffix(".gz").rpartition(".")[0])
    ends = "_labels.nii.gz", "_landmarks.mrk.json", "_white.surf.gii", "_pial.surf.gii", "_thickness.shape.gii"
    return escape(mesh.name), *(f"{stem}{end}" for end in ends)


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Make a folder and lock it; raises `InputError` where it cannot be written to or is locked already."""
    made = _make_folders(folder)
    try:
        with _locked(folder):
            yield
    finally:
        for each in made:  # those that are still empty
            try:
                each.rmdir()
            except OSError:
                break


def _make_folders(folder: Path) -> list[Path]:
    """The folders that had to be made, innermost first; raises for one that cannot be written to."""
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as trial:
            trial.write(b"\0")
            trial.flush()
    except OSError as error:
        raise InputError("-o", f"{folder}, where nothing can be written ({error.strerror})", "another place") from error
    return missing


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    try:
        import fcntl
    except ImportError:  # Windows: files are written atomically there too, and the last one wins
        yield
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError("-o", f"{folder}, in which another ngbrain command is running", "another place") from error
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(number)
