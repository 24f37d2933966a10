"""The list of a cohort: a table with a row for each scan or case, checked before the computation."""

from __future__ import annotations

import argparse
import io
import re
from collections.abc import Mapping
from contextlib import redirect_stderr
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from ngbrain.cli.options.cohort import VERBS, columns_of, is_path, several_inputs
from ngbrain.cli.options.common import parsers
from ngbrain.errors import InputError, nearest
from ngbrain.look import BriefText
from ngbrain.progress import LOG
from ngbrain.reading import Table, read_table

NAME, VERB, INPUT = "name", "verb", "input"
FREE = "about_"
"""Prefix of a column that is not an option."""
PART = "|"
"""Separator between several values in a cell."""
YES, NO = ("yes", "true", "1", "x"), ("no", "false", "0")
MOST_NAME, SHOWN = 100, 20
"""Largest length of a name; largest number of faults that are shown."""
CLOSE = 0.8
"""Similarity above which a column counts as a misspelt option."""
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+")


@dataclass(frozen=True, repr=False)
class CohortCase(BriefText):
    """A row of the list.

    Attributes
    ----------
    name : str
        Name of the row and of its folder.
    verb : str
        mesh, invert, predict or simulate.
    inputs : tuple of str
        Absolute paths; a surface may have the prefix NAME=.
    options : tuple of str
        As on the command line, with absolute paths.
    about : dict
        The other columns, by name.
    files : tuple of Path
        All files and folders of the row.
    """

    name: str
    verb: str
    inputs: tuple[str, ...]
    options: tuple[str, ...]
    about: dict[str, str]
    files: tuple[Path, ...]

    @property
    def argv(self) -> list[str]:
        """The command line, without the output."""
        return [self.verb, *self.inputs, *self.options]


def read_list(path: str | Path, verb: str | None = None) -> list[CohortCase]:
    """Read the rows of a list; nothing is computed.

    Parameters
    ----------
    path : str or Path
        A table (CSV) with the columns name, input and, unless `verb` is given, verb; further columns are options or free.
    verb : str, optional
        Verb of rows that name none.

    Returns
    -------
    list of CohortCase

    Raises
    ------
    InputError
        A column is missing, repeated or a misspelt option; or in some row a file is missing, a name is repeated or invalid as a
        folder name, or an option is not accepted by the verb. Several faults are all logged.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     there = Path(folder) / "waves.npz"
    ...     _ = there.write_bytes(b"")
    ...     table = Path(folder) / "list.csv"
    ...     _ = table.write_text("name,input,noise,age\\none,waves.npz,0.02,40\\n")
    ...     (case,) = read_list(table, "invert")
    >>> case.name, case.verb, case.options, case.about
    ('one', 'invert', ('--noise=0.02',), {'age': '40'})
    """
    path = Path(path)
    table = read_table(path, "list")
    if not table.rows:
        raise InputError("list", "without a row", "a row for each scan or case", path)
    reader = _Reader(path, table, verb)
    cases, faults = list[CohortCase](), list[InputError]()
    for line, cells in table.rows:
        try:
            cases.append(reader.case(line, cells))
        except InputError as error:
            faults.append(error)
    if faults:
        for fault in faults[: SHOWN - 1][: len(faults) - 1]:
            LOG.error("%s", fault)
        if len(faults) > SHOWN:
            LOG.error("%d more faults of this kind", len(faults) - SHOWN)
        raise faults[-1]
    return cases


