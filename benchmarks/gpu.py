"""What a GPU gains: every path of ngbrain and NGSolve on a device beside the processor, by size, and whole inversions.

A GPU is often at hand for minutes only, on a machine without a package index. So all is packed beforehand, in parts that are
copied one after another; whatever has arrived is unpacked and measured, and after each measurement the records are saved. A
measurement that takes more than its cap is ended, recorded so and not tried with more unknowns; what could not run yet runs once
the missing part is there.

    python benchmarks/gpu.py --pack DIR                      gather the parts, where there is a package index (once)
    python benchmarks/gpu.py --stage DIR/part-1 [--out FILE] on the machine with the GPU, for each part: unpack, measure, save
    python benchmarks/gpu.py [--out FILE] [--minutes 7.5]      measure with what is installed
    python benchmarks/gpu.py --quick [--json]                small sizes; without a GPU on NGSolve's reference device
    python benchmarks/gpu.py --chart FILE.png < gpu.json     time against unknowns, and inversions over MatNLI's time
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from queue import Empty, Queue
from threading import Thread

HERE = Path(__file__).resolve().parent
Record = dict
Job = tuple[str, int, float]
"""Problem, elements along a side, and the seconds that one method may take."""
CAP_S, INVERSION_CAP_S, START_CAP_S = 20.0, 60.0, 60.0
SIDES = {"elasticity": (9, 16, 23, 29), "mixed": (9, 15, 22, 28), "waves": (7, 12, 18, 23)}
"""About 20, 100, 300 and 600 thousand unknowns."""
DEGREES = {1: 46, 2: 23, 3: 15, 4: 11, 5: 9, 6: 7}
"""Order → elements along a side: about 100 thousand unknowns each."""
OUT = Path(__file__).resolve().parents[1] / "out" / "gpu"
SITE = OUT / "site"
SET_UP = "set-up"
"""In place of a method where a problem could not even be set up."""


def plan(quick: bool) -> list[Job]:
    """What loads, whether it is right, then by growing size; inversions before the largest."""
    jobs: list[Job] = [("loading", 0, CAP_S)]
    if quick:
        jobs += [("memory", 1000, CAP_S), ("elasticity", 2, CAP_S), ("mixed", 1, CAP_S), ("waves", 1, CAP_S)]
        return [*jobs, ("stiffness 2", 1, CAP_S), ("inversion CV-G, order 4", 6, INVERSION_CAP_S)]
    jobs += [("memory", 30_000_000, CAP_S)]
    jobs += [(problem, 3, CAP_S) for problem in SIDES]
    jobs += [(problem, sides[0], CAP_S) for problem, sides in SIDES.items()]
    jobs += [("inversion CV-G, order 4", 12, INVERSION_CAP_S)]
    jobs += [(problem, sides[1], CAP_S) for problem, sides in SIDES.items()]
    jobs += [(f"stiffness {p}", n, CAP_S) for p, n in DEGREES.items()]
    jobs += [("inversion block, order 2", 7, INVERSION_CAP_S)]
    return [*jobs, *((problem, sides[k], CAP_S) for k in (2, 3) for problem, sides in SIDES.items())]


def environment(site: Path) -> dict[str, str]:
    """Of the processes that measure: the unpacked packages first, then this tree."""
    path = [str(site)] if site.exists() else []
    added = {"NGBRAIN_GPU_SITE": str(site)} if path else {}
    path += [str(HERE.parent), *filter(None, [os.environ.get("PYTHONPATH", "")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(path), "OPENBLAS_NUM_THREADS": "1"} | added


class Measurements:
    """Records by problem, size and method, in a file that is whole after each of them."""

    def __init__(self, file: Path, about: Record | None = None) -> None:
        self.file, self.about = file, about or {}
        self.records: list[Record] = json.loads(file.read_text()) if file.exists() else []

    def add(self, record: Record) -> None:
        """Put a record in place of what was known of the same measurement, with the machine and the versions, and save."""
        record = record | {"run": self.about}
        same = self._key(record), (record["problem"], record["n"], SET_UP)
        self.records = [known for known in self.records if self._key(known) not in same] + [record]
        self.file.parent.mkdir(parents=True, exist_ok=True)
        partial = self.file.with_suffix(".partial")
        partial.write_text(json.dumps(self.records, indent=0))
        os.replace(partial, self.file)

    def done(self, job: Job) -> list[str]:
        """Methods that need not run again; what loads is asked each time."""
        if job[0] == "loading":
            return []
        return [r["method"] for r in self._of(job) if not r.get("missing")]

    def too_slow(self, job: Job) -> list[str]:
        """Methods that took more than they may in a smaller problem of the same kind."""
        smaller = [r for r in self.records if r["problem"] == job[0] and r["n"] < job[1] and r["method"] != SET_UP]
        return [r["method"] for r in smaller if r.get("reason", "").startswith(("more than", "too slow"))]

    def complete(self, job: Job) -> bool:
        """Whether the last method of a problem has run, and none was missing."""
        return len(self.done(job)) == len(self._of(job)) and any(r.get("last") for r in self._of(job))

    def _of(self, job: Job) -> list[Record]:
        return [r for r in self.records if self._key(r)[:2] == job[:2]]

    @staticmethod
    def _key(record: Record) -> tuple[str, int, str]:
        return record["problem"], record["n"], record["method"]


def measure(jobs: list[Job], kept: Measurements, site: Path, seconds: float, quick: bool = False) -> list[str]:
    """Run all jobs that are not done, within so many seconds; returns the problems for which no time was left."""
    end, left = time.monotonic() + seconds, []
    for job in jobs:
        if time.monotonic() > end:
            left.append(f"{job[0]} {job[1]}")
            continue
        if kept.complete(job):
            continue
        begun = time.monotonic()
        tried: list[str] = []
        while unfinished := run(job, kept, site, [*kept.done(job), *tried], end, quick):
            tried.append(unfinished)
        print(f"{job[0]} {job[1]}: {time.monotonic() - begun:.1f} s", file=sys.stderr, flush=True)
    return left


def run(job: Job, kept: Measurements, site: Path, skip: list[str], end: float, quick: bool) -> str:
    """One process for one problem; returns the method at which it was ended or died, "" where it came to its end."""
    problem, n, cap = job
    command = [sys.executable, str(HERE / "_gpu_cells.py"), problem, str(n), *(["--reference"] if quick else [])]
    process = subprocess.Popen(
        [*command, "--skip", *skip, "--too-slow", *kept.too_slow(job)],
        env=environment(site),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=HERE.parent,
    )
    printed = lines(process)
    under_way: Record = {}
    allowed = START_CAP_S
    while True:
        try:
            line = printed.get(timeout=min(allowed, max(0.0, end + cap - time.monotonic())))
        except Empty:
            process.kill()
            break
        if line is None:
            break
        if not line.startswith("{"):  # libraries print of themselves
            print(line, end="", file=sys.stderr)
            continue
        record = json.loads(line)
        if record.pop("begun", False):
            under_way, allowed = record, cap if not quick else 10 * cap
        else:
            kept.add(record)
            under_way, allowed = {}, START_CAP_S
    errors = process.communicate()[1].strip().splitlines()
    if process.returncode == 0 or (process.returncode == -9 and not under_way and time.monotonic() >= end + cap):
        return ""  # at its end, or out of time before the next method began: nothing was found out
    why = f"more than {allowed:g} s" if process.returncode == -9 else (errors or [f"status {process.returncode}"])[-1]
    failed = {"error": None, "cpu_s": None, "converged": False, "reason": why[:300]}
    if under_way:
        kept.add(under_way | failed)
        return str(under_way["method"])
    kept.add(
        {"problem": problem, "n": n, "order": None, "ndof": None, "method": SET_UP, "device": "", "missing": True} | failed
    )  # fmt: skip
    return ""


def lines(process: subprocess.Popen) -> Queue[str | None]:
    """What a process prints, as it prints it, and None at the end."""
    printed: Queue[str | None] = Queue()

    def read() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            printed.put(line)
        printed.put(None)

    Thread(target=read, daemon=True).start()
    return printed


def published(records: list[Record], quick: bool) -> list[Record]:
    """With names as in all benchmarks."""
    return [r | {"method": f"ngbrain:{r['problem']}: {r['method']}", "quick": quick} for r in records]


def machine(site: Path) -> Record:
    """What `_command.run` says in the processes that measure."""
    found = subprocess.run(
        [sys.executable, "-c", "import json, _command; print(json.dumps(_command.run()))"],
        env=environment(site),
        cwd=HERE,
        capture_output=True,
        text=True,
        check=False,
    )
    return json.loads(found.stdout.splitlines()[-1]) if found.returncode == 0 else {}


def main() -> None:
    """See the top."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pack", type=Path, metavar="DIR")
    parser.add_argument("--stage", type=Path, nargs="+", metavar="PART")
    parser.add_argument("--site", type=Path, default=SITE, help="where parts are unpacked (out/gpu/site)")
    parser.add_argument("--out", type=Path, help="where records are kept (out/gpu/gpu.json, or gpu_quick.json)")
    parser.add_argument("--minutes", type=float, default=7.5)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--chart", metavar="PNG")
    arguments = parser.parse_args()
    site = arguments.site.resolve()
    arguments.out = arguments.out or OUT / ("gpu_quick.json" if arguments.quick else "gpu.json")
    if arguments.chart:
        from _gpu_chart import chart

        chart(json.loads(sys.stdin.read()), arguments.chart)
        return
    if arguments.pack:
        from _gpu_pack import pack

        for part in pack(arguments.pack):
            print(part, *sorted(file.name for file in part.iterdir()))
        return
    if arguments.stage:
        from _gpu_pack import unpack

        begun = time.monotonic()
        print("unpacked:", *unpack(arguments.stage, site), f"({time.monotonic() - begun:.1f} s)", file=sys.stderr)
    if arguments.quick and not arguments.stage:
        arguments.out.unlink(missing_ok=True)
    kept = Measurements(arguments.out, machine(site))
    left = measure(plan(arguments.quick), kept, site, 60 * arguments.minutes, arguments.quick)
    if left:
        print("no time was left for:", ", ".join(left), file=sys.stderr)
    if arguments.json:
        print(json.dumps(published(kept.records, arguments.quick)))
    else:
        print("\n".join(map(line, kept.records)))


