"""Safe reading of data files: sizes are checked before memory is allocated, nothing is executed, and no read blocks."""

from __future__ import annotations

import csv
import io
import json
import os
import stat
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ngbrain.errors import InputError

MOST = 2**30
"""Maximum size (bytes) of a data file, packed and unpacked."""
MOST_TEXT = 2**26
"""Maximum size (bytes) of a text file."""
_PIECE = 1 << 24
"""Chunk size (bytes) of unpacking."""
_HEADER = 1 << 16
"""Maximum size (bytes) of an array's header; NumPy's own have some hundreds."""


def read_bytes(path: str | os.PathLike[str], what: str, most: int = MOST) -> bytes:
    """Read the bytes of a regular file.

    Parameters
    ----------
    path : str or Path
        A file; devices and pipes are refused, as they may have no end.
    what : str
        Name of the content, for messages.
    most : int, optional
        Maximum size (bytes).

    Returns
    -------
    bytes

    Raises
    ------
    InputError
        The file does not exist, is not regular, cannot be read, or is too large.

    Examples
    --------
    >>> read_bytes("/dev/null", "scene")
    Traceback (most recent call last):
    ngbrain.errors.InputError: /dev/null: scene is no regular file; wanted: a file on disk
    """
    path = Path(path)
    try:
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (OSError, ValueError) as error:
        found = "missing" if isinstance(error, FileNotFoundError) else f"unreadable ({_reason(error)})"
        raise InputError(what, found, "a file on disk", path) from error
    try:
        with os.fdopen(number, "rb") as stream:
            _regular(os.fstat(stream.fileno()), what, most, path)
            return stream.read(most + 1)
    except OSError as error:
        raise InputError(what, f"unreadable ({_reason(error)})", "a file on disk", path) from error


def check_regular(path: str | os.PathLike[str], what: str, most: int = MOST) -> None:
    """Check that a file can be read by `read_bytes`, without reading it.

    Parameters
    ----------
    path : str or Path
        The file.
    what : str
        Name of the content, for messages.
    most : int, optional
        Maximum size (bytes).

    Raises
    ------
    InputError
        The file does not exist, is not regular, or is too large.
    """
    path = Path(path)
    try:
        state = path.stat()
    except (OSError, ValueError) as error:
        found = "missing" if isinstance(error, FileNotFoundError) else f"unreadable ({_reason(error)})"
        raise InputError(what, found, "a file on disk", path) from error
    _regular(state, what, most, path)


def read_text(path: str | os.PathLike[str], what: str, most: int = MOST_TEXT) -> str:
    """Read a text file in UTF-8, or in UTF-16 with a byte-order mark.

    Parameters
    ----------
    path : str or Path
        The file.
    what : str
        Name of the content, for messages.
    most : int, optional
        Maximum size (bytes).

    Returns
    -------
    str

    Raises
    ------
    InputError
        `read_bytes` refuses the file, or it has another encoding.
    """
    path = Path(path)
    raw = read_bytes(path, what, most)
    encoding = "utf-16" if raw.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise InputError(
            what, f"not {encoding[:6].upper().rstrip('-')} in line {line}", "text saved as UTF-8", path
        ) from error


def read_json(path: str | os.PathLike[str], what: str) -> Any:
    """Read a JSON file.

    Parameters
    ----------
    path : str or Path
        The file.
    what : str
        Name of the content, for messages.

    Returns
    -------
    object

    Raises
    ------
    InputError
        `read_text` refuses the file, or it is not JSON.
    """
    text = read_text(path, what)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(what, f"damaged ({error})", "a JSON file", Path(path)) from error


class Table(NamedTuple):
    """A table of text cells.

    Parameters
    ----------
    columns : list of str
        Column names of the header line, stripped.
    rows : list of (int, list of str)
        Line number in the file, from 1, and the cells, one per column; empty lines are left out.
    mark : str
        The delimiter: comma, semicolon (as spreadsheets write it where the comma is the decimal sign) or tab.
    """

    columns: list[str]
    rows: list[tuple[int, list[str]]]
    mark: str


