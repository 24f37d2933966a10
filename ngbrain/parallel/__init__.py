"""Independent tasks on any executor of the `concurrent.futures` interface; results do not depend on which.

`run` is the one driver: tasks have names, results come back by name. `ProcessExecutor` computes in processes of this machine,
`open_executor` finds the executor that a command line names.
"""

from ngbrain.parallel.driver import run
from ngbrain.parallel.executors import open_executor
from ngbrain.parallel.processes import ProcessExecutor
from ngbrain.parallel.tasks import AnyExecutor, Task, TaskLost, Tell, helped

__all__ = ["AnyExecutor", "ProcessExecutor", "Task", "TaskLost", "Tell", "helped", "open_executor", "run"]
