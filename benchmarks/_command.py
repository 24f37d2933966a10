"""What a benchmark's command line does: measure and print, or draw what was measured."""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

import ngsolve as ngs

from ngbrain import parallel
from ngbrain.errors import InputError
from ngbrain.io import versions
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

    `measure` is called with whether it is quick; where it has an argument `executor`, with the one that `--executor` names too.
    """
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--chart", metavar="PNG")
    for name, keywords in options.items():
        parser.add_argument(f"--{name}", **keywords)
    if sweeps := "executor" in signature(measure).parameters:
        add_executor(parser)
    arguments = parser.parse_args()
    if arguments.chart:
        chart(json.loads(sys.stdin.read().strip().splitlines()[-1]), arguments.chart)
        return
    set_threads(1)
    ngs.ngsglobals.msg_level = 0
    given = {name: getattr(arguments, name) for name in options}
    if sweeps:
        with executor_of(parser, arguments.executor) as executor:
            found = measure(arguments.quick, executor=executor, **given)
    else:
        found = measure(arguments.quick, **given)
    made = run()
    print(json.dumps([r | {"run": made} for r in found]) if arguments.json else "\n".join(map(line, found)))


def add_executor(parser: argparse.ArgumentParser) -> None:
    """`--executor`, of a benchmark whose cases are independent."""
    about = "who computes the cases: N processes, dask:ADDRESS, mpi[:N] or slurm[:KEY=VALUE,...]; by default this one"
    parser.add_argument("--executor", metavar="WHO", help=about)


@contextmanager
def executor_of(parser: argparse.ArgumentParser, spec: str | None) -> Iterator[parallel.AnyExecutor]:
    """The executor that a command line names; the parser's error for one that is none."""
    with ExitStack() as stack:
        try:
            executor = stack.enter_context(parallel.open_executor(spec))
        except InputError as error:
            parser.error(str(error))
        yield executor


def sweep(
    function: Callable[..., Any],
    cases: Mapping[str, tuple[Any, ...]],
    executor: parallel.AnyExecutor = None,
    finished: Callable[[Any], None] = lambda _: None,
) -> list[Any]:
    """What a function of a benchmark finds for each case, name → arguments, in their order.

    Without an executor they are computed in a plain loop; `finished` is called with what was found as soon as it was.
    """
    if executor is None:
        every = []
        for arguments in cases.values():
            every.append(function(*arguments))
            finished(every[-1])
        return every
    if function.__module__ == "__main__":  # which no other process has: there the script is a module
        function = getattr(import_module(Path(function.__code__.co_filename).stem), function.__name__)
    tasks = [parallel.Task(name, _case, (function, arguments)) for name, arguments in cases.items()]
    return list(parallel.run(tasks, executor, finished=lambda _, found: finished(found)).values())


def _case(function: Callable[..., Any], arguments: tuple[Any, ...], *, callback: parallel.Callback) -> Any:
    ngs.ngsglobals.msg_level = 0
    return function(*arguments)


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
