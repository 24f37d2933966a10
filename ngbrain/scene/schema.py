"""The file format of a scene: JSON schema and reference page, both generated from the fields and their docstrings.

`python -m ngbrain.scene.schema` prints the page.
"""

from __future__ import annotations

import inspect
import re
from dataclasses import MISSING, Field, fields
from typing import Any

from ngbrain.schema.document import Section

UNIT = re.compile(r" \((?:m|s|Pa|Pa s|Hz|m/s²)\)")
"""SI units in docstrings, which are not those of a key."""
NAMED = re.compile(r"^(\w+(?:, \w+)*)\n((?: {4}.*\n?|\n)+)", re.MULTILINE)
"""Parameters and their descriptions in the section Parameters of a docstring."""


def json_schema(part: type[Section]) -> dict[str, Any]:
    """The JSON schema of a part.

    >>> from ngbrain.scene import Gravity
    >>> json_schema(Gravity)["properties"]["acceleration_m_s2"]["minItems"]
    3
    """
    said, properties, needed = descriptions(part), dict[str, Any](), list[str]()
    for f in fields(part):  # type: ignore[arg-type]
        entry = f.metadata["entry"]
        one: dict[str, Any] = json_schema(entry.table) if entry.table else dict(entry.kind)
        if entry.size == 0 and not entry.table:
            one = {"anyOf": [one, {"type": "array", "items": one, "minItems": 1}]}
        elif entry.size != 1:
            counted = {"minItems": entry.size, "maxItems": entry.size} if entry.size else {"minItems": 1}
            one = {"type": "array", "items": one, **counted}
        default = _default(f)
        about = {"description": said[f.name]} if f.name in said else {}
        properties[entry.key] = one | about | ({} if default is None else {"default": default})
        if _is_needed(f):
            needed.append(entry.key)
    return {
        "type": "object",
        "description": _first(part),
        "properties": properties,
        "required": needed,
        "additionalProperties": False,
    }


def descriptions(part: type[Section]) -> dict[str, str]:
    """Field → its description in the docstring; fields of a group share one."""
    text = inspect.getdoc(part) or ""
    _, _, after = text.partition("Parameters\n----------\n")
    after = re.split(r"\n\w+\n-{3,}\n", after)[0]
    found = dict[str, str]()
    for names, about in NAMED.findall(after + "\n"):
        found |= dict.fromkeys(names.split(", "), UNIT.sub("", " ".join(about.split())))
    return found


def reference(part: type[Section]) -> str:
    """Reference page of a document, in Markdown: a table of keys for each part."""
    lines = [
        "# The scene file",
        "",
        "One TOML file describes every job of `ngbrain simulate`. `ngbrain simulate --template` prints a commented one of an",
        "operation, `--template body` one of a body under loads, `--schema` a JSON schema by which editors complete the keys. The",
        "unit of a number is the end of its key. Paths are relative to the file.",
        "",
        "This page is made from the code (`python -m ngbrain.scene.schema`).",
    ]
    for f in fields(part):  # type: ignore[arg-type]
        entry = f.metadata["entry"]
        if entry.table:
            heading = f"[{entry.key}]" if entry.size else f"[[{entry.key}]]"
            lines += ["", f"## `{heading}`", "", _first(entry.table), "", "| key | value | left out | meaning |"]
            lines += ["|---|---|---|---|", *_rows(entry.table)]
    return "\n".join(lines) + "\n"


def _rows(part: type[Section]) -> list[str]:
    said, rows = descriptions(part), []
    for f in fields(part):  # type: ignore[arg-type]
        entry, default = f.metadata["entry"], _default(f)
        left = "needed" if _is_needed(f) else "" if default is None else f"`{default}`"
        wanted = entry.wanted if len(entry.wanted) < 300 else "a name"
        rows.append(f"| `{entry.key}` | {_cell(wanted)} | {left} | {_cell(said.get(f.name, ''))} |")
    return rows


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


def _first(part: type[Section]) -> str:
    """The first paragraph of a docstring."""
    return " ".join((inspect.getdoc(part) or "").partition("\n\n")[0].split())


def _default(f: Field[Any]) -> Any:
    """The default as in TOML; None without one."""
    if f.default is MISSING or f.default is None or f.default == () or f.metadata["entry"].table:
        return None
    return f.metadata["entry"].show(f.default)


def _is_needed(f: Field[Any]) -> bool:
    return f.default is MISSING and f.default_factory is MISSING


if __name__ == "__main__":
    from ngbrain.scene import Scene

    print(reference(Scene), end="")
