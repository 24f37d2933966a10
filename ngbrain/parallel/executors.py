"""Executors by their command-line name."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from typing import Any

from ngbrain.errors import InputError
from ngbrain.parallel.dask_cluster import DaskExecutor, connect
from ngbrain.parallel.kernel import machine_memory
from ngbrain.parallel.mpi_job import MpiExecutor, rank_count
from ngbrain.parallel.processes import ProcessExecutor
from ngbrain.parallel.slurm_jobs import SlurmExecutor, open_slurm

FORMS = "N | dask:ADDRESS | mpi[:N] | slurm[:time_min=M,mem_gb=G,partition=P,account=A,at_once=N]"


@contextmanager
def open_executor(spec: str | int | None) -> Iterator[Executor | None]:
    """Open the executor of a name; it is checked before the work begins and closed afterwards.

    Parameters
    ----------
    spec : str or int, optional
        N: processes of this machine (None and 1: this process, which yields None); `dask:ADDRESS`: workers of a scheduler;
        `mpi` or `mpi:N`: N computing ranks; `slurm`: one job per task, with options
        `slurm:time_min=120,mem_gb=16,partition=long,account=me,at_once=100`.

    Yields
    ------
    concurrent.futures.Executor or None

    Raises
    ------
    InputError
        The name is unknown; no scheduler answers; a worker has no ngbrain, or another version of it or of NGSolve.
    MissingExtra
        A package is not installed.

    Examples
    --------
    >>> with open_executor("2") as executor:
    ...     executor.workers
    2
    """
    if spec is None or isinstance(spec, int) or spec.isdigit():
        workers = int(1 if spec is None else spec)
        if workers < 1:
            raise InputError("executor", spec, FORMS)
        with ProcessExecutor(workers) if workers > 1 else nullcontext() as processes:
            yield processes
        return
    kind, _, rest = spec.partition(":")
    if kind == "dask" and rest:
        with connect(rest) as client, DaskExecutor(client) as cluster:
            yield cluster
    elif kind == "mpi" and (not rest or (rest.isdigit() and int(rest) > 0)):
        with MpiExecutor(int(rest or rank_count())) as job:
            yield job
    elif kind == "slurm":
        with open_slurm(rest) as jobs:
            yield jobs
    else:
        raise InputError("executor", repr(spec), FORMS)


def as_executor(executor: Any) -> Any:
    """Wrap a Dask client or a submitit executor in the `concurrent.futures` interface; other executors are returned unchanged."""
    if hasattr(executor, "get_executor") and hasattr(executor, "scheduler_info"):
        return DaskExecutor(executor)
    if type(executor).__module__.partition(".")[0] == "submitit":
        return SlurmExecutor(executor)
    return executor


def task_memory(executor: Executor) -> float | None:
    """Memory (bytes) available to a task on an executor; None if unknown."""
    return getattr(executor, "memory", machine_memory())
