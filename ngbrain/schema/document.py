"""How a field stands in TOML: under which key, in which unit, and what is accepted.

A part of a scene is a frozen dataclass on `Section` whose fields are made by `number`, `integer`, `text`, `choice`, `pattern`
and `table`. Each says once how it stands in TOML (its `Entry`); reading, writing, checking and messages follow from that.
A file goes `read_toml` → `Section.read` → `Entry.read` to SI units, and back `Entry.show` → `Section.to_dict` → `to_toml`.

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
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from ngbrain.errors import InputError, nearest
from ngbrain.reading import read_text
from ngbrain.schema.formulas import Formula
from ngbrain.schema.patterns import WANTED, is_pattern

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
}
"""End of a key → how many of the unit are one SI unit (whole: then SI → unit → SI settles at once), and in words.

Pressures of a patient stay in mmHg, and forces in gf: a pascal or a newton is no whole number of them.
"""
LARGEST = 1_000_000
"""Bytes of a file that is still read: more is something else than a scene."""


@dataclass(frozen=True)
class Entry:
    """How a field stands in TOML: what is accepted under which key, how many of its unit are one SI (0: not a number).

    `size` is 1, the length of a list, or 0 for a list of any length but zero (a single value is one too). `hint` says what
    is wanted in place of a text that was not accepted. `kind` is a single value's JSON schema,
    `convert` makes something of a value and its path that has a `to_dict` back; `relocate` makes paths in a value, relative to a
    folder, what they are from here.
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
        """From TOML to SI (lists to tuples), or an `InputError` that names the path."""
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
        """From SI to TOML, NumPy's numbers and arrays too; what has no place in TOML stays as it is."""
        value = value.tolist() if hasattr(value, "tolist") else value
        if isinstance(value, (list, tuple)):
            return [self.show(item) for item in value]
        if isinstance(value, Formula):
            return value.text
        if isinstance(value, Section) or (self.convert and hasattr(value, "to_dict")):
            return value.to_dict()
        if not self.per_si or not _is_number(value):
            return value
        short = float(f"{value * self.per_si:.15g}")
        return short if short / self.per_si == value else value * self.per_si


# Fields of a part: each of these stands where a dataclass has a default.


def number(key: str, default: Any = MISSING, least: float | None = None, signed: bool = False, size: int = 1) -> Any:
    """A number in the key's unit that is > 0, or ≥ `least`, or any (`signed`); for `size` see `Entry`."""
    per_si, noun = next((value for unit, value in UNITS.items() if key.endswith(f"_{unit}")), (1, "number"))
    wanted = f"a {noun}" + ("" if signed else " greater than 0" if least is None else f" of at least {least:g}")
    wanted += {0: ", or a list of them", 1: ""}.get(size, f" in each of {size} places")

    def accept(raw: Any) -> bool:
        return _is_number(raw) and (signed or (raw > 0 if least is None else raw >= least))

    bound = {} if signed else {"exclusiveMinimum": 0} if least is None else {"minimum": least}
    return _field(Entry(key, wanted, accept, per_si, size, kind={"type": "number", **bound}), default)


def formula(key: str, default: Any, names: tuple[str, ...], about: str, size: int = 1) -> Any:
    """A number in the key's unit, or a formula of some variables that gives one; `about` says in words of which."""
    per_si, noun = next((value for unit, value in UNITS.items() if key.endswith(f"_{unit}")), (1, "number"))
    wanted = f"a {noun}, or a formula of {about} for it" + ("" if size == 1 else f", in each of {size} places")

    def convert(raw: Any, path: str) -> Any:
        if not isinstance(raw, str):
            return raw
        try:
            return Formula(raw.strip(), names)
        except InputError as error:
            raise InputError(path, brief(raw), error.wanted) from None

    def accept(raw: Any) -> bool:
        return _is_number(raw) or (isinstance(raw, str) and raw.isprintable() and raw.strip() != "")

    kind = {"anyOf": [{"type": "number"}, {"type": "string"}]}
    return _field(Entry(key, wanted, accept, per_si, size, convert=convert, kind=kind), default)


def integer(key: str, default: Any, low: int, high: int) -> Any:
    """A whole number from `low` to `high`."""
    wanted = f"a whole number from {low} to {high}"
    kind = {"type": "integer", "minimum": low, "maximum": high}
    return _field(Entry(key, wanted, lambda raw: _is_number(raw, int) and low <= raw <= high, kind=kind), default)


def text(
    key: str, default: Any, wanted: str, accept: Callable[[str], Any], hint: Callable[[str], str] | None = None
) -> Any:
    """One line of text that `accept` says yes to."""

    def fits(raw: Any) -> Any:
        return isinstance(raw, str) and raw.isprintable() and accept(raw)

    return _field(Entry(key, wanted, fits, hint=hint), default)


def choice(key: str, default: Any, choices: Collection[str], hint: Callable[[str], str] | None = None) -> Any:
    """One of several names; where they are many, `hint` says which ones another text may have meant."""
    wanted = hint("") if hint else "one of " + ", ".join(choices)
    entry = text(key, default, wanted, choices.__contains__, hint).metadata["entry"]
    return _field(replace(entry, kind={"enum": list(choices)}), default)


