"""Pages that open alone: a template of this folder, pictures inside of it."""

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
    """Fill a template and write it, with a list of its headings at the mark `CONTENTS`; the file is whole or not there.

    pictures  name → PNG, in the template as base64
    given     everything else that the template names; its filters are number, duration and size of `tables`, and base64

    Raises `MissingExtra` where jinja2 is not installed.
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
    """With a place at each heading, and links to them."""
    links: list[str] = []

    def place(found: re.Match[str]) -> str:
        name = found[1] or f"part-{len(links) + 1}"
        links.append(f'<li><a href="#{name}">{found[2]}</a></li>')
        return f'<h2 id="{name}">{found[2]}</h2>'

    page = HEADING.sub(place, page)
    return page.replace(CONTENTS, f'<nav aria-label="Contents"><ul>{"".join(links)}</ul></nav>')


def _text(picture: bytes) -> str:
    return base64.b64encode(picture).decode()
