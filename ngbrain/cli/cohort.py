"""The verb `cohort`: many scans or cases through another verb."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext

from ngbrain.cli import EXIT_SOLVER
from ngbrain.cli.words import conclude
from ngbrain.parallel import AnyExecutor, open_executor
from ngbrain.progress import Progress, terminal
from ngbrain.workflows.cohort import TABLE, cohort
from ngbrain.workflows.results import OK, REPORT, Cohort


def run(arguments: argparse.Namespace) -> int:
    """Read the list, compute unfinished rows, write, print; returns the exit status, 3 if a row is not usable."""
    with _executor(arguments) as executor, Progress(terminal(arguments.quiet), text="reading the list") as line:
        done = cohort(
            arguments.list,
            arguments.output,
            arguments.of_rows,
            group=arguments.group,
            executor=executor,
            again=arguments.overwrite,
            callback=line.callback,
        )
    conclude(arguments.quiet, summary(done), list(_cautions(done)))
    return 0 if done.usable else EXIT_SOLVER


def _executor(arguments: argparse.Namespace) -> AbstractContextManager[AnyExecutor]:
    """The executor of --executor, else a number of processes."""
    named: str = arguments.executor or str(arguments.threads)
    return nullcontext(int(named)) if named.isdigit() else open_executor(named)


def summary(done: Cohort) -> list[str]:
    """Lines of the summary: number of rows by verdict, location of the results."""
    counts = ", ".join(f"{count} {verdict}" for verdict, count in done.counts.items() if count)
    now = sum(row.computed for row in done.rows)
    kept = list(dict.fromkeys(column for row in done.rows for column in row.about))
    earlier = f"; {len(done.rows) - now} were finished before" if now < len(done.rows) else ""
    return [
        f"{len(done.rows)} row{'s' if len(done.rows) > 1 else ''}: {counts}{earlier}",
        *([f"columns that are no option, kept as they are: {', '.join(kept)}"] if kept else []),
        f"table: {done.folder / TABLE}",
        f"report: {done.folder / REPORT}",
    ]


def _cautions(done: Cohort) -> Iterator[str]:
    for row in done.rows:
        if row.verdict != OK:
            yield f"{row.name}: {row.verdict}: {row.reason}"
    if done.left_out:
        yield f"no longer in the list, but still in {done.folder}: {', '.join(done.left_out)}"
