"""Two versions of this library on the same benchmarks: every number that differs, and CPU time and memory beside each other.

usage: compare_versions.py OLD NEW [--repeats N] [--most N] [--only CASE …] [--page FILE.md]

OLD and NEW are checkouts, each with an environment `.venv` that has its own ngbrain. Each case is a benchmark of theirs (`--quick
--json`); the two run by turns, one process at a time, `--repeats` times (2), and up to `--most` times (6) where the new one seems
too slow: the least time of all runs counts. A number is an answer if it is the same in all runs of a version, else a measurement.
`--page` also writes FILE.json, all that was found; cases that stand there of the same commits stay. Reasons for numbers that
differ stand in `version_differences.txt`; exit status 1 if one has none, or if a case takes too long.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import compare_tests
from same_answers import leaves

REASONS = Path(__file__).with_name("version_differences.txt")
LIMIT = 1.05
"""CPU time and memory of the new version over the old one's."""
LEAST, LONG = 0.02, 120.0
"""CPU seconds of a record below which its time is not compared, of a case above which no more runs look whether it is too slow."""
MEASURED = {"run", "versions", "cpu_s", "wall_s", "wall_min", "memory_mib"}
"""Entries of records that are no answers even where they happen to be the same."""
SET_UP = """
import json, sys, time
sys.path.insert(0, "peers")
import _case, ngbrain_case
ngbrain_case.set_threads(1)
domain, records = ngbrain_case.domain, []
for case, element, n in (("smooth", "P2/P1", 2), ("smooth", "auto", 2), ("smooth", "P3", 2), ("cook", "P2/P1", 4)):
    task, times = _case.Task(case, n, _case.Element.parse(element), 1), []
    mesh = domain(task)
    ngbrain_case.domain = lambda task: mesh
    for _ in range(20):
        start = time.process_time()
        body = ngbrain_case.body_of(task)
        times.append(time.process_time() - start)
    found = {"method": "set-up", "case": case, "element": element, "n": n, "ndof": body.fes.ndof}
    records.append(found | {"cpu_s": min(times), "memory_mib": _case.memory_mib()})
print(json.dumps(records))
"""
"""Small elastic problems of `peers/ngbrain_case.py`, set up on a mesh that is there, the least time of twenty."""
QUICK = (
    "statics_smooth", "statics_block", "griffiths_locking", "flow_steps", "gradient_cost", "gradient_cost_statics",
    "gradient_through_time", "inversion_cases", "inversion_hyperelastic", "inversion_problems", "inversion_relaxing",
    "retraction_hour",
)  # fmt: skip
CASES = {"set-up": ["-c", SET_UP]} | {name: [f"{name}.py", "--quick", "--json"] for name in QUICK}


@dataclass
class Run:
    """What a benchmark gave in one process with its children: its records, CPU seconds, largest memory (MiB)."""

    records: list[dict[str, Any]]
    cpu_s: float
    memory_mib: float


@dataclass
class Difference:
    """An answer that differs; `change` relative, None where it is there in one version only or no number."""

    case: str
    record: str
    name: str
    old: Any
    new: Any
    change: float | None
    reason: str


@dataclass
class Cost:
    """CPU seconds and memory (MiB) of a case or of one of its records, old and new; `spread` of the old one's times, less 1."""

    case: str
    record: str
    cpu_s: tuple[float, float]
    memory_mib: tuple[float, float] | None
    spread: float

    @property
    def ratio(self) -> float:
        """New over old CPU time."""
        return self.cpu_s[1] / self.cpu_s[0]