def crossing(records: list[Record]) -> int:
    """Complex unknowns from which on cuDSS factorises and solves waves faster than all threads of the processor.

    Between the two sizes where it begins to, times are powers of the unknowns; rounded to two digits.
    """
    waves = [r for r in records if r["problem"] == "waves" and r["n"] > 3 and r["converged"]]

    def seconds(pattern: str) -> dict[int, float]:
        own = [r for r in waves if re.search(pattern, r["method"])]
        return {n: min(r["setup_s"] + r["solve_s"] for r in own if r["ndof"] == n) for n in {r["ndof"] for r in own}}

    device, processor = seconds("cudss"), seconds("direct, processor")
    sizes = sorted(device.keys() & processor.keys())
    ratio = [math.log(device[n] / processor[n]) for n in sizes]
    k = next(k for k, log in enumerate(ratio) if log < 0)
    part = ratio[k - 1] / (ratio[k - 1] - ratio[k]) if k else 1
    found = sizes[k - 1] ** (1 - part) * sizes[k] ** part / 2
    return int(float(f"{found:.1e}"))


def line(record: Record) -> str:
    """One record as text."""
    head = f"{record['problem']:24} {record['ndof'] or '':>8} {record['method']:42} {record['device']:5}"
    if record.get("solve_s") is None:
        return f"{head} {record['reason'] or record.get('version', '')} {record.get('name', '')}"
    error = "" if record["error"] is None else f"{record['error']:.1e}"
    return f"{head} {record.get('setup_s', 0):8.3f} {record['solve_s']:9.4f} s {error} {record['reason']}"


if __name__ == "__main__":
    main()
