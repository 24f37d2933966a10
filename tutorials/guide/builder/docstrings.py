"""Docstrings as reStructuredText: what is plain text in them stays plain text, and indented formulas keep their lines."""

from __future__ import annotations

import re
from typing import Any

CODE = re.compile(r"(``.+?``|`[^`]+`)")
SPECIAL = re.compile(r"(?<=\w)_(?=\W|$)|[*|]")
"""An underscore at the end of a word, stars and bars: references, emphasis and substitutions of reStructuredText."""
AFTER_CODE = re.compile(r"(?<=\w)`(?=\w)")
"""The end of code that a word goes on after: `Parameter`s."""
KNOWN: dict[str, str] = {}
"""Name that is public and unique → the name that it is documented under; set by `api`."""
UNDERLINE = re.compile(r"-{3,}$")


def plain(line: str) -> str:
    """A line with what reStructuredText would take for markup escaped, code left out.

    >>> plain("|G*| of W_∞, see `x_`")
    '\\\\|G\\\\*\\\\| of W\\\\_∞, see `x_`'
    """
    line = AFTER_CODE.sub(r"`\\ ", line)
    return "".join(linked(part) if i % 2 else SPECIAL.sub(r"\\\g<0>", part) for i, part in enumerate(CODE.split(line)))


def linked(code: str) -> str:
    """Code that is the name of something documented as a reference to it."""
    name = code.strip("`")
    return f":py:obj:`{name} <{KNOWN[name]}>`" if name in KNOWN else code


def depth(line: str) -> int:
    """How far a line is indented."""
    return len(line) - len(line.lstrip())


def prepare(lines: list[str]) -> list[str]:
    """The lines of a docstring, from text that is written to be read in a terminal."""
    found, literal, sections = list[str](), False, False
    lines = aligned(lines)
    for i, line in enumerate(lines):
        before = lines[i - 1] if i else ""
        sections = sections or bool(UNDERLINE.match(line.strip()) and before.strip())
        if literal and line.strip() and depth(line) == 0:
            literal = False
            found += [""] * bool(before.strip())
        formula = not sections and i > 1 and depth(line) >= 2 and not before.strip() and depth(_last(found)) == 0
        if not literal and formula and not _last(found).lstrip().startswith("- "):
            found += ["::", ""]
            literal = True
        kept = literal or line.lstrip().startswith((">>>", "...")) or UNDERLINE.match(line.strip())
        argument = sections and re.match(r"\*{1,2}\w+( :|$)", line)
        found.append(line if kept or argument else plain(line))
    return found


def aligned(lines: list[str]) -> list[str]:
    """The lines with paragraphs of two columns indented, which keeps their lines as they are."""
    found, paragraph = list[str](), list[str]()
    for line in [*lines, ""]:
        if line.strip():
            paragraph.append(line)
            continue
        first = paragraph[0] if paragraph else ""
        columns = len(paragraph) > 1 and bool(re.match(r"\S.*\S {2,}\S", first)) and not first.startswith("- ")
        found += [f"    {each}" for each in paragraph] if columns else paragraph
        found.append(line)
        paragraph = []
    return found[:-1]


def _last(lines: list[str]) -> str:
    return next((line for line in reversed(lines) if line.strip()), "")


def _process(app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    lines[:] = prepare(lines)


def setup(app: Any) -> dict[str, bool]:
    """Come before napoleon, which reads the sections."""
    app.connect("autodoc-process-docstring", _process, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