def measured(checkout: Path, case: str) -> Run:
    """One run of a case in a checkout."""
    python = checkout / ".venv" / "bin" / "python"
    environment = os.environ | dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        process = subprocess.Popen(
            [python, *CASES[case]], cwd=checkout / "benchmarks", env=environment, stdout=out, stderr=err
        )
        _, status, used = os.wait4(process.pid, 0)  # with all children that it waited for
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0), err.seek(0)
        if process.returncode:
            sys.exit(f"{case} in {checkout} ended with {process.returncode}:\n{err.read()[-2000:]}")
        records = json.loads(out.read().strip().splitlines()[-1])
    return Run(records, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


def labelled(run: Run, like: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Records of a run by names, of as few entries as tell those of `like` apart."""
    keys = [k for k in like[0] if k not in MEASURED and all(isinstance(r.get(k), str | int | float) for r in like)]
    telling: list[str] = []
    for key in sorted(keys, key=lambda k: not isinstance(like[0][k], str)):
        now, more = ({tuple(r[k] for k in some) for r in like} for some in (telling, [*telling, key]))
        if len(more) > len(now) or (not telling and len({r[key] for r in like}) > 1):
            telling.append(key)
    return {", ".join(_entry(key, record.get(key)) for key in telling): record for record in run.records}


def _entry(key: str, value: Any) -> str:
    return value if isinstance(value, str) or value is None else f"{key} {value:g}"


def common(old: list[Run], new: list[Run]) -> tuple[list[dict[str, Any]], list[dict[str, Any]], list[str], list[str]]:
    """Records by name of all old runs and of all new ones, the names that both versions have, and those that one has."""
    like = max(old[0].records, new[0].records, key=len)
    sides = [labelled(run, like) for run in old], [labelled(run, like) for run in new]
    both = [name for name in sides[0][0] if name in sides[1][0]]
    return *sides, both, sorted(set(sides[0][0]) ^ set(sides[1][0]))


def differences(
    case: str, old: list[Run], new: list[Run], reasons: list[tuple[str, str]]
) -> tuple[int, list[Difference]]:
    """How many answers there are, and those in which the two versions differ; records that one of them lacks."""
    of_old, of_new, both, alone = common(old, new)
    count = len(of_old[0]), len(of_new[0])
    total, found = (
        0,
        [Difference(case, name, "records", *count, None, _reason(case, "records", reasons)) for name in alone],
    )
    for name in both:
        before, after = ([dict(_numbers(run[name])) for run in side] for side in (of_old, of_new))
        for path in dict.fromkeys((*before[0], *after[0])):
            x, y = ({run.get(path) for run in runs} for runs in (before, after))
            if len(x) > 1 or len(y) > 1:
                continue  # a measurement
            (a,), (b,), total = x, y, total + 1
            if a != b:
                change = None if a is None or b is None else abs(a - b) / max(abs(a), abs(b))
                found.append(Difference(case, name, path, a, b, change, _reason(case, path, reasons)))
    return total, found


def _numbers(record: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    for path, value in leaves(record):
        if isinstance(value, int | float) and MEASURED.isdisjoint(path.split("/")):
            yield path[1:], value


def _reason(case: str, name: str, reasons: list[tuple[str, str]]) -> str:
    return next((why for pattern, why in reasons if fnmatch(f"{case}: {name}", pattern)), "")


def costs(case: str, old: list[Run], new: list[Run]) -> list[Cost]:
    """Of the whole case first, or of the records that both versions have where one of them has more; then of each."""
    *sides, both, alone = common(old, new)
    times = [
        [
            sum(r[name].get("cpu_s") or 0.0 for name in both) if alone else run.cpu_s
            for run, r in zip(runs, side, strict=True)
        ]
        for runs, side in zip((old, new), sides, strict=True)
    ]
    memory = None if alone else (min(r.memory_mib for r in old), min(r.memory_mib for r in new))
    found = [Cost(case, "", (min(times[0]), min(times[1])), memory, max(times[0]) / min(times[0]) - 1)]
    for name in both:
        times = [[run[name].get("cpu_s") or 0.0 for run in side] for side in sides]
        sizes = [[run[name].get("memory_mib") or 0.0 for run in side] for side in sides]
        if min(map(min, times)) >= (LEAST if case != "set-up" else 0):
            memory = (min(sizes[0]), min(sizes[1])) if min(map(min, sizes)) else None
            least = min(times[0])
            found.append(Cost(case, name, (least, min(times[1])), memory, max(times[0]) / least - 1))
    return found


def page(found: dict[str, Any], changed: list[compare_tests.Change]) -> str:
    """What was found, to read."""
    (old, new), repeats = found["commits"], found["repeats"].values()
    differ, compared = [Difference(**d) for d in found["differences"]], [Cost(**c) for c in found["costs"]]
    lines = [
        f"# {new} beside {old}",
        "",
        f"Made by `.ci/compare_versions.py` on {found['date']}, {os.cpu_count()} cores. Each benchmark `--quick`, the two versions",
        f"by turns, {min(repeats)} to {max(repeats)} times, one process at a time, on one thread.",
        "",
        "## Answers",
        "",
        f"{sum(found['answers'].values())} numbers are the same in every run of a version. {_differ(len(differ))}",
        "",
    ]
    if differ:
        lines += [
            f"| case | number | how many | the one that differs most | {old} | {new} | relative | reason |",
            "|---|---|---|---|---|---|---|---|",
        ]
        alike: dict[tuple[str, str, str], list[Difference]] = {}
        for d in differ:
            alike.setdefault((d.case, re.sub(r"/\d+", "", d.name), d.reason or "none known"), []).append(d)
        for (case, name, reason), those in alike.items():
            d = max(those, key=lambda each: each.change or 0.0)
            change = "" if d.change is None else f"{d.change:.1e}"
            lines.append(
                f"| {case} | {name} | {len(those)} | {d.record} | {_short(d.old)} | {_short(d.new)} | {change} | {reason} |"
            )
        lines.append("")
    lines += [
        "## CPU time and memory",
        "",
        f"Least of the runs; the whole process with its imports and children, and its worst record. At most {LIMIT} is asked. "
        "Spread: by how much the old version's own times differ, which says what a ratio is worth.",
        "",
        "| case | CPU s, whole | ratio | memory, MiB | ratio | worst record | CPU s | ratio | spread |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for whole in (c for c in compared if not c.record):
        records = [c for c in compared if c.case == whole.case and c.record]
        worst = max(records, key=lambda c: c.ratio, default=None)
        memory = whole.memory_mib or (1.0, 1.0)
        row = f"| {whole.case} | {whole.cpu_s[0]:.2f} → {whole.cpu_s[1]:.2f} | {whole.ratio:.2f} "
        row += f"| {memory[0]:.0f} → {memory[1]:.0f} | {memory[1] / memory[0]:.2f} "
        if worst:
            row += f"| {worst.record} | {worst.cpu_s[0]:.3f} → {worst.cpu_s[1]:.3f} | {worst.ratio:.2f} | {worst.spread:.0%} |"
        lines.append(row if worst else row + "| | | | |")
    lines += ["", "## Numbers in tests", "", "Of tests that both versions have, by the commit that changed them.", ""]
    for commits in dict.fromkeys(change.commits for change in changed):
        lines.append(f"- *{'; '.join(commits)}*")
        lines += [
            f"  - `{change.file.removeprefix('tests/')}::{change.name}`: {change.what}"
            for change in changed
            if change.commits == commits
        ]
    return "\n".join(lines) + "\n"


def _differ(n: int) -> str:
    return "None differs." if n == 0 else "One differs:" if n == 1 else f"{n} differ:"


def _short(value: Any) -> str:
    return "not there" if value is None else f"{value:.10g}"


def _git(checkout: Path, *arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=checkout, capture_output=True, text=True, check=True).stdout.strip()


def main() -> None:
    """Run, print the page, and write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--most", type=int, default=6)
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES), metavar="CASE")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    old, new = given.old.resolve(), given.new.resolve()
    reasons = [
        (pattern.strip(), why.strip())
        for line in REASONS.read_text().splitlines()
        for pattern, bar, why in [line.partition("|")]
        if bar and not line.startswith("#")
    ]
    runs: dict[str, tuple[list[Run], list[Run]]] = {case: ([], []) for case in given.only}
    for i in range(max(given.repeats, given.most)):
        for case, sides in runs.items():
            if i >= given.repeats:
                whole, *records = costs(case, *sides)
                if whole.cpu_s[0] > LONG or max(c.ratio for c in (whole, *records)) <= LIMIT:
                    continue
            for k in (0, 1) if i % 2 == 0 else (1, 0):
                sides[k].append(measured((old, new)[k], case))
            print(
                f"{case} {i + 1}: {sides[0][-1].cpu_s:.2f} and {sides[1][-1].cpu_s:.2f} s", file=sys.stderr, flush=True
            )
    compared = [differences(case, *sides, reasons) for case, sides in runs.items()]
    commits = [_git(checkout, "rev-parse", "--short", "HEAD") for checkout in (old, new)]
    found: dict[str, Any] = {
        "commits": [
            c + ("+" if _git(v, "status", "--porcelain", "--", "ngbrain", "benchmarks/*.py") else "")
            for c, v in zip(commits, (old, new), strict=True)
        ],
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "repeats": {case: len(sides[0]) for case, sides in runs.items()},
        "answers": {case: total for case, (total, _) in zip(runs, compared, strict=True)},
        "differences": [asdict(d) for _, differ in compared for d in differ],
        "costs": [asdict(c) for case, sides in runs.items() for c in costs(case, *sides)],
    }
    kept = given.page.with_suffix(".json") if given.page else None
    if kept and kept.exists() and (earlier := json.loads(kept.read_text()))["commits"] == found["commits"]:
        for name in ("repeats", "answers"):
            found[name] = earlier[name] | found[name]
        for name in ("differences", "costs"):
            found[name] = [entry for entry in earlier[name] if entry["case"] not in runs] + found[name]
    text = page(found, compare_tests.changes(commits[0], commits[1]))
    print(text)
    if given.page and kept:
        given.page.write_text(text)
        kept.write_text(json.dumps(found))
    slow = [c for case, sides in runs.items() for c in costs(case, *sides) if c.ratio > LIMIT]
    sys.exit(bool(slow) or any(not d["reason"] for d in found["differences"]))


if __name__ == "__main__":
    main()
