"""Tasks, their callback, and the error of a lost task."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple, Protocol

from ngbrain.errors import SolverError
from ngbrain.threads import threads

Callback = Callable[..., Any]
"""Called with the progress of a task. The callback that a task is given returns the number of threads it may use from now on."""
AnyExecutor = int | Executor | None
"""None for this process, a number of processes of this machine, or any executor."""


class Task(NamedTuple):
    """A function to call, under a unique name.

    Parameters
    ----------
    name : str
        Name of the result, and of the task in messages.
    function : callable
        Called as `function(*args, *results, callback=callback)`; a module-level function, so that other processes find it.
    args : tuple, optional
        Its arguments.
    needs : sequence of str, optional
        Names of tasks whose results are further arguments; the task starts when they have ended.
    memory : float, optional
        Predicted memory (bytes), see `ngbrain.parallel.predicted_memory`.
    """

    name: str
    function: Callable[..., Any]
    args: tuple[Any, ...] = ()
    needs: Sequence[str] = ()
    memory: float = 0.0


class Store(Protocol):
    """Protocol of a store that keeps results of tasks between runs."""

    def key(self, function: Callable[..., Any], args: tuple[Any, ...]) -> str:
        """Unique key of a call.

        Parameters
        ----------
        function : callable
            The function.
        args : tuple
            Its arguments.

        Returns
        -------
        str
        """

    def find(self, key: str) -> Any:
        """Look up a result; `KeyError` if there is none."""

    def keep(self, key: str, result: Any) -> None:
        """Store a result.

        Parameters
        ----------
        key : str
            Key of the call.
        result : object
            Its result.
        """


class TaskLost(SolverError):
    """A task ended with its process or ran out of memory; the task itself may be correct.

    Parameters
    ----------
    message : str, optional
        What happened.
    memory : bool, optional
        Whether memory was the reason, as far as known: the task is then tried again alone.
    """

    def __init__(self, message: str = "", memory: bool = False) -> None:
        super().__init__(message)
        self.memory = memory

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.memory)


def picklable_error(error: Exception, task: str) -> Exception:
    """Exception that can be raised in another process, with the original traceback as a note.

    Parameters
    ----------
    error : Exception
        The exception.
    task : str
        Name of the task.

    Returns
    -------
    Exception
    """
    if isinstance(error, MemoryError):
        return TaskLost(f"{task}: out of memory; fewer at once take less", memory=True)
    error.add_note("in another process:\n" + "".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return SolverError(f"{task}: {type(error).__name__}: {error}")
    return error


@contextmanager
def share_threads(callback: Callback) -> Iterator[Callback]:
    """Context manager within a task: use its share of the threads, and more when other tasks end; updated at each call of the
    callback.

    NGSolve's task manager then sums in another order, so that results differ by round-off from those on one thread. Only a
    `ProcessExecutor` with shared threads gives a task more than one.
    """
    with ExitStack() as stack:
        used = 1

        def report(*what: Any) -> None:
            nonlocal used
            share = callback(*what)
            if share != used:
                stack.close()
                stack.enter_context(threads(share))
                used = share

        yield report
