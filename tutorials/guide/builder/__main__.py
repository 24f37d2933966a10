"""Build the documentation site from the guide, the lessons, the results and the code.

usage: python tutorials/guide/builder [-o FOLDER] [--notebooks FOLDER] [--fast] [--strict]

The pages are staged under out/docs-source, where generated ones join those of the repository, and Sphinx turns them into HTML.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import api
import catalogue
import lessons
import offline
import stage
import tables
from sphinx.cmd.build import build_main

HERE = Path(__file__).parent


def main(argv: list[str]) -> int:
    """Stage, build, and look for what a browser would fetch from a network."""
    command = argparse.ArgumentParser(prog="make docs", description=__doc__.partition("\n")[0])
    command.add_argument("-o", dest="output", type=Path, default=stage.ROOT / "out/docs", metavar="FOLDER")
    command.add_argument(
        "--notebooks", type=Path, metavar="FOLDER", help="lessons that are executed already, as .ipynb"
    )
    command.add_argument("--fast", action="store_true", help="show lessons that are not in --notebooks unexecuted")
    command.add_argument("--strict", action="store_true", help="warnings, such as a broken reference, are errors")
    given = command.parse_args(argv)
    site = given.output.resolve()
    source, doctrees = (site.with_name(f"{site.name}-{part}") for part in ("source", "doctrees"))
    pages = stage.Pages(source)
    pages.copy()
    lessons.add(pages, given.notebooks, execute=not given.fast)
    for part in (tables, catalogue, api):
        part.add(pages)
    pages.finish()
    strict = ["-W", "--keep-going"] if given.strict else []
    status = build_main(
        ["-q", "-b", "html", "-j", "auto", "-c", str(HERE), "-d", str(doctrees), *strict, str(source), str(site)]
    )
    if status:
        return status
    faults = offline.network_resources(site) + [f"{page} was not written" for page in pages.missing(site)]
    print(*faults, sep="\n", file=sys.stderr)
    print(f"{site / 'index.html'}: {len(list(site.rglob('*.html')))} pages")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
