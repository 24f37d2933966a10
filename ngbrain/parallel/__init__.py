"""Independent tasks on any executor with the `concurrent.futures` interface; the results do not depend on which.

`run` is the one driver: a `Task` has a name, and results come back by name. `ProcessExecutor` uses processes of this machine,
`DaskExecutor`, `MpiExecutor` and `SlurmExecutor` those of a cluster; `open_executor` opens the one named on a command line.
`predicted_memory` estimates the memory of a task by `memory_table`, `share_threads` lets a task use idle threads, and
`TaskLost` is raised when a task dies with its process. `AnyExecutor` and `Callback` are the types of arguments.

- `dask_cluster`: A Dask cluster as an executor.
- `driver`: Run tasks through an executor.
- `executors`: Executors by their command-line name.
- `kernel`: Memory limits and out-of-memory kills reported by the operating system; standard streams that are closed.
- `memory`: Predicted peak memory of a task.
- `mpi_job`: Ranks of an MPI job as an executor.
- `processes`: Processes of this machine as an executor.
- `remote`: Work on remote workers, and the check of their versions.
- `slurm_jobs`: Slurm jobs as an executor.
- `tasks`: Tasks, their callback, and the error of a lost task.
- `worker`: Main loop of a process of `ProcessExecutor`.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.parallel import (
        dask_cluster,
        driver,
        executors,
        kernel,
        memory,
        mpi_job,
        processes,
        remote,
        slurm_jobs,
        tasks,
        worker,
    )
    from ngbrain.parallel.dask_cluster import DaskExecutor
    from ngbrain.parallel.driver import run
    from ngbrain.parallel.executors import open_executor
    from ngbrain.parallel.memory import memory_table, predicted_memory
    from ngbrain.parallel.mpi_job import MpiExecutor
    from ngbrain.parallel.processes import ProcessExecutor
    from ngbrain.parallel.slurm_jobs import SlurmExecutor
    from ngbrain.parallel.tasks import AnyExecutor, Callback, Task, TaskLost, share_threads
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "AnyExecutor",
    "Callback",
    "DaskExecutor",
    "MpiExecutor",
    "ProcessExecutor",
    "SlurmExecutor",
    "Task",
    "TaskLost",
    "dask_cluster",
    "driver",
    "executors",
    "kernel",
    "memory",
    "memory_table",
    "mpi_job",
    "open_executor",
    "predicted_memory",
    "processes",
    "remote",
    "run",
    "share_threads",
    "slurm_jobs",
    "tasks",
    "worker",
]