def read_table(path: str | os.PathLike[str], what: str) -> Table:
    """Read a CSV table as spreadsheets write it; lines before the header that begin with # are comments.

    Parameters
    ----------
    path : str or Path
        The file.
    what : str
        Name of the content, for messages.

    Returns
    -------
    Table

    Raises
    ------
    InputError
        `read_text` refuses the file; a line has more cells than there are columns, or an unclosed quote.
    """
    path = Path(path)
    lines, first = read_text(path, what).splitlines(keepends=True), 0
    while first < len(lines) and (lines[first].startswith("#") or not lines[first].strip(" \t\r\n,;")):
        first += 1
    head = lines[first] if first < len(lines) else ""
    mark = ";" if ";" in head else "\t" if "\t" in head and "," not in head else ","
    reader = csv.reader(lines[first:], delimiter=mark, skipinitialspace=True, strict=True)
    rows = list[tuple[int, list[str]]]()
    try:
        columns = [name.strip() for name in next(reader, [])]
        for cells in reader:
            line = first + reader.line_num
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) > len(columns):
                found = f"{len(cells)} cells: {mark.join(cells)[:60]!r}"
                wanted = f"{len(columns)}, one for each column, decimals with a point"
                raise InputError(f"line {line}", found, wanted, path)
            rows.append((line, cells + [""] * (len(columns) - len(cells))))
    except csv.Error as error:
        found = f"unreadable ({error})"
        raise InputError(f"line {first + reader.line_num}", found, "a table (CSV)", path) from error
    return Table(columns, rows, mark)


def read_npz(path: str | os.PathLike[str], what: str, most: int = MOST) -> dict[str, np.ndarray]:
    """Read a NumPy archive of plain arrays; nothing is unpickled.

    Parameters
    ----------
    path : str or Path
        The .npz file.
    what : str
        Name of the content, for messages.
    most : int, optional
        Maximum size (bytes), packed and unpacked.

    Returns
    -------
    dict of numpy.ndarray
        Arrays by name.

    Raises
    ------
    InputError
        `read_bytes` refuses the file; the archive is damaged, unpacks to more than `most` bytes, or contains Python objects.
    """
    check_regular(path, what, most)
    return npz_arrays(Path(path).read_bytes(), what, path, most)


def npz_arrays(raw: bytes, what: str, path: str | os.PathLike[str], most: int = MOST) -> dict[str, np.ndarray]:
    """Arrays of a NumPy archive in memory, as `read_npz`.

    Parameters
    ----------
    raw : bytes
        The archive.
    what : str
        Name of the content, for messages.
    path : str or Path
        Its file, for messages.
    most : int, optional
        Maximum unpacked size (bytes).

    Returns
    -------
    dict of numpy.ndarray
        Arrays by name.

    Raises
    ------
    InputError
        The archive is damaged, too large, or contains Python objects.
    """
    path = Path(path)
    if not raw.startswith(b"PK"):
        found = "one array" if raw.startswith(b"\x93NUMPY") else "damaged, or no archive"
        raise InputError(what, found, "a whole archive of arrays, as numpy.savez writes it", path)
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            members = archive.infolist()
            check_size(sum(member.file_size for member in members), what, most, path, "one that unpacks to")
            return {member.filename.removesuffix(".npy"): _array(archive, member, what, path) for member in members}
    except InputError:
        raise
    except zipfile.BadZipFile as error:
        wanted = "a whole archive of arrays, as numpy.savez writes it"
        raise InputError(what, "damaged, or no archive", wanted, path) from error
    except Exception as error:  # damaged bytes make zipfile and NumPy raise many kinds of exception
        wanted = "a whole archive of plain arrays, without pickles"
        raise InputError(what, f"unreadable ({type(error).__name__}: {error})", wanted, path) from error


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, what: str, path: Path) -> np.ndarray:
    name = member.filename.removesuffix(".npy")
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
        if read is not None:
            shape, _, dtype = read(stream, max_header_size=_HEADER)
            if dtype.hasobject:
                raise InputError(name, "made of Python objects", "a plain array, without pickles", path)
            needed = dtype.itemsize * int(np.prod(shape, dtype=object))
            if needed > member.file_size:
                raise InputError(
                    what, f"damaged: {name} has {member.file_size} of {needed} bytes", "a whole file", path
                )
    with archive.open(member) as stream:
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False, max_header_size=_HEADER))


