"""Slurm jobs as an executor, by submitit. Its folder of pickles must be visible on every node."""

from __future__ import annotations

import pickle
import shutil
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ngbrain.errors import InputError, require
from ngbrain.parallel.remote import call_name
from ngbrain.parallel.tasks import TaskLost

POLL = 0.5
"""Polling interval (s)."""
FOLDER = "slurm_jobs"
"""Folder of submitit's pickles and of the output of jobs."""
_GIB = 2.0**30
_OPTIONS: dict[str, Callable[[str], Any]] = {
    "time_min": int,
    "mem_gb": float,
    "partition": str,
    "account": str,
    "at_once": int,
}
_SLURM = {
    "time_min": "timeout_min", "mem_gb": "mem_gb", "partition": "slurm_partition", "account": "slurm_account",
    "at_once": "slurm_array_parallelism",
}  # fmt: skip


class SlurmExecutor(Executor):
    """Executor on Slurm jobs: a `submitit.AutoExecutor` with the `concurrent.futures` interface.

    Parameters
    ----------
    executor : submitit.AutoExecutor
        With its parameters set.
    memory : float, optional
        Memory (bytes) of each job.
    """

    def __init__(self, executor: Any, memory: float | None = None) -> None:
        self._executor = executor
        self._jobs: list[tuple[Any, str, Future[Any]]] = []
        self._lock, self._over = threading.RLock(), threading.Event()
        self._watch = threading.Thread(target=self._look, daemon=True)
        self.memory = memory

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a call as a job. The future raises `TaskLost` if the job ends without a result."""
        future = Future[Any]()
        with self._lock:
            job = self._executor.submit(answer, sys.path, pickle.dumps((fn, args, kwargs)))
            self._jobs.append((job, call_name(fn, args), future))
            if not self._watch.is_alive():
                self._watch.start()
        return future

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Context manager: calls submitted inside become one job array."""
        with self._lock, self._executor.batch():
            yield

    def _look(self) -> None:
        while not self._over.wait(POLL):
            with self._lock:
                jobs = list(self._jobs)
            for entry in jobs:
                job, name, future = entry
                if future.cancelled():
                    job.cancel()
                elif job.done():
                    _settle(job, name, future)
                else:
                    continue
                with self._lock:
                    self._jobs.remove(entry)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop polling the jobs.

        Parameters
        ----------
        wait : bool, optional
            Whether to wait for all jobs.
        cancel_futures : bool, optional
            Whether to cancel unfinished jobs.
        """
        with self._lock:
            left = list(self._jobs)
        for job, _, future in left:
            if future.cancelled() or (cancel_futures and future.cancel()):
                job.cancel()
            elif wait:
                with suppress(CancelledError):
                    future.exception()
        self._over.set()


def answer(path: list[str], sent: bytes) -> tuple[bool, Any]:
    """Compute a pickled call in a job; the exception itself is returned, of which submitit would keep only the text.

    Parameters
    ----------
    path : list of str
        `sys.path` of the submitting process.
    sent : bytes
        Pickled function, arguments and keyword arguments.

    Returns
    -------
    well : bool
        Whether the call succeeded.
    what : object
        Its result, or its exception.
    """
    sys.path += [folder for folder in path if folder not in sys.path]
    try:
        fn, args, kwargs = pickle.loads(sent)
        return True, fn(*args, **kwargs)
    except Exception as error:
        return False, error


def _settle(job: Any, name: str, future: Future[Any]) -> None:
    if not future.set_running_or_notify_cancel():
        return
    try:
        well, what = job.result()
    except Exception as error:
        state = str(job.state)
        memory = "OUT_OF_ME" in state
        reason = "for want of memory" if memory else f"without an answer (state {state}, {type(error).__name__})"
        well, what = False, TaskLost(f"{name}: job {job.job_id} ended {reason}; {job.paths.stderr} has details", memory)
    future.set_result(what) if well else future.set_exception(what)


def open_slurm(options: str) -> SlurmExecutor:
    """Executor from command-line options, such as "time_min=120,mem_gb=16,partition=long,at_once=100".

    Raises
    ------
    InputError
        There is no `sbatch`, or an option is unknown.
    MissingExtra
        submitit is not installed.
    """
    submitit = require("submitit", "cluster")
    chosen: dict[str, Any] = {"timeout_min": 24 * 60}
    for option in filter(None, options.split(",")):
        name, _, text = option.partition("=")
        try:
            chosen[_SLURM[name]] = _OPTIONS[name](text)
        except (KeyError, ValueError) as error:
            raise InputError("executor", f"slurm:{option}", f"KEY=VALUE of {', '.join(_OPTIONS)}") from error
    if shutil.which("sbatch") is None:
        raise InputError("executor", "slurm, and no sbatch is found", "a machine from which Slurm takes jobs")
    executor = submitit.AutoExecutor(folder=Path(FOLDER).absolute(), cluster="slurm")
    executor.update_parameters(name="ngbrain", cpus_per_task=1, **chosen)
    return SlurmExecutor(executor, chosen["mem_gb"] * _GIB if "mem_gb" in chosen else None)
