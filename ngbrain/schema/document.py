"""TOML documents of checked sections: keys, units, conversion to SI, reading and writing.

A section of a scene is a frozen dataclass derived from `Section`; its fields are made by the functions of
`ngbrain.schema.fields`. Each field holds its description (`Entry`); reading, writing, checking and messages follow from it. A
file goes through `read_toml` → `Section.read` → `Entry.read` to SI units, and back through `Entry.show` → `Section.to_dict` →
`to_toml`.

>>> from ngbrain.schema.fields import number
>>> @dataclass(frozen=True, kw_only=True)
... class Needle(Section):
...     length: float = number("length_mm", 0.05)
>>> Needle.read({"length_mm": 80}, "needle").length, Needle().to_dict()
(0.08, {'length_mm': 50.0})
>>> Needle(length=-0.08)
Traceback (most recent call last):
ngbrain.errors.InputError: needle.length_mm is -80.0; wanted: a length in mm greater than 0
"""

from __future__ import annotations

import json
import re
import reprlib
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, Self

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, nearest
from ngbrain.reading import read_text
from ngbrain.schema.formulas import Formula

UNITS = {
    "mm": (1000, "length in mm"),
    "m_s2": (1, "acceleration in m/s²"),
    "Hz": (1, "frequency in Hz"),
    "kg_m3": (1, "density in kg/m³"),
    "Pa_s": (1, "viscosity"),
    "Pa": (1, "modulus in Pa"),
    "s": (1, "time in s"),
    "mmHg": (1, "pressure in mmHg"),
    "gf": (1, "force in gf"),
    "deg": (1, "angle in degrees"),
    "percent": (100, "percentage"),
}
"""End of a key → number of the unit in one SI unit (an integer, so that SI → unit → SI is exact after one round), and words.

A patient's pressures stay in mmHg and forces in gf: a pascal or a newton is not an integer number of them.
"""
LARGEST = 1_000_000
"""Maximum size (bytes) of a scene file."""


@dataclass(frozen=True)
class Entry:
    """Description of a field in TOML.

    Parameters
    ----------
    key : str
        Key in the file; its ending names the unit.
    wanted : str
        What is accepted, in words.
    accept : callable
        Whether a single value is accepted.
    per_si : int, optional
        Number of the key's units in one SI unit; 0 for a field that is not a number.
    size : int, optional
        1 for a single value, the length of a list, or 0 for a non-empty list of any length (a single value counts as one).
    table : type of Section, optional
        Section that the field holds.
    hint : callable, optional
        What is wanted in place of a refused text.
    is_path : bool, optional
        Whether the value is a file path.
    convert : callable, optional
        Builds an object, which has `to_dict`, from a value and its path in the document.
    relocate : callable, optional
        Turns relative paths inside a value into paths relative to the working directory, given the folder of the file.
    kind : mapping, optional
        JSON schema of a single value.
    """

    key: str
    wanted: str
    accept: Callable[[Any], Any]
    per_si: int = 0
    size: int = 1
    table: type[Section] | None = None
    hint: Callable[[str], str] | None = None
    is_path: bool = False
    convert: Callable[[Any, str], Any] | None = None
    relocate: Callable[[Any, Path], Any] | None = None
    kind: Mapping[str, Any] = field(default_factory=lambda: {"type": "string"})

    def read(self, raw: Any, path: str) -> Any:
        """Convert a value from TOML to SI, lists to tuples.

        Parameters
        ----------
        raw : object
            Value in the file.
        path : str
            Its place in the document, for messages.

        Returns
        -------
        object

        Raises
        ------
        InputError
            The value is not accepted.
        """
        values = raw if isinstance(raw, list) and self.size != 1 else [raw]
        if not values or len(values) != (self.size or len(values)) or not all(map(self.accept, values)):
            raise InputError(path, brief(raw), self.hint(raw) if self.hint and isinstance(raw, str) else self.wanted)
        if self.convert:
            values = [self.convert(value, path) for value in values]
        if self.table:
            values = [self.table.read(v, path if self.size else f"{path}#{i}") for i, v in enumerate(values, 1)]
        values = [v / self.per_si if self.per_si and not isinstance(v, Formula) else v for v in values]
        return values[0] if self.size == 1 else tuple(values)

    def show(self, value: Any) -> Any:
        """Convert a value from SI to TOML, NumPy numbers and arrays too; values that TOML cannot hold are returned unchanged."""
        value = value.tolist() if hasattr(value, "tolist") else value
        if isinstance(value, (list, tuple)):
            return [self.show(item) for item in value]
        if isinstance(value, Formula):
            return value.text
        if isinstance(value, Section) or (self.convert and hasattr(value, "to_dict")):
            return value.to_dict()
        if not self.per_si or not is_number(value):
            return value
        short = float(f"{value * self.per_si:.15g}")
        return short if short / self.per_si == value else value * self.per_si


def is_number(raw: Any, kind: Any = (int, float)) -> bool:
    """Whether a value is a finite number.

    Parameters
    ----------
    raw : object
        The value; bool is refused.
    kind : type or tuple of type, optional
        Accepted types.

    Returns
    -------
    bool
    """
    return isinstance(raw, kind) and not isinstance(raw, bool) and abs(raw) <= 1e300  # false for nan


# Sections.


