"""What a benchmark's command line does: measure and print, or draw what was measured."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable

import ngsolve as ngs

from ngbrain.threads import set_threads

Record = dict


def main(
    about: str,
    measure: Callable[[bool], list[Record]],
    chart: Callable[[list[Record], str], None],
    line: Callable[[Record], str],
) -> None:
    """`[--quick] [--json]` measures on one thread; `--chart PNG` draws the records that come in as the last line."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--chart", metavar="PNG")
    arguments = parser.parse_args()
    if arguments.chart:
        chart(json.loads(sys.stdin.read().strip().splitlines()[-1]), arguments.chart)
        return
    set_threads(1)
    ngs.ngsglobals.msg_level = 0
    found = measure(arguments.quick)
    print(json.dumps(found) if arguments.json else "\n".join(map(line, found)))
