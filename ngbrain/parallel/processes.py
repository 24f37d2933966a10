"""Processes of this machine as an executor: one task per process at a time, each single-threaded.

The processes (`ngbrain.parallel.worker`) never import the caller's `__main__`: a script needs no main guard, and may come from
stdin, from `python -c`, from a notebook or run in a thread. They end with their parent process.
"""

from __future__ import annotations

import math
import pickle
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from functools import partial
from subprocess import PIPE, Popen, TimeoutExpired
from typing import Any

from ngbrain.errors import InputError, SolverError
from ngbrain.parallel.kernel import machine_memory, memory_kills, open_standard_streams
from ngbrain.parallel.tasks import Callback, TaskLost
from ngbrain.parallel.worker import START

PATIENCE = 5.0
"""Time-out (s) for the end of a process that has closed its pipe."""


class NotSent(Exception):
    """A task cannot be sent to another process."""


class ProcessExecutor(Executor):
    """Executor on processes of this machine, with the `concurrent.futures` interface.

    Parameters
    ----------
    workers : int
        Maximum number of processes; each is started when a task needs it.
    threads : int, optional
        Number of threads shared by tasks that use `share_threads`; the last tasks get the idle ones. By default every task has
        one thread, and the same bits whatever runs beside it.

    Examples
    --------
    >>> with ProcessExecutor(2) as executor:
    ...     list(executor.map(abs, [-1, 2]))
    [1, 2]
    """

    def __init__(self, workers: int, threads: int | None = None) -> None:
        if workers < 1:
            raise InputError("workers", workers, "at least 1")
        open_standard_streams()  # before threads start processes: a pipe of one is not to become the stderr of another
        self.workers, self.threads = workers, threads or 1
        self._waiting: deque[Job] = deque()
        self._changed = threading.Condition()
        self._servants: list[threading.Thread] = []
        self._under_way: list[Job] = []
        self._memory = machine_memory() or math.inf
        self._idle = 0
        self._over = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a call; the future raises `TaskLost` if its process dies."""
        return self._add(Job(None, (fn, args, kwargs)))

    def submit_task(
        self, name: str, function: Callable[..., Any], args: tuple[Any, ...], callback: Callback, memory: float = 0.0
    ) -> Job:
        """Submit a call `function(*args, callback=...)`.

        Parameters
        ----------
        name : str
            Name of the task, for messages.
        function : callable
            A function of a module.
        args : tuple
            Its arguments.
        callback : callable
            Called in another thread of this process with the progress of the task.
        memory : float, optional
            Predicted memory (bytes); the call waits until it fits beside the running ones.

        Returns
        -------
        Job
        """
        return self._add(Job(name, (function, args, {}), callback, memory))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Accept no more calls; the processes end when the queue is empty.

        Parameters
        ----------
        wait : bool, optional
            Whether to wait for the processes.
        cancel_futures : bool, optional
            Whether to cancel calls that have not started.
        """
        with self._changed:
            self._over = True
            while cancel_futures and self._waiting:
                self._waiting.pop().cancel()
            self._changed.notify_all()
        for servant in self._servants if wait else ():
            servant.join()

    def _add(self, job: Job) -> Job:
        with self._changed:
            if self._over:
                raise RuntimeError("this executor has been shut down")
            self._waiting.append(job)
            if len(self._waiting) > self._idle and len(self._servants) < self.workers:
                servant = threading.Thread(target=self._serve, daemon=True)
                try:
                    servant.start()
                except RuntimeError as error:  # Python 3.12 starts no threads after the main thread has ended
                    if not self._servants:
                        self._waiting.pop()
                        raise NotSent(f"no thread can be started for another process ({error})") from error
                else:
                    self._servants.append(servant)
            self._changed.notify()
        return job

    def _take(self) -> Job | None:
        with self._changed:
            self._idle += 1
            while (job := self._fitting()) is None and (self._waiting or not self._over):
                self._changed.wait()
            self._idle -= 1
            if job is not None:
                self._waiting.remove(job)
                self._under_way.append(job)
            return job

    def _fitting(self) -> Job | None:
        """The first waiting job that fits into the free memory; any job if none is running."""
        left = self._memory - sum(job.memory for job in self._under_way)
        fits = (job for job in self._waiting if job.memory <= left or not self._under_way)
        return next(fits, None)

    def _serve(self) -> None:
        """Run jobs in one process, one after the other; in a thread of its own."""
        process: _Process | None = None
        while (job := self._take()) is not None:
            if job.set_running_or_notify_cancel():
                settle: Callable[[], None]
                try:
                    process = process or _Process()
                    settle = partial(job.set_result, process.compute(job, self._share))
                except BaseException as error:
                    settle = partial(job.set_exception, error)
                if process is not None and process.ended:
                    process = None
                self._leave(job)
                settle()
                del settle
            else:
                self._leave(job)
            del job
        if process is not None:
            process.end()

    def _leave(self, job: Job) -> None:
        with self._changed:
            self._under_way.remove(job)
            if job.memory:
                self._changed.notify_all()

    def _share(self) -> int:
        with self._changed:
            return max(1, self.threads // (len(self._waiting) + len(self._under_way)))


class Job(Future[Any]):
    """Future of a call that can be killed while it runs.

    Parameters
    ----------
    name : str or None
        Name of the task; None for a plain call without callback.
    call : tuple
        Function, arguments and keyword arguments.
    callback : callable, optional
        Called with the progress of the task.
    memory : float, optional
        Predicted memory (bytes).
    """

    def __init__(
        self, name: str | None, call: tuple[Any, ...], callback: Callback | None = None, memory: float = 0.0
    ) -> None:
        super().__init__()
        self.name, self.call, self.callback, self.memory = name, call, callback or (lambda *_: None), memory
        self.process: _Process | None = None
        self.killed = False

    def kill(self) -> None:
        """Cancel the call, or kill its process, also one that is being started."""
        self.killed = True  # before `process` is read, as `compute` sets that before it reads this
        if not self.cancel() and (process := self.process) is not None and not self.done():
            process.kill()


class _Process:
    """Handle of a worker process."""

    def __init__(self) -> None:
        command = [sys.executable, "-c", START, *map(str, sys.path)]
        self._kills = memory_kills()
        try:
            with _ctrl_c_blocked():
                self._process = Popen(command, stdin=PIPE, stdout=PIPE)
        except OSError as error:
            raise NotSent(f"no other process can be started ({error.strerror})") from error
        self._requests: Any = self._process.stdin
        self._answers: Any = self._process.stdout
        self.ended = False

    def compute(self, job: Job, share: Callable[[], int]) -> Any:
        """Compute a job; returns its result or raises its exception."""
        try:
            sent = pickle.dumps(job.call, protocol=pickle.HIGHEST_PROTOCOL)
        except Exception as error:  # objects that cannot be pickled raise many kinds of exception
            words = f"tasks cannot be sent to another process ({type(error).__name__}: {error})"
            raise NotSent(words) from error
        job.process = self
        if job.killed:
            self.kill()
        self._write((job.name, sent))
        del sent
        try:
            while True:
                try:
                    kind, what = pickle.load(self._answers)
                except Exception:  # no data, or an incomplete message
                    raise self._dead(job.name or "a call") from None
                if kind == "progress":
                    job.callback(*what)
                    self._write(share())
                elif kind == "computed":
                    return what
                elif kind == "raised":
                    raise what
                else:
                    raise NotSent(f"another process cannot read the tasks ({what})")
        finally:
            job.process = None

    def kill(self) -> None:
        """Kill the process at once; `compute` handles it."""
        self._process.kill()

    def end(self) -> None:
        """Kill the process and wait for its end."""
        self.ended = True
        self._process.kill()
        with suppress(OSError), self._process:  # waits for the process and closes the pipes
            pass

    def _write(self, what: Any) -> None:
        with suppress(OSError):  # the process is dead; reading handles it
            pickle.dump(what, self._requests, protocol=pickle.HIGHEST_PROTOCOL)
            self._requests.flush()

    def _dead(self, task: str) -> BaseException:
        try:
            code = self._process.wait(PATIENCE)
        except TimeoutExpired:
            return SolverError(f"{task}: its process sent an invalid answer")
        finally:
            self.end()
        if code == -signal.SIGINT:
            return KeyboardInterrupt()
        if code != -signal.SIGKILL:
            ended = f"signal {-code}" if code < 0 else f"status {code}"
            return TaskLost(f"{task}: its process died ({ended})")
        before, after = self._kills, memory_kills()
        if before is None or after is None:
            return TaskLost(
                f"{task}: its process died (signal 9); was there memory enough? Fewer at once take less", True
            )
        if after > before:
            words = "the system ended it for want of memory; fewer at once take less"
            return TaskLost(f"{task}: its process died (signal 9); {words}", True)
        return TaskLost(f"{task}: its process died (signal 9), killed by another process: memory was not the reason")


@contextmanager
def _ctrl_c_blocked() -> Iterator[None]:
    """Block Ctrl-C while processes are started: they receive it when they are ready, this thread afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited by processes started here
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
