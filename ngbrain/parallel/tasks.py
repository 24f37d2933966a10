"""What is computed, who computes it, and how it can be lost."""

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
"""Called with how far a task is, in words of its own. The one that a task is given returns how many threads it may use from now on.
"""
AnyExecutor = int | Executor | None
"""Who computes: None this process, a number that many processes of this machine, or any executor."""


class Task(NamedTuple):
    """A function to call, by a name that no other task has.

    Attributes
    ----------
    name : str
        Names the result, and the task in messages.
    function : callable
        Called as `function(*args, *results, callback=callback)`. Of a module, so that other processes find it.
    args : tuple
    needs : sequence of str
        Names of tasks whose results it is called with; it begins when they have ended.
    memory : float
        Bytes that it will take, where that is known (`ngbrain.parallel.predicted_memory`).
    """

    name: str
    function: Callable[..., Any]
    args: tuple[Any, ...] = ()
    needs: Sequence[str] = ()
    memory: float = 0.0


class Store(Protocol):
    """Keeps results of tasks from one run to the next."""

    def key(self, function: Callable[..., Any], args: tuple[Any, ...]) -> str:
        """Tells a call from every other."""

    def find(self, key: str) -> Any:
        """The result; `KeyError` where there is none."""

    def keep(self, key: str, result: Any) -> None:
        """Keep a result."""


class TaskLost(SolverError):
    """A task ended with its process, or for want of memory, which says nothing against the task itself.

    Attributes
    ----------
    memory : bool
        Whether memory was the reason, as far as can be known: it is tried again alone.
    """

    def __init__(self, message: str = "", memory: bool = False) -> None:
        super().__init__(message)
        self.memory = memory

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.memory)


def picklable_error(error: Exception, task: str) -> Exception:
    """An exception that can be raised in another process, and says there where it came from."""
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
    """Within a task: use its share of the threads, more once fewer tasks than threads are left; noticed when it tells.

    NGSolve's task manager then adds up in another order, so that results differ by round-off from those of one thread. Only a
    `ProcessExecutor` with threads to share gives a task more than one.
    """
    with ExitStack() as stack:
        used = 1

        def told(*what: Any) -> None:
            nonlocal used
            share = callback(*what)
            if share != used:
                stack.close()
                stack.enter_context(threads(share))
                used = share

        yield told
