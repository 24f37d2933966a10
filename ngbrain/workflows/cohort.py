"""Many scans or cases through one verb of the command line: a verdict for each, one table and one report."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ngbrain.atomic import atomic_write
from ngbrain.cli.places import lock_folder
from ngbrain.errors import InputError, require
from ngbrain.io.json_file import write_json
from ngbrain.io.versions import versions
from ngbrain.parallel import AnyExecutor, ProcessExecutor, run
from ngbrain.progress import Step, log_progress, reporting
from ngbrain.reading import read_json
from ngbrain.workflows.gate import find_outliers
from ngbrain.workflows.listing import CohortCase, read_list, values_of
from ngbrain.workflows.results import OK, REPORT, ROWS, WARNING, Cohort, ResultRow, describe, summarise, table
from ngbrain.workflows.rows import EXCLUDED, FAILED, RESULT, Record, digest_case, run_row
from ngbrain.workflows.summary import Number, cautions, main_numbers

TABLE = "cohort.csv"
MARK, MARK_SAYS = (
    "README.txt",
    "Folders of the rows of a cohort. `ngbrain cohort` replaces those whose input has changed.\n",
)
GROUP = "group"
"""Default column of the groups."""


@reporting()
def cohort(
    path: str | Path,
    folder: str | Path,
    verb: str | None = None,
    *,
    group: str | None = None,
    executor: AnyExecutor = 1,
    again: bool = False,
    callback: Callable[[str | Step], Any] = log_progress,
) -> Cohort:
    """Run one verb of the command line for many scans or cases.

    Every row of the list is computed in `folder/rows/NAME` as on the command line, whatever happens to the others. Rows that an
    earlier call has finished with the same files, options, code and versions are not computed again, so that an interrupted call
    continues and a longer list computes the new rows only. The folder then has `cohort.csv` (a line for each row), `result.json`
    and `report.html`.

    Parameters
    ----------
    path : str or Path
        The list, see `ngbrain.workflows.listing.read_list`; ``ngbrain cohort --template`` prints one.
    folder : str or Path
        Where results go; it is made if needed.
    verb : str, optional
        mesh, invert, predict or simulate, for rows that name none.
    group : str, optional
        The column of the groups for statistics and outliers; `group`, if there is such a column.
    executor : int or concurrent.futures.Executor, optional
        Computes the rows: a number of processes (1), another executor, or None for this process, which a crashing row terminates.
        Workers on other machines need the same folders.
    again : bool
        Compute all rows, including finished ones.
    callback : callable, optional
        Called with a text, or with a `ngbrain.progress.Step` once rows are counted.

    Returns
    -------
    Cohort
        The rows and their statistics.

    Raises
    ------
    InputError
        A fault in the list (see `read_list`), other results in the folder, or another process at work there.

    Examples
    --------
    >>> import tempfile
    >>> from ngbrain import datasets
    >>> with tempfile.TemporaryDirectory() as there:
    ...     _ = datasets.write("waves_plane", there)
    ...     table = Path(there) / "list.csv"
    ...     _ = table.write_text("name,verb,input,age\\nfirst,predict,waves_plane.npz,40\\n")
    ...     done = cohort(table, Path(there) / "out", executor=None)
    >>> done.rows[0].verdict, round(done.values("storage_kPa_median")["first"], 1)
    ('ok', 2.9)
    """
    started = time.monotonic()
    require("jinja2", "report")
    path, folder = Path(path), Path(folder).absolute()
    cases = read_list(path, verb)
    by = group or (GROUP if GROUP in cases[0].about else "")
    groups = values_of(cases, by) if by else dict.fromkeys((case.name for case in cases), "")
    _check_folder(folder)
    with lock_folder(folder):
        records, computed = _computed(cases, folder, executor, again, callback)
        rows = [_row(case, records[case.name], groups[case.name], folder, case.name in computed) for case in cases]
        done = _judged(rows, folder, by, [case.name for case in cases])
        _write(done, path, executor, time.monotonic() - started)
    return done


def _check_folder(folder: Path) -> None:
    """Refuse a folder with other results, which a cohort would replace."""
    if folder.exists() and not folder.is_dir():
        raise InputError("-o", str(folder), "a folder, or a name that is free")
    if (folder / ROWS).exists() and not (folder / ROWS / MARK).exists():
        raise InputError("-o", f"{folder}, where {ROWS} is not of a cohort", "the folder of a cohort, or another")
    if (folder / RESULT).exists():
        found = read_json(folder / RESULT, "result")
        if not isinstance(found, dict) or found.get("verb") != "cohort":
            raise InputError(
                "-o", f"{folder}, with results that are not of a cohort", "the folder of a cohort, or another"
            )


def _computed(
    cases: Sequence[CohortCase], folder: Path, executor: AnyExecutor, again: bool, callback: Callable[..., Any]
) -> tuple[dict[str, Record], set[str]]:
    """Records of all rows, and the names of those that were computed now."""
    callback("looking for finished rows")
    if not (folder / ROWS).exists():
        (folder / ROWS).mkdir()
        (folder / ROWS / MARK).write_text(MARK_SAYS, encoding="utf-8")
    digests = {case.name: digest_case(case) for case in cases}
    places = {case.name: folder / ROWS / case.name for case in cases}
    known = {name: record for name, place in places.items() if (record := Record.read(place)) is not None}
    finished = {
        name: record
        for name, record in known.items()
        if record.digest == digests[name]
        and record.outcome
        and (record.outcome == FAILED or (places[name] / RESULT).exists())
        and not again
    }
    if again:
        for name in known:
            (places[name] / "row.json").unlink(missing_ok=True)
    new = [case for case in cases if case.name not in finished]
    tasks = [(case.name, run_row, (case, str(places[case.name]), digests[case.name])) for case in new]
    ended, under_way = list[str](), list[str]()

    def step() -> Step:
        now = ", ".join(name for name in under_way if name not in ended)
        done = len(finished) + len(ended)
        return Step(f"{done} of {len(cases)} rows done" + (f"; {now}" if now else ""), done / len(cases))

    def on_start(name: str) -> None:
        under_way.append(name)
        callback(step())

    def on_end(name: str, _: Any) -> None:
        ended.append(name)
        callback(step())

    found = _run(tasks, executor, on_start, on_end) if tasks else {}
    for name, outcome in found.items():
        lost = isinstance(outcome, BaseException)
        finished[name] = (
            Record(digests[name], outcome=FAILED, reason=str(outcome) or type(outcome).__name__) if lost else outcome
        )
    return finished, set(found)


def _run(
    tasks: Sequence[tuple[Any, ...]], executor: AnyExecutor, on_start: Callable[..., Any], on_end: Callable[..., Any]
) -> dict[str, Any]:
    """Run tasks in separate processes if a number of them is given, also one: a crash ends only its own row."""
    if not isinstance(executor, int):
        return run(tasks, executor, callback=on_start, finished=on_end, on_error="return")
    with ProcessExecutor(min(executor, len(tasks))) as processes:
        return run(tasks, processes, callback=on_start, finished=on_end, on_error="return")


def _row(case: CohortCase, record: Record, group: str, folder: Path, computed: bool) -> ResultRow:
    """A row with the numbers of its result; outliers are found later."""
    place = folder / ROWS / case.name
    verdict, reason, numbers, taken = record.outcome, record.reason, dict[str, Number](), None
    if verdict != FAILED:
        try:
            result = read_json(place / RESULT, "result")
            numbers, taken = main_numbers(result), float(result["time_s"])
        except (InputError, KeyError, TypeError, AttributeError) as error:
            verdict, reason = FAILED, f"its result cannot be read ({error})"
        else:
            warned = cautions(result)
            verdict = EXCLUDED if verdict == EXCLUDED else WARNING if warned else OK
            reason = reason or "; ".join(warned)
    given = ", ".join(path.name for path in case.files)
    return ResultRow(case.name, case.verb, verdict, reason, taken, numbers, group, case.about, place, given, computed)


def _judged(rows: list[ResultRow], folder: Path, by: str, names: list[str]) -> Cohort:
    """Adds warnings for outliers among the usable rows of a verb and group."""
    usable = [row for row in rows if row.usable]
    several = len({row.verb for row in rows}) > 1
    groups = {row.name: " ".join(filter(None, (row.verb if several else "", row.group))) for row in usable}
    values = {row.name: {key: number.value for key, number in row.numbers.items()} for row in usable}
    extremes = {key for row in usable for key, number in row.numbers.items() if number.extreme}
    spreads, outliers = find_outliers(values, groups, extremes)
    out = dict[str, list[str]]()
    for each in outliers:
        row = next(row for row in usable if row.name == each.row)
        out.setdefault(each.row, []).append(describe(each, row.numbers[each.key]))
    judged = [
        replace(row, verdict=WARNING, reason="; ".join(filter(None, (*out[row.name], row.reason))))
        if row.name in out
        else row
        for row in rows
    ]
    left = sorted(each.name for each in (folder / ROWS).iterdir() if each.is_dir() and each.name not in names)
    return Cohort(judged, spreads, outliers, left, folder, by)


def _write(done: Cohort, path: Path, executor: AnyExecutor, seconds: float) -> None:
    """Write cohort.csv, report.html, and result.json last."""
    from ngbrain.report.pages import cohort as page

    atomic_write(done.folder / TABLE, lambda part: part.write_text(table(done), encoding="utf-8"))
    result = summarise(done) | {
        "list": path.name,
        "versions": versions(),
        "seed": None,
        "threads": executor if isinstance(executor, int) else 1,
        "time_s": seconds,
        "files": [TABLE, REPORT, RESULT],
    }
    page.build(done.folder / REPORT, result)
    write_json(done.folder / RESULT, result)
