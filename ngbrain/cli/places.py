"""Output folders of commands: checked before the work, and locked until it ends."""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ngbrain.errors import InputError

RESULT = "result.json"
"""The file whose presence marks a folder with results."""


@contextmanager
def reserve_output(arguments: argparse.Namespace) -> Iterator[None]:
    """Make the output folder of a command, and lock it while the command works.

    Raises
    ------
    InputError
        A file of that name exists, or nothing can be written; another command works there; or there are results already and neither
        --force nor --resume is given.
    """
    output: Path = arguments.output
    is_file = arguments.verb == "mesh"
    if is_file and output.is_dir():
        raise InputError("-o", str(output), "a file, not a folder")
    folder = output.absolute().parent if is_file else output
    if folder.exists() and not folder.is_dir():
        raise InputError("-o", str(output), "a folder, or a name that is free")
    if (folder / RESULT).exists() and not (arguments.overwrite or getattr(arguments, "resume", False)):
        instead = "--resume to continue, " if hasattr(arguments, "resume") else ""
        option = "--overwrite" if arguments.verb == "calibrate" else "--force"
        wanted = f"{instead}{option} to replace them, or another {'folder' if not is_file else 'place'}"
        raise InputError("-o", f"{output}, where results are already ({folder / RESULT})", wanted)
    with lock_folder(folder):
        yield


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
