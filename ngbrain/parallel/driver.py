"""Run tasks through an executor: results by name, progress, and retries of lost tasks."""

from __future__ import annotations

import queue
import sys
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import nullcontext, suppress
from typing import Any, Literal

from ngbrain.errors import InputError, SolverError
from ngbrain.parallel.executors import as_executor, task_memory
from ngbrain.parallel.kernel import GIB, machine_memory
from ngbrain.parallel.processes import Job, NotSent, ProcessExecutor
from ngbrain.parallel.remote import OtherVersions, compute, identity
from ngbrain.parallel.tasks import AnyExecutor, Callback, Store, Task, TaskLost
from ngbrain.progress import LOG
from ngbrain.threads import threads

POLL = 0.5
"""Seconds between checks for an interrupt."""
Finished = Callable[[str, Any], Any]


def run(
    tasks: Sequence[Task | tuple[Any, ...]],
    executor: AnyExecutor = None,
    *,
    callback: Callback | None = None,
    finished: Finished | None = None,
    on_error: Literal["raise", "return"] = "raise",
    store: Store | None = None,
) -> dict[str, Any]:
    """Compute tasks; the results do not depend on the executor.

    A task whose process dies is tried once more, alone if memory was the reason. Tasks that cannot be sent to the processes of
    a `ProcessExecutor` (a function of the user's `__main__`, an object that cannot be pickled) are computed in this process,
    one after the other. The logger `ngbrain` warns of both.

    Parameters
    ----------
    tasks : sequence of Task
        Or of tuples (name, function, args); names must be unique.
    executor : int or concurrent.futures.Executor, optional
        By default this process; a number means that many processes of this machine. A `distributed.Client` and a
        `submitit.AutoExecutor` are accepted too (`DaskExecutor`, `SlurmExecutor`). A given executor stays open.
    callback : callable, optional
        Called in this thread with the progress of tasks; not available from executors other than `ProcessExecutor`.
    finished : callable, optional
        Called in this thread with name and result of each finished task.
    on_error : {"raise", "return"}, optional
        Whether the first exception of a task cancels the others, or takes the place of the task's result.
    store : Store, optional
        Store of finished results (`ngbrain.io.FinishedWork`); tasks found there are not computed again.

    Returns
    -------
    dict
        Results by task name, in the order of the tasks.

    Raises
    ------
    InputError
        Names are not unique; a task needs another that is not computed, or more memory than available; a worker has other
        versions.
    TaskLost
        The process of a task died twice, or memory was short; the message names the task.
    Exception
        The first exception of a task; it cancels the others.

    Examples
    --------
    >>> def double(x, *, callback):
    ...     return 2 * x
    >>> run([Task("one", double, (1,)), Task("two", double, (2,))])
    {'one': 2, 'two': 4}
    """
    if isinstance(executor, int) and executor < 1:
        raise InputError("executor", executor, "a number of processes from 1 on")
    asked, executor = executor, as_executor(executor)
    plan = _Plan([Task(*task) for task in tasks], finished or (lambda *_: None), on_error == "return", store)
    plan.refuse(machine_memory() if executor is None or isinstance(executor, int) else task_memory(executor))
    callback = callback or (lambda *_: None)
    own = ProcessExecutor(executor) if isinstance(executor, int) and executor > 1 else None
    given = own or (None if isinstance(executor, int) else executor)
    if given is not None:
        try:
            _through(given, plan, callback)
        except NotSent as reason:
            words = "%s; what was to be computed side by side is computed in this process, one after the other"
            LOG.warning(words, reason)
        finally:
            if given is not asked:
                given.shutdown(wait=own is not None, cancel_futures=True)
    _here(plan, callback, getattr(given, "threads", 1))
    return plan.results()