def choice_or_table(
    key: str,
    names: Collection[str],
    read: Callable[[Mapping[str, Any], str], Any],
    kind: Mapping[str, Any],
    wanted: str,
    hint: Callable[[str], str],
    relocate: Callable[[Any, Path], Any] | None = None,
) -> Any:
    """One of several names, or a table that `read` makes something of, optional; for `relocate` see `Entry`."""

    def convert(raw: Any, path: str) -> Any:
        return read(raw, path) if isinstance(raw, Mapping) else raw

    def fits(raw: Any) -> bool:
        return isinstance(raw, Mapping) or (isinstance(raw, str) and raw in names)

    schema = {"anyOf": [{"enum": list(names)}, kind]}
    return _field(Entry(key, wanted, fits, hint=hint, convert=convert, relocate=relocate, kind=schema), None)


def custom_table(
    key: str,
    read: Callable[[Mapping[str, Any], str], Any],
    kind: Mapping[str, Any],
    wanted: str,
    relocate: Callable[[Any, Path], Any] | None = None,
) -> Any:
    """A table that `read` makes something of, or a list of them, optional."""

    def fits(raw: Any) -> bool:
        return isinstance(raw, Mapping)

    return _field(Entry(key, wanted, fits, size=0, convert=read, relocate=relocate, kind=kind), None)


def pattern(key: str, default: Any = MISSING) -> Any:
    """A name, or a regular expression that means the same to Python and to NGSolve (std::regex)."""
    return text(key, default, WANTED, is_pattern)


def path(key: str, default: Any, wanted: str, ends: tuple[str, ...] = ("",)) -> Any:
    """The path of a file, as it is or relative to the folder of the scene's file."""
    entry = text(key, default, wanted, lambda raw: raw.strip() and raw.endswith(ends)).metadata["entry"]
    return _field(replace(entry, is_path=True), default)


def table(cls: type[Section], default: Any = MISSING, size: int = 1) -> Any:
    """Another part, or with `size` 0 a list of them, under its class's name."""
    key = cls.key()
    wanted = f"a table [{key}]" if size else f"one or more tables [[{key}]]"
    return _field(Entry(key, wanted, lambda raw: True, 0, size, cls), default)


def _field(entry: Entry, default: Any) -> Any:
    make: dict[str, Any] = {"default_factory" if callable(default) else "default": default}
    return field(metadata={"entry": entry}, **make)


def _is_number(raw: Any, kind: Any = (int, float)) -> bool:
    return isinstance(raw, kind) and not isinstance(raw, bool) and abs(raw) <= 1e300  # not so for nan


# Parts.


class Section:
    """What all parts share: a part's fields are checked when it is made, what is between fields when a scene is.

    `KEY` is a part's name in TOML, where it is not that of its class.
    """

    KEY: ClassVar[str] = ""

    @classmethod
    def key(cls) -> str:
        """The part's name in TOML."""
        return cls.KEY or cls.__name__.lower()

    def __post_init__(self) -> None:
        section = f"{self.key()}.".removeprefix("scene.")
        for f in fields(self):  # type: ignore[arg-type]
            entry, shown = f.metadata["entry"], self.toml_value(f.name)
            if (shown is not None or f.default is not None) and not (shown == [] and f.default == ()):
                object.__setattr__(self, f.name, entry.read(shown, section + entry.key))

    @classmethod
    def read(cls, data: Any, path: str = "") -> Self:
        """From TOML's keys and units; `path` is where the part stands, for messages."""
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
        """In TOML's keys and units, fit for JSON, without tables in which nothing is given; `read` gives the same part back."""
        values = {entry.key: self.toml_value(name) for name, entry in entries(self).items()}
        return {key: value for key, value in values.items() if value not in (None, {}, [])}

    def toml_value(self, name: str) -> Any:
        """A field's value as TOML has it, in the unit of its key; None where it is not given."""
        return entries(self)[name].show(getattr(self, name))

    def _check(self, path: str, scene: Any) -> None:
        """Raise what is wrong between fields, of this part and of others in the scene."""

    def _need(self, ok: Any, path: str, name: str, wanted: str) -> None:
        if not ok:
            raise InputError(f"{path}.{entries(self)[name].key}", brief(self.toml_value(name)), wanted)


class Document(Section):
    """A part that is a whole file."""

    @classmethod
    def from_dict(cls, data: Any, file: str | Path | None = None) -> Self:
        """From TOML's keys and units; `file` is for messages."""
        try:
            return cls.read(data)
        except InputError as error:
            raise InputError(error.field, error.value, error.wanted, file) from None

    @classmethod
    def from_toml(cls, path: str | Path) -> Self:
        """From a file; paths in it are relative to its folder."""
        return cls.from_dict(_from_folder(cls, read_toml(path), Path(path).parent), path)

    def to_toml(self) -> str:
        """As the text of a file; reading it gives the same scene back."""
        return to_toml(self.to_dict())


def _from_folder(part: type[Section], data: Any, folder: Path) -> Any:
    """A part's data with its relative paths as they are from here."""
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
    """Field name → how it stands in TOML, for a part or its class."""
    return {f.name: f.metadata["entry"] for f in fields(part)}


def brief(value: Any) -> str:
    """A value in a line of a message."""
    try:
        return "missing" if value is None else " ".join(reprlib.repr(value).split())
    except ValueError:  # Python refuses to print whole numbers of thousands of digits
        return "a number of thousands of digits"


# Files.


def read_toml(path: str | Path) -> dict[str, Any]:
    """What a file says, as Python's TOML reader gives it; `InputError` for one that is none."""
    text = read_text(path, "file", LARGEST)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        why = " ".join(str(error).split())
        raise InputError("file", f"unreadable ({why})", "a scene in TOML", path) from None


def to_toml(data: dict[str, Any]) -> str:
    """A scene's `to_dict` as the text of a file: its own values, then its tables."""

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
