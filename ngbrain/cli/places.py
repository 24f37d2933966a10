"""Where the results of a command go: looked at before the work begins, and kept from others until it ends."""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ngbrain.errors import InputError

RESULT = "result.json"
"""What says that a folder has results in it."""


@contextmanager
def reserve_output(arguments: argparse.Namespace) -> Iterator[None]:
    """Make the folder that results go to, and keep it from other commands while this one works.

    Raises
    ------
    InputError
        There is a file of that name, or none can be written there; another command writes there; or it has results already and
        neither --force nor --resume is given.
    """
    output: Path = arguments.output
    is_file = arguments.verb == "mesh"
    if is_file and output.is_dir():
        raise InputError("-o", str(output), "a file, not a folder")
    folder = output.absolute().parent if is_file else output
    if folder.exists() and not folder.is_dir():
        raise InputError("-o", str(output), "a folder, or a name that is free")
    if (folder / RESULT).exists() and not (arguments.overwrite or getattr(arguments, "resume", False)):
        instead = "--resume to go on, " if hasattr(arguments, "resume") else ""
        option = "--overwrite" if arguments.verb == "calibrate" else "--force"
        wanted = f"{instead}{option} to replace them, or another {'folder' if not is_file else 'place'}"
        raise InputError("-o", f"{output}, where results are already ({folder / RESULT})", wanted)
    with lock_folder(folder):
        yield


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Make a folder, and keep it from other commands; raises `InputError` where it cannot be written to or is held already."""
    made = _made(folder)
    try:
        with _alone(folder):
            yield
    finally:
        for each in made:  # what nothing was written to
            try:
                each.rmdir()
            except OSError:
                break


def _made(folder: Path) -> list[Path]:
    """The folders that had to be made, the innermost first; one that cannot be written to is refused."""
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
def _alone(folder: Path) -> Iterator[None]:
    try:
        import fcntl
    except ImportError:  # Windows: files are whole there too, the last one stays
        yield
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError("-o", f"{folder}, where another ngbrain is at work", "another place") from error
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(number)