class _Plan:
    """Tasks that wait, and results of those that ended."""

    def __init__(self, tasks: Sequence[Task], finished: Finished, forgiving: bool, store: Store | None) -> None:
        self.tasks = {task.name: task for task in tasks}
        self._finished, self._forgiving, self._store = finished, forgiving, store
        self._keys = dict[str, str]()
        self.waiting = deque(tasks)
        self.ended = dict[str, Any]()
        self._failed = set[str]()
        if len(self.tasks) < len(tasks):
            names = [task.name for task in tasks]
            raise InputError("tasks", f"of one name, {max(names, key=names.count)!r}", "a name of its own for each")
        before = set[str]()
        for task in tasks:
            if missing := [name for name in task.needs if name not in before]:
                raise InputError(f"what {task.name} needs", repr(missing[0]), "the name of a task before it")
            before.add(task.name)

    def refuse(self, available: float | None) -> None:
        """Refuse tasks that need more memory (bytes) than available."""
        for task in list(self.waiting):
            if available is not None and task.memory > available:
                self.waiting.remove(task)
                found, wanted = (f"{number / GIB:.1f} GiB" for number in (task.memory, available))
                self.fail(
                    task.name, InputError(f"memory of {task.name}", found, f"at most {wanted}, which its worker has")
                )

    def next(self) -> Task | None:
        """The first task that may start and is not in the store."""
        for task in list(self.waiting):
            if all(name in self.ended for name in task.needs):
                self.waiting.remove(task)
                if failed := [name for name in task.needs if name in self._failed]:
                    self.fail(task.name, SolverError(f"{task.name}: it needs {failed[0]}, which failed"))
                    return self.next()
                if not self._stored(task):
                    return task
        return None

    def _stored(self, task: Task) -> bool:
        if self._store is None:
            return False
        self._keys[task.name] = key = self._store.key(task.function, self.args(task))
        try:
            result = self._store.find(key)
        except KeyError:
            return False
        self.ended[task.name] = result
        self._finished(task.name, result)
        return True

    def args(self, task: Task) -> tuple[Any, ...]:
        """Arguments of a task's function."""
        return (*task.args, *(self.ended[name] for name in task.needs))

    def end(self, name: str, result: Any) -> None:
        """Record the result of a task."""
        if self._store is not None and name not in self._failed:
            self._store.keep(self._keys[name], result)
        self.ended[name] = result
        self._finished(name, result)

    def fail(self, name: str, error: Exception) -> None:
        """Record that a task failed; raises the error unless errors are returned as results."""
        if not self._forgiving:
            raise error
        self._failed.add(name)
        self.end(name, error)

    def start_again(self) -> None:
        """Queue all unfinished tasks again."""
        self.waiting = deque(task for name, task in self.tasks.items() if name not in self.ended)

    def results(self) -> dict[str, Any]:
        return {name: self.ended[name] for name in self.tasks}


def _here(plan: _Plan, callback: Callback, share: int = 1) -> None:
    def report(*what: Any) -> int:
        _heed()
        callback(*what)
        return share

    with threads(1):
        while (task := plan.next()) is not None:
            try:
                result = task.function(*plan.args(task), callback=report)
            except Exception as error:
                plan.fail(task.name, error)
            else:
                plan.end(task.name, result)


def _through(executor: Executor, plan: _Plan, callback: Callback) -> None:
    inbox = queue.SimpleQueue[tuple[str, str, Any]]()
    under_way: dict[str, Future[Any]] = {}
    alone, tried = deque[Task](), set[str]()

    def submit(task: Task) -> None:
        args = plan.args(task)
        if isinstance(executor, ProcessExecutor):
            future: Future[Any] = executor.submit_task(
                task.name, task.function, args, lambda *what: inbox.put(("progress", task.name, what)), task.memory
            )
        else:
            future = executor.submit(compute, task.name, task.function, args, identity())
        under_way[task.name] = future
        future.add_done_callback(lambda done: inbox.put(("done", task.name, done)))

    batch = getattr(executor, "batch", nullcontext)
    try:
        while True:
            if (task := plan.next()) is not None:
                with batch():
                    while task is not None:
                        submit(task)
                        task = plan.next()
            if not under_way and alone:
                submit(alone.popleft())
            if not under_way:
                return
            kind, name, what = _next(inbox)
            if kind == "progress":
                callback(*what)
                continue
            del under_way[name]
            try:
                result = what.result()
            except TaskLost as error:
                if name in tried:
                    plan.fail(name, error)
                    continue
                tried.add(name)
                LOG.warning("%s; it is tried again%s", error, ", alone" if error.memory else "")
                alone.append(plan.tasks[name]) if error.memory else submit(plan.tasks[name])
            except (NotSent, OtherVersions):  # not a failure of the task itself
                raise
            except BrokenExecutor as error:
                raise SolverError(
                    f"{name}: a process of its executor died ({error}); finished results are kept"
                ) from error
            except CancelledError:
                plan.fail(name, SolverError(f"{name}: its executor was shut down before it began"))
            except Exception as error:
                plan.fail(name, error)
            else:
                plan.end(name, result)
    except NotSent:
        plan.start_again()
        raise
    finally:
        for future in under_way.values():
            future.kill() if isinstance(future, Job) else future.cancel()


def _next(inbox: queue.SimpleQueue[Any]) -> Any:
    try:
        while True:
            with suppress(queue.Empty):
                return inbox.get(timeout=POLL)
            _heed()
    except KeyboardInterrupt:
        raise KeyboardInterrupt from None  # without the queue's exception as context


def _heed() -> None:
    """Only the main thread receives Ctrl-C; other threads stop when the interrupt has ended the program."""
    if isinstance(getattr(sys, "last_value", None), KeyboardInterrupt) and not hasattr(sys, "ps1"):
        raise KeyboardInterrupt
