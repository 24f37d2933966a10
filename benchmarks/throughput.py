"""Many tasks on one worker and on two, what handing over a task costs on every executor, and 1000 heads foretold.

Five kinds of work, each so many equal tasks: a mesh of labels, an inversion in the plane, one of a zone in space, a ladder
scene, training data. `error` of a kind is 1 - (tasks a second on two workers)/(2 × those on one). Overhead is the time of a
task that does nothing on two workers that have been started, by executor; `start_s` that of starting them. `cohorts` says how
a cohort is foretold from these.

    python benchmarks/throughput.py [--quick] [--json]           last line of --json: a list of records
    python benchmarks/throughput.py --chart FILE.png < throughput.json
    python benchmarks/throughput.py --page < throughput.json     benchmarks/results/cluster.md, of these records and memory.json
"""

from __future__ import annotations

import json
import logging
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from _command import main

from ngbrain import parallel
from ngbrain.errors import require

HERE = Path(__file__).resolve().parent
PAGE = HERE / "results" / "cluster.md"
KINDS = {"labels": "mesh of labels", "slice": "inversion in the plane", "cell": "inversion of a zone", "rung": "ladder scene",
         "samples": "training data"}  # fmt: skip
EACH, EMPTY = 4, 200
"""Tasks of a kind, and empty ones."""
HEADS, WORKERS = 1000, 100
OURS = "ngbrain:processes"


@contextmanager
def processes() -> Iterator[Executor]:
    with parallel.ProcessExecutor(2) as executor:
        yield executor


@contextmanager
def peer() -> Iterator[Executor]:
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        yield executor


@contextmanager
def dask() -> Iterator[Executor]:
    distributed = require("distributed", "cluster")
    with (
        distributed.LocalCluster(
            2, threads_per_worker=1, dashboard_address=":0", silence_logs=logging.CRITICAL
        ) as cluster,
        parallel.open_executor(f"dask:{cluster.scheduler_address}") as executor,
    ):
        yield executor


@contextmanager
def mpi() -> Iterator[Executor]:
    with parallel.open_executor("mpi:2") as executor:
        yield executor


@contextmanager
def slurm() -> Iterator[Executor]:
    """submitit without Slurm: each job a process here, all at once."""
    submitit = require("submitit", "cluster")
    with (
        tempfile.TemporaryDirectory() as folder,
        parallel.SlurmExecutor(submitit.AutoExecutor(folder, cluster="local")) as executor,
    ):
        yield executor


EXECUTORS: dict[str, tuple[Callable, int]] = {
    OURS: (processes, EMPTY), "ngbrain:dask": (dask, EMPTY), "ngbrain:mpi": (mpi, EMPTY), "ngbrain:submitit, local": (slurm, 4),
    "ProcessPoolExecutor, spawn": (peer, EMPTY),
}  # fmt: skip


def measure(quick: bool) -> list[dict]:
    """Overheads, then every kind on one worker and on two."""
    import _tasks

    records = []
    for name, (start, count) in EXECUTORS.items():
        if quick and "submitit" in name:
            continue
        begun = time.perf_counter()
        with start() as executor:
            parallel.run(_tasks.empty(2), executor)
            started = time.perf_counter() - begun
            begun = time.perf_counter()
            parallel.run(_tasks.empty(20 if quick and count == EMPTY else count), executor)
            each = (time.perf_counter() - begun) / (20 if quick and count == EMPTY else count)
        records.append(_record(name, "empty", start_s=started, overhead_s=each, cpu_s=each))
        print(line(records[-1]), file=sys.stderr, flush=True)
    for kind in list(KINDS)[-1:] if quick else KINDS:
        seconds = {}
        for workers in (1, 2):
            with parallel.ProcessExecutor(workers) as executor:
                parallel.run(_tasks.warm(workers), executor)
                begun = time.perf_counter()
                found = parallel.run(_tasks.several(kind, 2 if quick else EACH), executor)
                wall = time.perf_counter() - begun
            cpu = [seconds for seconds, _ in found.values()]
            seconds[workers] = (
                wall / len(found),
                sum(cpu) / len(found),
                {name: digest for name, (_, digest) in found.items()},
            )
        record = _record(
            OURS, kind, cpu_s=seconds[1][1], wall_s=[seconds[1][0], seconds[2][0]], cpu_two_s=seconds[2][1]
        )
        record["throughput_gain"] = seconds[1][0] / seconds[2][0]
        record["error"] = 1 - record["throughput_gain"] / 2
        record["same_bits"] = seconds[1][2] == seconds[2][2]
        records.append(record)
        print(line(record), file=sys.stderr, flush=True)
    return [*records, *cohorts(records)]


