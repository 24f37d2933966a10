"""A row of a cohort: computed by its verb in its own folder, and identified by a digest of its inputs."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import tomllib
import traceback
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from ngbrain.cli import ERRORS, EXIT_SOLVER, exit_status, module_of, perform
from ngbrain.cli.options.common import parser
from ngbrain.errors import InputError, SolverError
from ngbrain.io.cache import code_digest
from ngbrain.io.json_file import write_json
from ngbrain.parallel import Callback, TaskLost
from ngbrain.reading import read_json
from ngbrain.workflows.listing import CohortCase

RECORD, LOG, RESULT = "row.json", "log.txt", "result.json"
USABLE, EXCLUDED, FAILED = "usable", "excluded", "failed"
COMPANIONS = (".json", ".img", ".hdr", ".h5")
"""Suffixes of files that belong to a file of the same name: sidecars of images, data of XDMF."""
SIGNS = "ngbrain: "
"""Prefix of the lines of the log."""
BLOCK = 1 << 20


@dataclass(frozen=True)
class Record:
    """State of a row's computation.

    Attributes
    ----------
    digest : str
        Digest of its inputs.
    runs : int
        Number of starts with that digest.
    outcome : str
        usable, excluded (by its verb), failed; empty while it is not finished.
    reason : str
        Why it is excluded or has failed.
    notes : tuple of str
        Warnings of the verb.
    """

    digest: str
    runs: int = 1
    outcome: str = ""
    reason: str = ""
    notes: tuple[str, ...] = ()

    @classmethod
    def read(cls, folder: Path) -> Record | None:
        """The record of a folder; None if there is none that can be read."""
        with suppress(InputError, TypeError, KeyError):
            found = read_json(folder / RECORD, "record")
            return cls(**{**found, "notes": tuple(found["notes"])})
        return None

    def write(self, folder: Path) -> None:
        """Write it atomically into a folder."""
        write_json(folder / RECORD, asdict(self))


def digest_case(case: CohortCase) -> str:
    """Digest of everything that a row's result depends on: files, options, code and versions, but not its name.

    Files are those of the row, their sidecars, and those that a scene or sidecar refers to.
    """
    options = list(case.options)
    for path in case.files:
        options = [text.replace(str(path), path.name) for text in options]
    contents = [[path.name, _sum(path)] for given in case.files for path in _files(given)]
    inputs = [re.sub(r"=.*", "", text) if "=" in text else "" for text in case.inputs]
    made_from = [case.verb, inputs, options, contents, code_digest((module_of(case.verb),))]
    return hashlib.sha256(json.dumps(made_from).encode()).hexdigest()


def run_row(case: CohortCase, folder: str, digest: str, *, callback: Callback) -> Record:
    """Compute a row in its folder, continuing an earlier run with the same digest.

    Parameters
    ----------
    case : CohortCase
    folder : str
        Where results go.
    digest : str
        Of the row, by `digest_case`.
    callback : callable
        Called with the row's name at the start.

    Returns
    -------
    Record
        Also written to the folder, except for failures that may be due to the machine (no memory, a full disk, an unknown error),
        so that the row is computed again next time.
    """
    callback(case.name)
    place = Path(folder)
    before = Record.read(place)
    again = before is not None and before.digest == digest
    arguments = parser().parse_args([*case.argv, "-q", "-o", str(output(case, place))])
    if place.exists() and not again:
        shutil.rmtree(place)
    place.mkdir(parents=True, exist_ok=True)
    arguments.overwrite = True
    if hasattr(arguments, "resume"):
        arguments.resume = again
    if hasattr(
        arguments, "threads"
    ):  # rows run in parallel, each on one thread, which gives the same result in any company
        arguments.threads = 1
    record = Record(digest, runs=before.runs + 1 if before and again else 1)
    record.write(place)
    with open(place / LOG, "w", encoding="utf-8", buffering=1) as log, redirect_stderr(log), redirect_stdout(log):
        error: BaseException | None = None
        try:
            status = perform(arguments)
        except (MemoryError, TaskLost):
            raise
        except ERRORS as wrong:
            error, (status, line) = wrong, exit_status(wrong, arguments)
            print(f"{SIGNS}{line}")
        except Exception as wrong:
            error, status = wrong, EXIT_SOLVER
            traceback.print_exception(wrong)
    notes = tuple(_notes(place / LOG))
    if error is None:
        outcome = EXCLUDED if status else USABLE
        record = replace(record, outcome=outcome, notes=notes, reason=_exclusion_reason(notes) if status else "")
    else:
        known = isinstance(error, ERRORS)
        reason = notes[-1] if known and notes else " ".join(f"{type(error).__name__}: {error}".split())
        record = replace(record, outcome=FAILED, reason=reason, notes=notes[:-1] if known else notes)
    if error is None or isinstance(error, InputError | SolverError):
        record.write(place)
    return record


def output(case: CohortCase, folder: Path) -> Path:
    """The argument -o of a row's verb.

    Parameters
    ----------
    case : CohortCase
    folder : Path

    Returns
    -------
    Path
    """
    return folder / f"{case.name}.vtkhdf" if case.verb == "mesh" else folder


def _notes(log: Path) -> Iterator[str]:
    """Lines that the verb printed, without their prefix."""
    for line in log.read_text(encoding="utf-8").splitlines():
        if line.startswith(SIGNS):
            yield line.removeprefix(SIGNS).removeprefix("warning: ")


def _exclusion_reason(notes: tuple[str, ...]) -> str:
    """Why a verb advises against its answer."""
    said = [note for note in notes if note.startswith("do not use")]
    return "; ".join(said) or (notes[-1] if notes else "its verb advises against using the answer")


def _files(path: Path) -> Iterator[Path]:
    """A file with its companions, or the files of a folder."""
    waiting, found = [path], dict[Path, None]()
    while waiting:
        each = waiting.pop()
        if each in found:
            continue
        if each.is_dir():
            waiting += sorted((inner for inner in each.rglob("*") if inner.is_file()), reverse=True)
            continue
        found[each] = None
        stem = each.name.partition(".")[0]
        waiting += [there for suffix in COMPANIONS if (there := each.with_name(stem + suffix)).is_file()]
        waiting += [there for text in _texts(each) for there in _files_named_in(text, each)]
    yield from found


def _texts(path: Path) -> list[str]:
    """All texts in a scene or sidecar."""
    reads = {".toml": tomllib.loads, ".json": json.loads}
    if path.suffix.lower() not in reads:
        return []
    try:
        waiting: list[Any] = [reads[path.suffix.lower()](path.read_text(encoding="utf-8"))]
    except (ValueError, OSError):  # its verb will say so
        return []
    found = list[str]()
    while waiting:
        each = waiting.pop()
        if isinstance(each, str):
            found.append(each)
        waiting += each.values() if isinstance(each, dict) else each if isinstance(each, list) else []
    return found


def _files_named_in(text: str, by: Path) -> Iterator[Path]:
    """Files that a text may refer to, relative to its file or to the working folder."""
    for folder in (by.parent, Path()):
        with suppress(OSError, ValueError):
            if (there := (folder / text).absolute()).is_file():
                yield there


def _sum(path: Path) -> str:
    state = path.stat()
    return _sum_of(path, state.st_size, state.st_mtime_ns)


@cache
def _sum_of(path: Path, size: int, changed: int) -> str:
    """Digest of a file's bytes, cached for rows that share it."""
    digest = hashlib.sha256()
    with open(path, "rb") as stream:
        while block := stream.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()
