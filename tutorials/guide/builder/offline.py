"""What the pages of the site would fetch from a network when they are read."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

FETCHED = {"src", "srcset", "data", "poster", "action", "background"}
"""Attributes whose address a browser fetches by itself."""
LINKED = {"stylesheet", "icon", "preload", "prefetch", "preconnect", "dns-prefetch", "modulepreload", "manifest"}
"""Kinds of `<link>` that it fetches, too."""
REMOTE = re.compile(r"^\s*(https?:)?//", re.IGNORECASE)
IN_STYLE = re.compile(r"""(?:url\(\s*["']?|@import\s+["'])((?:https?:)?//[^"')\s]+)""", re.IGNORECASE)
IN_SCRIPT = re.compile(r"""(?:import|fetch|importScripts)\s*\(?\s*["'`]((?:https?:)?//[^"'`]+)""")


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found, self.within = list[str](), ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.within = tag
        given = {name: value or "" for name, value in attrs}
        fetched = [value for name, value in given.items() if name in FETCHED]
        if tag == "link" and LINKED & set(given.get("rel", "").split()):
            fetched.append(given.get("href", ""))
        self.found += filter(REMOTE.match, fetched)
        self.found += IN_STYLE.findall(given.get("style", ""))

    def handle_endtag(self, tag: str) -> None:
        self.within = ""

    def handle_data(self, data: str) -> None:
        if self.within in ("style", "script"):
            self.found += (IN_STYLE if self.within == "style" else IN_SCRIPT).findall(data)


def addresses(text: str) -> list[str]:
    """Addresses that a page fetches.

    >>> addresses('<a href="https://a.org">a</a><script src="//cdn.org/x.js"></script>')
    ['//cdn.org/x.js']
    """
    page = _Page()
    page.feed(text)
    return page.found


def network_resources(site: Path) -> list[str]:
    """A line for each address that a page, style or script of the site fetches."""
    said = []
    for path in sorted(site.rglob("*")):
        kinds = {".html": addresses, ".css": IN_STYLE.findall, ".js": IN_SCRIPT.findall}
        if path.suffix in kinds:
            said += [f"{path.relative_to(site)} fetches {each}" for each in kinds[path.suffix](path.read_text())]
    return said
