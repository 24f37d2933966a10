"""Independent tasks on any executor of the `concurrent.futures` interface; results do not depend on which.

`run` is the one driver: a `Task` has a name, results come back by name. `ProcessExecutor` computes in processes of this machine,
`DaskExecutor`, `MpiExecutor` and `SlurmExecutor` on others; `open_executor` makes the one that a command line names.
`predicted_memory` says what a task will take, `helped` lets one use threads that are left over, `TaskLost` is what ends it with its
process.
"""

from ngbrain.parallel.dask_cluster import DaskExecutor
from ngbrain.parallel.driver import run
from ngbrain.parallel.executors import open_executor
from ngbrain.parallel.memory import memory_table, predicted_memory
from ngbrain.parallel.mpi_job import MpiExecutor
from ngbrain.parallel.processes import ProcessExecutor
from ngbrain.parallel.slurm_jobs import SlurmExecutor
from ngbrain.parallel.tasks import AnyExecutor, Task, TaskLost, Tell, helped

__all__ = [
    "AnyExecutor",
    "DaskExecutor",
    "MpiExecutor",
    "ProcessExecutor",
    "SlurmExecutor",
    "Task",
    "TaskLost",
    "Tell",
    "helped",
    "memory_table",
    "open_executor",
    "predicted_memory",
    "run",
]