class Section:
    """Base class of the sections of a document. Fields are checked when a section is built, relations between fields when the
    scene is.

    `KEY` is the section's key in TOML where it differs from the lower-case class name.
    """

    KEY: ClassVar[str] = ""

    @classmethod
    def key(cls) -> str:
        """Key of the section in TOML."""
        return cls.KEY or cls.__name__.lower()

    def __post_init__(self) -> None:
        section = f"{self.key()}.".removeprefix("scene.")
        for f in fields(self):  # type: ignore[arg-type]
            entry, shown = f.metadata["entry"], self.toml_value(f.name)
            if shown is not None or f.default is not None:
                empty = shown == [] and f.default == ()
                object.__setattr__(self, f.name, () if empty else entry.read(shown, section + entry.key))

    @classmethod
    def read(cls, data: Any, path: str = "") -> Self:
        """Build a section from keys and units of TOML; `path` is its place in the document, for messages."""
        if not isinstance(data, dict):
            raise InputError(path or "scene", brief(data), "a table of keys and values")
        known, path = {f.metadata["entry"].key: f for f in fields(cls)}, path and f"{path}."  # type: ignore[arg-type]
        for key in data:
            if key not in known:
                shown = key if re.fullmatch(r"[\w-]{1,60}", str(key)) else brief(key)
                raise InputError(f"{path}{shown}", "not a known key", nearest(str(key), known))
        for key, f in known.items():
            if key not in data and f.default is MISSING and f.default_factory is MISSING:
                raise InputError(f"{path}{key}", "missing", f.metadata["entry"].wanted)
        given = {key: f for key, f in known.items() if key in data}
        return cls(**{f.name: f.metadata["entry"].read(data[key], path + key) for key, f in given.items()})

    def to_dict(self) -> dict[str, Any]:
        """The section in keys and units of TOML, JSON-compatible, without empty tables; `read` restores it."""
        values = {entry.key: self.toml_value(name) for name, entry in entries(self).items()}
        return {key: value for key, value in values.items() if value not in (None, {}, [])}

    def toml_value(self, name: str) -> Any:
        """Value of a field in the unit of its TOML key; None where it is not given."""
        return entries(self)[name].show(getattr(self, name))

    def _check(self, path: str, scene: Any) -> None:
        """Check relations between fields of this section and other sections of the scene."""

    def _need(self, ok: Any, path: str, name: str, wanted: str) -> None:
        if not ok:
            raise InputError(f"{path}.{entries(self)[name].key}", brief(self.toml_value(name)), wanted)


class Document(Section):
    """A section that is a whole file."""

    @classmethod
    def from_dict(cls, data: Any, file: str | Path | None = None) -> Self:
        """Build a document from keys and units of TOML; `file` is its name, for messages."""
        try:
            return cls.read(data)
        except InputError as error:
            raise InputError(error.field, error.value, error.wanted, file) from None

    @classmethod
    def from_toml(cls, path: str | Path) -> Self:
        """Read a file; paths in it are relative to its folder."""
        return cls.from_dict(_from_folder(cls, read_toml(path), Path(path).parent), path)

    def to_toml(self) -> str:
        """The document as TOML text; reading it restores the document."""
        return to_toml(self.to_dict())

    def save(self, path: str | Path) -> Path:
        """Write the document as a TOML file, atomically, and return its path; paths in it are made absolute."""
        path, text = Path(path), to_toml(_from_folder(type(self), self.to_dict(), Path.cwd()))
        atomic_write(path, lambda part: part.write_text(text, encoding="utf-8"))
        return path


def _from_folder(part: type[Section], data: Any, folder: Path) -> Any:
    """Data of a section with its relative paths resolved against a folder."""
    if not isinstance(data, dict):
        return data
    found = dict(data)
    for entry in entries(part).values():
        value = data.get(entry.key)
        if entry.is_path and isinstance(value, str) and value.strip():
            found[entry.key] = str(folder / value)
        elif entry.relocate and value is not None:
            found[entry.key] = entry.relocate(value, folder)
        elif entry.table and isinstance(value, list):
            found[entry.key] = [_from_folder(entry.table, each, folder) for each in value]
        elif entry.table:
            found |= {entry.key: _from_folder(entry.table, value, folder)} if entry.key in data else {}
    return found


def entries(part: Any) -> dict[str, Entry]:
    """Field name → `Entry`, of a section or its class."""
    return {f.name: f.metadata["entry"] for f in fields(part)}


def brief(value: Any) -> str:
    """Short text of a value for a message."""
    try:
        return "missing" if value is None else " ".join(reprlib.repr(value).split())
    except ValueError:  # Python refuses to print integers of thousands of digits
        return "a number of thousands of digits"


# Files.


def read_toml(path: str | Path) -> dict[str, Any]:
    """Parse a TOML file; `InputError` if it is not valid."""
    text = read_text(path, "file", LARGEST)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        why = " ".join(str(error).split())
        raise InputError("file", f"unreadable ({why})", "a scene in TOML", path) from None


def to_toml(data: dict[str, Any]) -> str:
    """TOML text of a scene's `to_dict`: its own values, then its tables."""

    def inline(value: Any) -> str:
        if isinstance(value, dict):
            return f"{{ {', '.join(f'{key} = {inline(each)}' for key, each in value.items())} }}"
        if isinstance(value, list):
            return f"[{', '.join(map(inline, value))}]"
        return json.dumps(value, ensure_ascii=False)

    def lines(values: dict[str, Any]) -> list[str]:
        return [f"{key} = {inline(value)}" for key, value in values.items()]

    tables = {key: value for key, value in data.items() if isinstance(value, (dict, list))}
    written = lines({key: value for key, value in data.items() if key not in tables})
    for key, value in tables.items():
        for part in value if isinstance(value, list) else [value]:
            written += ["", f"[[{key}]]" if isinstance(value, list) else f"[{key}]", *lines(part)]
    return "\n".join(written) + "\n"
