"""The sources of the site: which file of the repository becomes which page, and links between them."""

from __future__ import annotations

import os
import posixpath
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
GUIDE = ROOT / "tutorials/guide"
PROJECT = {
    "CONTRIBUTING.md": "project/contributing.md",
    "CHANGELOG.md": "project/changelog.md",
    "LICENSE": "project/licence.txt",
}
LINK = re.compile(r"(?P<picture>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<to>[^)\s]+)\)")
"""A link of Markdown, or a picture."""
IMAGE = re.compile(r'<img src="(?P<to>[^"]+)"')
FENCE = re.compile(r"^(`{3,}|:{3,}).*?^\1\s*$|`[^`\n]+`", re.MULTILINE | re.DOTALL)
"""Code, in which nothing is a link."""
SOURCES = (".md", ".rst", ".ipynb")
PICTURES = (".png", ".svg", ".jpg", ".gif")


GENERATED = ("commands.md", "extras.md", "operation_keys.md", "materials.md", "api/index.rst")
"""Pages of the reference that the builder writes, which pages of the guide may link to."""


def mapping() -> dict[str, str]:
    """File of the repository → page of the site, both relative.

    >>> mapping()["tutorials/guide/reference/glossary.md"]
    'reference/glossary.md'
    """
    found = PROJECT | {f"tutorials/guide/reference/{page}": f"reference/{page}" for page in GENERATED}
    for path in sorted(GUIDE.rglob("*.md")):
        found[_relative(path)] = path.relative_to(GUIDE).as_posix()
    for path in sorted((ROOT / "benchmarks/results").glob("*.md")):
        name = "index.md" if path.name == "README.md" else path.name
        found[_relative(path)] = f"results/{name}"
    for path in lesson_files():
        found[_relative(path)] = f"lessons/{path.stem}.ipynb"
    return found


def lesson_files() -> list[Path]:
    """The lessons, in their order."""
    return sorted((ROOT / "tutorials").glob("[0-9]*.py"))


def links(text: str) -> Iterator[re.Match[str]]:
    """Links and pictures of a page, those in code left out."""
    code = [match.span() for match in FENCE.finditer(text)]
    for pattern in (LINK, IMAGE):
        for match in pattern.finditer(text):
            if not any(first <= match.start("to") < last for first, last in code):
                yield match


def is_elsewhere(link: str) -> bool:
    """Whether a link leaves the repository, or stays on its page."""
    return link.startswith(("http://", "https://", "mailto:", "#"))


class Pages:
    """The staged sources.

    Parameters
    ----------
    folder : Path
        Where they are written; what is there already and not written again is removed at the end.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.pages = folder, mapping()
        self._written = set[Path]()

    def copy(self) -> None:
        """Stage the pages that lie in the repository."""
        for source, page in self.pages.items():
            if not page.endswith(".ipynb") and (ROOT / source).exists():
                text = self.relink((ROOT / source).read_text(), source, page)
                self.write(page, text + self._contents("results/") if page == "results/index.md" else text)

    def _contents(self, folder: str) -> str:
        """A hidden table of contents of a folder whose first page has none."""
        names = [page.removeprefix(folder) for page in self.pages.values() if page.startswith(folder)]
        return "\n".join(["\n```{toctree}", ":hidden:", "", *(n for n in names if n != "index.md"), "```\n"])

    def write(self, page: str, text: str | bytes) -> None:
        """Write a page unless it is there as it is, so that Sphinx reads no more than what changed."""
        data, path = text.encode() if isinstance(text, str) else text, self.path(page)
        if not path.exists() or path.read_bytes() != data:
            path.write_bytes(data)

    def path(self, page: str) -> Path:
        """Where a page or picture is to be written."""
        path = self.folder / page
        path.parent.mkdir(parents=True, exist_ok=True)
        self._written.add(path)
        return path

    def finish(self) -> None:
        """Remove what an earlier run left."""
        for path in self.folder.rglob("*"):
            if path.is_file() and path not in self._written:
                path.unlink()

    def missing(self, site: Path) -> list[str]:
        """Pages that have no HTML in a site: Sphinx passes over what a process of its failed to write."""
        pages = (path.relative_to(self.folder).with_suffix(".html") for path in self._written if path.suffix in SOURCES)
        return sorted(page.as_posix() for page in pages if "notebooks" not in page.parts and not (site / page).exists())

    def relink(self, text: str, source: str, page: str) -> str:
        """The text of a page with links between files of the repository turned into links between pages.

        A link to a file that is no page keeps its words; a picture is staged.

        Parameters
        ----------
        text : str
        source, page : str
            The file in the repository and the page that it becomes.
        """
        changes = []
        for match in links(text):
            link, _, anchor = match["to"].partition("#")
            if is_elsewhere(match["to"]):
                continue
            target = posixpath.normpath(posixpath.join(posixpath.dirname(source), link))
            target = {"README.md": "tutorials/guide/index.md"}.get(target, target)
            if Path(target).suffix in PICTURES:
                staged = f"_pictures/{target}"
                if not self.path(staged).exists():
                    shutil.copy2(ROOT / target, self.path(staged))
            elif target in self.pages:
                staged = self.pages[target]
            elif "text" in match.groupdict():
                changes.append((*match.span(), match["text"]))
                continue
            to = os.path.relpath(staged, posixpath.dirname(page) or ".")
            changes.append((*match.span("to"), to + ("#" + anchor if anchor else "")))
        for first, last, new in sorted(changes, reverse=True):
            text = text[:first] + new + text[last:]
        return text


def _relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()
