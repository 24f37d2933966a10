"""Fail when a test was skipped or expected to fail that the list of skips does not name.

usage: check_skips.py JUNIT_XML SKIPS_TXT

A line of the list is `pattern | reason`; in the pattern, which has to match the whole test id, * stands for anything.
"""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path


def skipped(junit: str) -> dict[str, str]:
    """The id of every skipped test with pytest's reason."""
    found = {}
    for case in ET.parse(junit).iter("testcase"):
        skip = case.find("skipped")
        if skip is not None:
            file, name, owner = (case.get(key, "") for key in ("file", "name", "classname"))
            module = file.removesuffix(".py").replace("/", ".")
            inner = owner.removeprefix(module).strip(".")
            found["::".join(part for part in (file, inner.replace(".", "::"), name) if part)] = skip.get("message", "")
    return found


def listed(path: str) -> list[re.Pattern[str]]:
    """The patterns of the list, each of which needs a reason."""
    patterns = []
    for number, line in enumerate(Path(path).read_text().splitlines(), 1):
        pattern, _, reason = (part.strip() for part in line.partition("|"))
        if not pattern or pattern.startswith("#"):
            continue
        if not reason:
            sys.exit(f"{path}:{number}: wanted: test id pattern | reason")
        patterns.append(re.compile(".*".join(map(re.escape, pattern.split("*")))))
    return patterns


def main(junit: str, skips: str) -> None:
    """Print what was skipped; exit with status 1 if any of it is not listed."""
    found, patterns = skipped(junit), listed(skips)
    unlisted = [f"{test}: {why}" for test, why in found.items() if not any(p.fullmatch(test) for p in patterns)]
    if unlisted:
        sys.exit("\n".join([f"skipped, but not in {skips}:", *unlisted]))
    print(f"{len(found)} skipped, all listed in {skips}")


if __name__ == "__main__":
    main(*sys.argv[1:])
