"""What a benchmark's command line does: measure and print, or draw what was measured."""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ngsolve as ngs

from ngbrain.io.versions import versions
from ngbrain.threads import set_threads

Record = dict


def main(
    about: str,
    measure: Callable[..., list[Record]],
    chart: Callable[[list[Record], str], None],
    line: Callable[[Record], str],
    **options: dict[str, Any],
) -> None:
    """`[--quick] [--json]` measures on one thread; `--chart PNG` draws the records that come in as the last line.

    options    of one's own, name → what `add_argument` takes; `measure` gets their values by name
    """
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--chart", metavar="PNG")
    for name, keywords in options.items():
        parser.add_argument(f"--{name}", **keywords)
    arguments = parser.parse_args()
    if arguments.chart:
        chart(json.loads(sys.stdin.read().strip().splitlines()[-1]), arguments.chart)
        return
    set_threads(1)
    ngs.ngsglobals.msg_level = 0
    found = measure(arguments.quick, **{name: getattr(arguments, name) for name in options})
    made = run()
    print(json.dumps([r | {"run": made} for r in found]) if arguments.json else "\n".join(map(line, found)))


def run() -> Record:
    """Of what code, on what machine and when records were made; "+" after the commit: with changes not committed."""

    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", *arguments], cwd=Path(__file__).parent, capture_output=True, text=True, check=False
        )
        return done.stdout.strip() if done.returncode == 0 else ""

    changed = "+" if git("status", "--porcelain", "--untracked-files=no") else ""
    return {
        "commit": (git("rev-parse", "--short", "HEAD") or "unknown") + changed,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "machine": f"{_processor()}, {os.cpu_count()} cores",
        "versions": versions(),
    }


def _processor() -> str:
    """Its name where the system tells it, else its kind."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text().splitlines() if told.exists() else []
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())
