"""Pages of results, each from a template, the records of benchmarks and what was measured by hand.

    python benchmarks/_pages.py                 every page of benchmarks/results that has a template, and the overview's chart
    python benchmarks/_pages.py statics ladder  these
    python benchmarks/_pages.py --check         writes nothing; exit status 1 and the names of pages that differ

A page of a topic is made of `pages/TOPIC.md`, a template without numbers that have a decimal point; `pages/TOPIC.py`, whose
functions without arguments give the text of `{{name}}`; and `pages/TOPIC.json`, measured by hand or in tests: section → records
of what, value, unit, how and date (when it was written down). A template draws these with `{{behind: SECTION}}`, a list, or
`{{measured: SECTION}}`, a table, and ends with `{{made of}}`: machine, versions, commit and date of every file of records that
the page or its charts are of.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import re
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from _tables import Record, table

FOLDER = Path(__file__).parent
PAGES, RESULTS = FOLDER / "pages", FOLDER / "results"
MARK = re.compile(r"\{\{([^{}]+)\}\}")
CHART = re.compile(r"\]\(\.\./(\w+)\.png\)")
UNKNOWN = "not recorded"
_read: list[str] = []
"""Files of records that were read for the page that is being made."""


def records(benchmark: str) -> list[Record]:
    """The records of a benchmark's last full run."""
    if benchmark not in _read:
        _read.append(benchmark)
    return _load(benchmark)


def page(topic: str) -> str:
    """The text of a topic's page."""
    _read.clear()
    text = (PAGES / f"{topic}.md").read_text()
    for benchmark in CHART.findall(text):
        records(benchmark)
    sections = by_hand(topic)
    used: set[str] = set()

    def filled(mark: re.Match[str]) -> str:
        kind, _, section = mark[1].partition(": ")
        if section:
            used.add(section)
            return {"behind": listed, "measured": tabled}[kind](sections[section])
        if kind == "made of":
            return made_of(_read)
        return getattr(importlib.import_module(f"pages.{topic}"), kind)()

    text = MARK.sub(filled, text)
    if lost := set(sections) - used:
        raise ValueError(f"pages/{topic}.md leaves out {', '.join(sorted(lost))} of pages/{topic}.json")
    return text


def by_hand(topic: str) -> dict[str, list[Record]]:
    """What was measured by hand for a topic: section → records."""
    found = PAGES / f"{topic}.json"
    return json.loads(found.read_text()) if found.exists() else {}


def listed(found: Iterable[Record]) -> str:
    """What was measured by hand as a list; a value stands where `{}` is in what it is of, else behind it."""
    lines = []
    for record in found:
        what = record["what"]
        if record["value"] is not None:
            what = what.replace("{}", _value(record)) if "{}" in what else f"{what}: {_value(record)}"
        lines.append(f"- {what}" + (f" ({record['how']})" if record["how"] else ""))
    return "\n".join(lines)


def tabled(found: Iterable[Record]) -> str:
    """What was measured by hand as a table."""
    rows = [[r["what"], _value(r), ", ".join(filter(None, (r["how"], r["date"])))] for r in found]
    return table(("what", "value", "how, date"), rows)


def made_of(benchmarks: Iterable[str]) -> str:
    """Which records a page is of, and on what they were measured."""
    rows = []
    for benchmark in benchmarks:
        found = _load(benchmark)
        runs = [run for record in found for run in _runs(record)]
        bare = any(not list(_runs(record)) for record in found)
        cells = [_told((run.get(key) for run in runs), bare) for key in ("machine", "commit", "date")]
        versions = [f"{program} {version}" for program, version in _versions(found)]
        link = f"[{benchmark}](../{benchmark}.json), {len(found)}, {checksum(benchmark)}"
        rows.append([link, cells[0], ", ".join(versions) or UNKNOWN, *cells[1:]])
    return table(("file, records, checksum", "machine", "versions", "commit", "date"), rows)


def checksum(benchmark: str) -> str:
    """The first digits of the SHA-256 of a file of records, by which a page knows that any number of it has changed."""
    return hashlib.sha256((FOLDER / f"{benchmark}.json").read_bytes()).hexdigest()[:8]


@cache
def _load(benchmark: str) -> list[Record]:
    return json.loads((FOLDER / f"{benchmark}.json").read_text())


def _runs(record: Record) -> Iterable[Record]:
    """How a record, or a part of it, was made."""
    if "run" in record:
        yield record["run"]
    for part in record.values():
        if isinstance(part, dict) and "run" in part:
            yield part["run"]


def _versions(found: list[Record]) -> list[tuple[str, str]]:
    """The programs that records were made with; several versions of one joined."""
    seen: dict[str, set[str]] = {}
    for record in found:
        for named in (record.get("versions") or {}, *(run.get("versions") or {} for run in _runs(record))):
            for program, version in named.items():
                if program != OWN:
                    seen.setdefault(program, set()).add(str(version))
    return [(program, " and ".join(sorted(versions))) for program, versions in sorted(seen.items())]


OWN = "ngbrain"
"""Whose version is its commit."""


def _told(values: Iterable[str | None], bare: bool) -> str:
    """Every value once, in order; and that some records have none."""
    known = sorted({value for value in values if value})
    return ", ".join([*known, *([UNKNOWN if not known else f"of some {UNKNOWN}"] if bare or not known else [])])


def _value(record: Record) -> str:
    value = record["value"]
    return " ".join(str(part) for part in (value, record["unit"]) if part not in (None, ""))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("topics", nargs="*")
    parser.add_argument("--check", action="store_true")
    given = parser.parse_args()
    differ = []
    for topic in given.topics or sorted(path.stem for path in PAGES.glob("*.md")):
        text, where = page(topic), RESULTS / f"{topic}.md"
        if given.check and (not where.exists() or where.read_text() != text):
            differ.append(topic)
        elif not given.check:
            where.write_text(text)
    if not given.check and not given.topics:
        import _overview

        if not _overview.fresh():
            _overview.chart()
    if differ:
        print(f"differ from their records: {', '.join(differ)}; python benchmarks/_pages.py writes them anew")
    return bool(differ)


if __name__ == "__main__":
    import _pages  # the module that topics read records through

    sys.exit(_pages.main())
