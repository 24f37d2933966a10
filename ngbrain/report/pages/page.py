"""Self-contained pages: a template of this folder with its pictures embedded."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ngbrain.atomic import atomic_write
from ngbrain.errors import require
from ngbrain.report import words

CONTENTS = "<!-- contents -->"
HEADING = re.compile(r'<h2(?: id="([^"]*)")?>(.*?)</h2>')


def write_page(path: Path, template: str, pictures: Mapping[str, bytes], **given: Any) -> Path:
    """Fill a template and write the page atomically, with a table of contents at the mark `CONTENTS`.

    Parameters
    ----------
    path : Path
        Output file.
    template : str
        Name of the template.
    pictures : mapping of str to bytes
        Name → PNG, embedded as base64.
    **given
        Other variables of the template. Its filters are number, duration and size of `words`, and base64.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    MissingExtra
        jinja2 is not installed.
    """
    jinja2 = require("jinja2", "report")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True, lstrip_blocks=True,
        undefined=jinja2.ChainableUndefined,
    )  # fmt: skip
    environment.filters.update(number=words.number, duration=words.duration, size=words.size, base64=_text)
    encoded = {name: _text(picture) for name, picture in pictures.items()}
    text = str(environment.get_template(template).render(pictures=encoded, **given))
    atomic_write(path, lambda part: part.write_text(_with_contents(text), encoding="utf-8"))
    return path


def _with_contents(page: str) -> str:
    """Add anchors to the headings, and links to them."""
    links: list[str] = []

    def place(found: re.Match[str]) -> str:
        name = found[1] or f"part-{len(links) + 1}"
        links.append(f'<li><a href="#{name}">{found[2]}</a></li>')
        return f'<h2 id="{name}">{found[2]}</h2>'

    page = HEADING.sub(place, page)
    return page.replace(CONTENTS, f'<nav aria-label="Contents"><ul>{"".join(links)}</ul></nav>')


def _text(picture: bytes) -> str:
    return base64.b64encode(picture).decode()
