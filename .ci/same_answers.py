"""Compare two runs of a scene: how far apart the numbers of two result.json are, and where.

usage: same_answers.py A/result.json B/result.json [LIMIT]       LIMIT: largest relative difference allowed, 0 by default
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

OF_THE_RUN = {"time_s", "cpu_s", "threads", "versions"}


def leaves(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every value with its path."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else None
    if items is None:
        yield path, data
        return
    for key, value in items:
        yield from leaves(value, f"{path}/{key}")


def difference(a: Any, b: Any) -> float:
    """Relative difference of numbers; other values are the same or not."""
    if isinstance(a, float) and isinstance(b, float):
        return abs(a - b) / max(abs(a), abs(b), 1e-12)
    return 0.0 if a == b else float("inf")


def main(first: str, second: str, limit: str = "0") -> None:
    """Print the largest difference; exit with status 1 if it is over the limit."""
    a, b = (
        {k: v for k, v in leaves(json.loads(Path(file).read_text())) if OF_THE_RUN.isdisjoint(k.split("/"))}
        for file in (first, second)
    )
    if a.keys() != b.keys():
        sys.exit(f"not the same entries: {sorted(a.keys() ^ b.keys())[:5]}")
    worst = max(a, key=lambda path: difference(a[path], b[path]))
    off = difference(a[worst], b[worst])
    print(f"{len(a)} values, " + ("the same bits" if off == 0 else f"largest relative difference {off:.1e} at {worst}"))
    sys.exit(off > float(limit))


if __name__ == "__main__":
    main(*sys.argv[1:])