def _record(method: str, kind: str, **more: object) -> dict:
    return {"method": method, "kind": kind, "order": None, "ndof": None, "error": None, "converged": True, **more}


def cohorts(records: list[dict]) -> list[dict]:
    """What so many heads (a mesh of labels and an inversion of a slice each) take on so many workers, by executor.

    Tasks are dealt to workers as these become free; a worker's time for a task is the one measured, with a spread of a fifth
    (lognormal, seed 0), as heads are not alike; one after the other the driver hands over each, which takes its overhead.
    """
    work = sum(r["cpu_s"] for r in records if r["kind"] in ("labels", "slice"))
    found = []
    for r in records:
        if r["kind"] != "empty" or "submitit" in r["method"] or not work:
            continue
        wall, busy = dealt(HEADS, WORKERS, work, r["overhead_s"])
        found.append(_record(r["method"], "cohort", cpu_s=HEADS * work, wall_s=r["start_s"] + wall, busy=busy))
    return found


def dealt(tasks: int, workers: int, seconds: float, overhead: float, spread: float = 0.2) -> tuple[float, float]:
    """Seconds until all tasks are done, and the share of workers' time that is work."""
    random = np.random.default_rng(0)
    durations = seconds * np.exp(spread * random.normal(size=tasks) - spread**2 / 2)
    free, handed = np.zeros(workers), 0.0
    for duration in durations:
        first = int(np.argmin(free))
        handed = max(handed, free[first]) + overhead
        free[first] = handed + duration
    return float(free.max()), float(durations.sum() / (workers * free.max()))


def line(r: dict) -> str:
    """One record as text."""
    if r["kind"] == "empty":
        return f"{r['method']:<28} start {r['start_s']:6.2f} s, a task {1e3 * r['overhead_s']:8.2f} ms"
    if r["kind"] == "cohort":
        return f"{r['method']:<28} {HEADS} heads on {WORKERS} workers: {r['wall_s']:.0f} s, busy {r['busy']:.0%}"
    gain = f"two workers {r['throughput_gain']:.2f} times one"
    return f"{r['kind']:<10} {r['cpu_s']:6.2f} s of CPU time a task, {gain}, same bits {r['same_bits']}"


def chart(records: list[dict], png: str) -> None:
    """Overheads, gains of a second worker, and what the cohort takes."""
    from _front import figure

    plt, made, (left, middle, right) = figure(12, 3.4, 3)
    empty = [r for r in records if r["kind"] == "empty"]
    names = [r["method"].removeprefix("ngbrain:") for r in empty]
    left.barh(names, [1e3 * r["overhead_s"] for r in empty], color=[_colour(r["method"]) for r in empty])
    left.set(title="handing over a task", xlabel="ms", xscale="log")
    left.invert_yaxis()
    kinds = [r for r in records if r["kind"] in KINDS]
    middle.barh([KINDS[r["kind"]] for r in kinds], [r["throughput_gain"] for r in kinds], color="#0072B2")
    middle.axvline(2, color="#4d4d4d", linestyle="--")
    middle.set(title="tasks a second, two workers over one", xlabel="times", xlim=(0, 2.4))
    middle.invert_yaxis()
    cohort = [r for r in records if r["kind"] == "cohort"]
    names = [r["method"].removeprefix("ngbrain:") for r in cohort]
    right.barh(names, [r["wall_s"] for r in cohort], color=[_colour(r["method"]) for r in cohort])
    right.set(title="a cohort, foretold", xlabel=f"s for {HEADS} heads, {WORKERS} workers")
    right.invert_yaxis()
    made.savefig(png)
    plt.close(made)


def _colour(method: str) -> str:
    return "#0072B2" if method == OURS else "#009E73" if method.startswith("ngbrain:") else "#999999"


if __name__ == "__main__":
    if sys.argv[1:2] == ["--page"]:
        from _cluster_page import page

        PAGE.write_text(page(json.load(sys.stdin), json.loads((HERE / "memory.json").read_text())))
    else:
        main(__doc__, measure, chart, line)
