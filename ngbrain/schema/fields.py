"""Fields of a section of a TOML document, used in place of dataclass defaults."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, field, replace
from pathlib import Path
from typing import Any

from ngbrain.errors import InputError, nearest
from ngbrain.schema.document import UNITS, Entry, Section, brief, is_number
from ngbrain.schema.formulas import Formula
from ngbrain.schema.patterns import WANTED, is_pattern


def number(key: str, default: Any = MISSING, least: float | None = None, signed: bool = False, size: int = 1) -> Any:
    """Field for a number in the unit of its key.

    Parameters
    ----------
    key : str
        Key in the file, with the unit at its end.
    default : float, optional
        Default in SI; a field without one is required.
    least : float, optional
        Minimum, in the key's unit; by default the number must be positive.
    signed : bool, optional
        Whether any number is accepted.
    size : int, optional
        Number of values, see `Entry`.

    Returns
    -------
    dataclasses.Field
    """
    per_si, noun = next((value for unit, value in UNITS.items() if key.endswith(f"_{unit}")), (1, "number"))
    wanted = f"a {noun}" + ("" if signed else " greater than 0" if least is None else f" of at least {least:g}")
    wanted += {0: ", or a list of them", 1: ""}.get(size, f" in each of {size} places")

    def accept(raw: Any) -> bool:
        return is_number(raw) and (signed or (raw > 0 if least is None else raw >= least))

    bound = {} if signed else {"exclusiveMinimum": 0} if least is None else {"minimum": least}
    return _field(Entry(key, wanted, accept, per_si, size, kind={"type": "number", **bound}), default)


def formula(key: str, default: Any, names: tuple[str, ...], about: str, size: int = 1) -> Any:
    """Field for a number in the unit of its key, or a formula that gives one.

    Parameters
    ----------
    key : str
        Key in the file, with the unit at its end.
    default : object
        Default in SI.
    names : tuple of str
        Variables that a formula may contain.
    about : str
        The variables in words, for messages.
    size : int, optional
        Number of values, see `Entry`.

    Returns
    -------
    dataclasses.Field
    """
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
        return is_number(raw) or (isinstance(raw, str) and raw.isprintable() and raw.strip() != "")

    kind = {"anyOf": [{"type": "number"}, {"type": "string"}]}
    return _field(Entry(key, wanted, accept, per_si, size, convert=convert, kind=kind), default)


def integer(key: str, default: Any, low: int, high: int) -> Any:
    """Field for an integer.

    Parameters
    ----------
    key : str
        Key in the file.
    default : int or None
        Default.
    low, high : int
        Smallest and largest accepted value.

    Returns
    -------
    dataclasses.Field
    """
    wanted = f"a whole number from {low} to {high}"
    kind = {"type": "integer", "minimum": low, "maximum": high}
    return _field(Entry(key, wanted, lambda raw: is_number(raw, int) and low <= raw <= high, kind=kind), default)


def text(
    key: str, default: Any, wanted: str, accept: Callable[[str], Any], hint: Callable[[str], str] | None = None
) -> Any:
    """Field for one line of text.

    Parameters
    ----------
    key : str
        Key in the file.
    default : str or None
        Default.
    wanted : str
        What is accepted, in words.
    accept : callable
        Whether a text is accepted.
    hint : callable, optional
        What is wanted in place of a refused text.

    Returns
    -------
    dataclasses.Field
    """

    def fits(raw: Any) -> Any:
        return isinstance(raw, str) and raw.isprintable() and accept(raw)

    return _field(Entry(key, wanted, fits, hint=hint), default)


def choice(key: str, default: Any, choices: Collection[str], hint: Callable[[str], str] | None = None) -> Any:
    """Field for one of several names.

    Parameters
    ----------
    key : str
        Key in the file.
    default : str or None
        Default.
    choices : collection of str
        The names.
    hint : callable, optional
        Suggests similar names for a refused text, where there are many names.

    Returns
    -------
    dataclasses.Field
    """
    wanted = hint("") if hint else "one of " + ", ".join(choices)
    entry = text(key, default, wanted, choices.__contains__, hint).metadata["entry"]
    return _field(replace(entry, kind={"enum": list(choices)}), default)


def registry_name(key: str, default: str | None, registry: Mapping[str, Any]) -> Any:
    """Field for a name in a registry, to which names may be added later.

    Parameters
    ----------
    key : str
        Key in the file.
    default : str or None
        Default.
    registry : mapping
        Name → object; read when a value is checked.

    Returns
    -------
    dataclasses.Field
    """
    wanted = f"{', '.join(registry)}, or another registered name"
    entry = text(key, default, wanted, registry.__contains__, lambda raw: nearest(raw, registry)).metadata["entry"]
    return _field(replace(entry, kind={"type": "string", "examples": list(registry)}), default)


def choice_or_table(
    key: str,
    names: Collection[str],
    read: Callable[[Mapping[str, Any], str], Any],
    kind: Mapping[str, Any],
    wanted: str,
    hint: Callable[[str], str],
    relocate: Callable[[Any, Path], Any] | None = None,
) -> Any:
    """Optional field for one of several names, or for a table from which an object is built.

    Parameters
    ----------
    key : str
        Key in the file.
    names : collection of str
        The names.
    read : callable
        Builds the object from a table and its path in the document.
    kind : mapping
        JSON schema of the table.
    wanted : str
        What is accepted, in words.
    hint : callable
        What is wanted in place of a refused text.
    relocate : callable, optional
        See `Entry`.

    Returns
    -------
    dataclasses.Field
    """

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
    """Optional field for a table, or a list of tables, from which objects are built.

    Parameters
    ----------
    key : str
        Key in the file.
    read : callable
        Builds an object from a table and its path in the document.
    kind : mapping
        JSON schema of the table.
    wanted : str
        What is accepted, in words.
    relocate : callable, optional
        See `Entry`.

    Returns
    -------
    dataclasses.Field
    """

    def fits(raw: Any) -> bool:
        return isinstance(raw, Mapping)

    return _field(Entry(key, wanted, fits, size=0, convert=read, relocate=relocate, kind=kind), None)


def pattern(key: str, default: Any = MISSING) -> Any:
    """Field for a region name, or a regular expression with the same meaning in Python and in NGSolve (std::regex).

    Parameters
    ----------
    key : str
        Key in the file.
    default : str, optional
        Default; a field without one is required.

    Returns
    -------
    dataclasses.Field
    """
    return text(key, default, WANTED, is_pattern)


def path(key: str, default: Any, wanted: str, ends: tuple[str, ...] = ("",)) -> Any:
    """Field for the path of a file, absolute or relative to the folder of the document.

    Parameters
    ----------
    key : str
        Key in the file.
    default : str or None
        Default.
    wanted : str
        What is accepted, in words.
    ends : tuple of str, optional
        Accepted suffixes.

    Returns
    -------
    dataclasses.Field
    """
    entry = text(key, default, wanted, lambda raw: raw.strip() and raw.endswith(ends)).metadata["entry"]
    return _field(replace(entry, is_path=True), default)


def table(cls: type[Section], default: Any = MISSING, size: int = 1) -> Any:
    """Field for another section, or for a list of sections, under the key of its class.

    Parameters
    ----------
    cls : type of Section
        Class of the section.
    default : object, optional
        Default; a field without one is required.
    size : int, optional
        0 for a list of sections.

    Returns
    -------
    dataclasses.Field
    """
    key = cls.key()
    wanted = f"a table [{key}]" if size else f"one or more tables [[{key}]]"
    return _field(Entry(key, wanted, lambda raw: True, 0, size, cls), default)


def _field(entry: Entry, default: Any) -> Any:
    make: dict[str, Any] = {"default_factory" if callable(default) else "default": default}
    return field(metadata={"entry": entry}, **make)