def unzip(raw: bytes, what: str, path: str | os.PathLike[str], most: int = MOST) -> bytes:
    """Unpack the only file of a ZIP archive; files that macOS adds are ignored.

    Parameters
    ----------
    raw : bytes
        The archive.
    what : str
        Name of the content, for messages.
    path : str or Path
        Its file, for messages.
    most : int, optional
        Maximum unpacked size (bytes).

    Returns
    -------
    bytes

    Raises
    ------
    InputError
        The archive is damaged, too large, or has another number of files.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            members = [each for each in archive.infolist() if not each.is_dir()]
            members = [each for each in members if not each.filename.startswith("__MACOSX/")]
            if len(members) != 1:
                raise InputError(what, f"a ZIP archive of {len(members)} files", "one file, or an archive of one", path)
            check_size(members[0].file_size, what, most, path, "one that unpacks to")
            return archive.read(members[0])
    except InputError:
        raise
    except Exception as error:  # damaged bytes make zipfile raise many kinds of exception
        raise InputError(what, f"unreadable ({type(error).__name__}: {error})", "a whole archive", path) from error


def gunzip(raw: bytes, what: str, path: str | os.PathLike[str], most: int = MOST) -> bytearray:
    """Unpack gzip data and verify their checksums.

    Parameters
    ----------
    raw : bytes
        The packed data.
    what : str
        Name of the content, for messages.
    path : str or Path
        Their file, for messages.
    most : int, optional
        Maximum unpacked size (bytes).

    Returns
    -------
    bytearray

    Raises
    ------
    InputError
        The data are damaged, or unpack to more than `most` bytes.
    """
    path, size = Path(path), 0
    for piece in _pieces(raw, what, path):  # the size is known before memory is allocated
        size += len(piece)
        check_size(size, what, most, path, "one that unpacks to at least")
    unpacked, at = bytearray(size), 0
    for piece in _pieces(raw, what, path):
        unpacked[at : at + len(piece)] = piece
        at += len(piece)
    return unpacked


def _pieces(raw: bytes, what: str, path: Path) -> Iterator[bytes]:
    left = raw
    while left:
        unpacker = zlib.decompressobj(wbits=31)
        try:
            yield unpacker.decompress(left, _PIECE)
            while unpacker.unconsumed_tail:
                yield unpacker.decompress(unpacker.unconsumed_tail, _PIECE)
            yield unpacker.flush()
        except zlib.error as error:
            raise InputError(what, f"unreadable ({error})", "a whole file", path) from error
        if not unpacker.eof:
            raise InputError(what, "unreadable (its compressed part ends early)", "a whole file", path)
        left = unpacker.unused_data.lstrip(b"\0")
        if left and not left.startswith(b"\x1f\x8b"):
            raise InputError(what, "unreadable (something else follows its compressed part)", "a whole file", path)


def _regular(state: os.stat_result, what: str, most: int, path: Path) -> None:
    if not stat.S_ISREG(state.st_mode):
        kind = "a folder" if stat.S_ISDIR(state.st_mode) else "no regular file"
        raise InputError(what, kind, "a file on disk", path)
    check_size(state.st_size, what, most, path)


def check_size(size: int, what: str, most: int, path: Path, how: str = "a file of") -> None:
    """Check a size.

    Parameters
    ----------
    size : int
        The size (bytes).
    what : str
        Name of the content, for messages.
    most : int
        Maximum size (bytes).
    path : Path
        The file, for messages.
    how : str, optional
        Description of the size, for messages.

    Raises
    ------
    InputError
        The size exceeds the maximum.
    """
    if size > most:
        raise InputError(what, f"{how} {size:,} bytes", f"at most {most:,} bytes", path)


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