class _Reader:
    """Makes cases from the rows of a table."""

    def __init__(self, path: Path, table: Table, verb: str | None) -> None:
        self._path, self._table, self._verb = path, table, verb
        self._parsers = parsers()
        self._names = dict[str, int]()
        columns = [self._option_name(name) for name in table.columns]
        if twice := sorted({name for name in columns if name and columns.count(name) > 1}):
            raise InputError("columns", f"there twice ({', '.join(twice)})", "each of them once", path)
        needed = (NAME, INPUT) if verb else (NAME, VERB, INPUT)
        if absent := [name for name in needed if name not in columns]:
            besides = ", or --verb for all rows" if absent == [VERB] else ""
            found = ", ".join(table.columns)[:200] or "none"
            raise InputError("columns", found, f"{', '.join(needed)}{besides}: {absent[0]} is missing", path)
        self._columns = columns
        used = {verb} | {cells[columns.index(VERB)].strip() for _, cells in table.rows if VERB in columns}
        self._options = {each: columns_of(self._parsers[each]) for each in VERBS if each in used}
        known = {name for options in self._options.values() for name in options}
        self._own = [name for name in columns if name and name not in {*known, NAME, VERB, INPUT}]
        for name in self._own:
            close = get_close_matches(name, [*known, NAME, VERB, INPUT], n=1, cutoff=CLOSE)
            if close and not name.startswith(FREE):
                wanted = f"{close[0]}, if that is meant; a column of your own that is called so begins with {FREE}"
                raise InputError("column", repr(name), wanted, path)

    @staticmethod
    def _option_name(column: str) -> str:
        """A column's name as an option: `By_Label` and `--by-label` are by-label."""
        name = column.strip()
        return name if name.startswith(FREE) else name.lstrip("-").replace("_", "-").replace(" ", "-").lower()

    def case(self, line: int, cells: list[str]) -> CohortCase:
        values = {name: cell.strip() for name, cell in zip(self._columns, cells, strict=True)}
        name = self._check_name(line, values[NAME])
        verb = values.get(VERB) or self._verb or ""
        if verb not in self._options:
            raise self._fault(line, name, VERB, repr(verb) if verb else "missing", nearest(verb, VERBS))
        if values.get(""):
            raise self._fault(
                line, name, "a column without a name", repr(values[""][:60]), "its name in the first line"
            )
        parser, taken = self._parsers[verb], self._options[verb]
        inputs, files = self._inputs(line, name, values[INPUT], several_inputs(parser))
        options = list[str]()
        for column, value in values.items():
            if not value or column in (NAME, VERB, INPUT) or column in self._own:
                continue
            if column not in taken:
                wanted = f"an empty cell: {verb} has no such option"
                raise self._fault(line, name, column, repr(value[:60]), wanted)
            given = self._arguments(line, name, column, taken[column], value)
            if is_path(taken[column]):
                files.append(self._find_file(line, name, column, value))
                given = [f"--{column}={files[-1]}"]
            if said := self._parser_error(parser, [verb, *inputs, *given]):
                own = f"; a column of your own that is called so begins with {FREE}"
                raise self._fault(line, name, column, repr(value[:60]), said + own)
            options += given
        if said := self._parser_error(parser, [verb, *inputs, *options]):
            raise self._fault(line, name, "options", " ".join(options) or "none", said)
        about = {self._shown(each): values[each] for each in self._own}
        return CohortCase(name, verb, inputs, tuple(options), about, tuple(files))

    def _shown(self, column: str) -> str:
        """The original name of a free column, without its prefix."""
        return self._table.columns[self._columns.index(column)].removeprefix(FREE)

    def _check_name(self, line: int, name: str) -> str:
        if not re.fullmatch(rf"\w[\w.-]{{0,{MOST_NAME - 1}}}", name):
            wanted = f"at most {MOST_NAME} letters, digits, . - _, as it names a folder"
            raise self._fault(line, "", NAME, repr(name[: 2 * MOST_NAME]) if name else "missing", wanted)
        if name.casefold() in self._names:
            found = f"{name!r}, as in line {self._names[name.casefold()]}"
            raise self._fault(line, "", NAME, found, "a name of its own for each row, small letters or large")
        self._names[name.casefold()] = line
        return name

    def _inputs(self, line: int, name: str, cell: str, several: bool) -> tuple[tuple[str, ...], list[Path]]:
        parts = [part.strip() for part in cell.split(PART)] if several else [cell]
        given, files = list[str](), list[Path]()
        for part in parts:
            called, equals, file = part.partition("=")
            plain = not (several and equals and called) or (self._path.parent / part).exists()
            files.append(self._find_file(line, name, INPUT, part if plain else file))
            given.append(str(files[-1]) if plain else f"{called}={files[-1]}")
        return tuple(given), files

    def _find_file(self, line: int, name: str, column: str, text: str) -> Path:
        """A file or folder, relative to the list."""
        if not text:
            raise self._fault(line, name, column, "missing", "a file, relative to the list")
        found = self._path.absolute().parent / Path(text).expanduser()
        if not found.exists():
            raise self._fault(line, name, column, f"{text[:200]!r}, which is missing", "a file, relative to the list")
        return found

    def _arguments(self, line: int, name: str, column: str, action: argparse.Action, value: str) -> list[str]:
        """The command-line arguments of a cell."""
        if action.nargs == 0:
            if value.lower() in YES:
                return [f"--{column}"]
            if value.lower() not in NO:
                raise self._fault(line, name, column, repr(value[:60]), "yes, no or an empty cell")
            return [f"--no-{column}"] if f"--no-{column}" in action.option_strings else []
        if self._table.mark == ";" and action.type is not None and DECIMAL_COMMA.fullmatch(value):
            value = value.replace(",", ".")
        several = isinstance(action.default, list)
        return [f"--{column}={part.strip()}" for part in (value.split(PART) if several else [value])]

    @staticmethod
    def _parser_error(parser: argparse.ArgumentParser, argv: list[str]) -> str:
        """Error message of the verb's parser for a command; empty if it is accepted."""
        said = io.StringIO()
        try:
            with redirect_stderr(said):
                parser.parse_args(argv[1:])
        except SystemExit:
            return said.getvalue().partition(": ")[2].partition("; see ")[0].strip() or "what the verb takes"
        return ""

    def _fault(self, line: int, name: str, column: str, value: str, wanted: str) -> InputError:
        where = f"line {line} ({name}), {column}" if name else f"line {line}, {column}"
        return InputError(where, value, wanted, self._path)


def values_of(cases: list[CohortCase], column: str) -> Mapping[str, str]:
    """Values of a free column.

    Parameters
    ----------
    cases : list of CohortCase
    column : str

    Returns
    -------
    mapping of str
        Row → value, empty where the cell is empty.

    Raises
    ------
    InputError
        There is no such column.
    """
    known = list(cases[0].about)
    if column not in known:
        raise InputError("group", repr(column), f"a column of one's own: {', '.join(known) or 'there is none'}")
    return {case.name: case.about[column] for case in cases}
