"""Processes of this machine as an executor: one task a process at a time, each single-threaded.

The processes (`ngbrain.parallel.worker`) never import the caller's `__main__`: a script needs no main guard, and may come from
stdin, from `python -c`, from a notebook or run in a thread. They end when their parent does, however that ends.
"""

from __future__ import annotations

import math
import os
import pickle
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from functools import partial
from subprocess import DEVNULL, PIPE, Popen, TimeoutExpired
from typing import Any

from ngbrain.errors import InputError, SolverError
from ngbrain.parallel.kernel import machine_memory, memory_kills
from ngbrain.parallel.tasks import Callback, TaskLost
from ngbrain.parallel.worker import START

PATIENCE = 5.0
"""Seconds until a process that has closed its pipe is gone."""


class NotSent(Exception):
    """A task cannot be computed in another process."""


class ProcessExecutor(Executor):
    """Processes of this machine behind the interface of `concurrent.futures`.

    Parameters
    ----------
    workers : int
        Processes at most; each is started when there is a task for it.
    threads : int, optional
        Threads that tasks under way share where they use `helped`; the last ones get those that are left over. By default every
        task has one, and the same bits whatever is computed beside it.

    Examples
    --------
    >>> with ProcessExecutor(2) as executor:
    ...     list(executor.map(abs, [-1, 2]))
    [1, 2]
    """

    def __init__(self, workers: int, threads: int | None = None) -> None:
        if workers < 1:
            raise InputError("workers", workers, "at least 1")
        self.workers, self.threads = workers, threads or 1
        self._waiting: deque[Job] = deque()
        self._changed = threading.Condition()
        self._servants: list[threading.Thread] = []
        self._under_way: list[Job] = []
        self._memory = machine_memory() or math.inf
        self._idle = 0
        self._over = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A call in one of the processes; the future raises `TaskLost` where its process dies."""
        return self._add(Job(None, (fn, args, kwargs)))

    def submit_task(
        self, name: str, function: Callable[..., Any], args: tuple[Any, ...], callback: Callback, memory: float = 0.0
    ) -> Job:
        """A call as `function(*args, callback=...)`; `callback` is called here, in another thread, with what it tells.

        Calls of known memory (bytes) wait until they fit beside the others.
        """
        return self._add(Job(name, (function, args, {}), callback, memory))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more; processes end when nothing waits any more."""
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
                except RuntimeError as error:  # of a program whose main thread has ended, from Python 3.12 on
                    if not self._servants:
                        self._waiting.pop()
                        raise NotSent(f"nobody can listen to another process ({error})") from error
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
        """The first that fits into memory beside what is under way; alone, any."""
        left = self._memory - sum(job.memory for job in self._under_way)
        fits = (job for job in self._waiting if job.memory <= left or not self._under_way)
        return next(fits, None)

    def _serve(self) -> None:
        """In a thread of its own: one process, one job after the other."""
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
    """The future of a call, which can be ended while it is computed."""

    def __init__(
        self, name: str | None, call: tuple[Any, ...], callback: Callback | None = None, memory: float = 0.0
    ) -> None:
        super().__init__()
        self.name, self.call, self.callback, self.memory = name, call, callback or (lambda *_: None), memory
        self.process: _Process | None = None

    def kill(self) -> None:
        """Not begun or ended at once, with its process."""
        if not self.cancel() and (process := self.process) is not None and not self.done():
            process.kill()


class _Process:
    """A process that computes, seen from here."""

    def __init__(self) -> None:
        command = [sys.executable, "-c", START, *map(str, sys.path)]
        self._kills = memory_kills()
        try:
            with _ctrl_c_blocked():
                self._process = Popen(command, stdin=PIPE, stdout=PIPE, stderr=_stderr())
        except OSError as error:
            raise NotSent(f"no other process can be started ({error.strerror})") from error
        self._requests: Any = self._process.stdin
        self._answers: Any = self._process.stdout
        self.ended = False

    def compute(self, job: Job, share: Callable[[], int]) -> Any:
        """The result of a job, or its exception, raised."""
        try:
            sent = pickle.dumps(job.call, protocol=pickle.HIGHEST_PROTOCOL)
        except Exception as error:  # whatever an object raises that does not want to be pickled
            words = f"tasks cannot be sent to another process ({type(error).__name__}: {error})"
            raise NotSent(words) from error
        job.process = self
        self._write((job.name, sent))
        del sent
        try:
            while True:
                try:
                    kind, what = pickle.load(self._answers)
                except Exception:  # nothing more, or the half of something
                    raise self._dead(job.name or "a call") from None
                if kind == "told":
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
        """At once, whatever it is doing; `compute` notices."""
        self._process.kill()

    def end(self) -> None:
        """It is gone afterwards."""
        self.ended = True
        self._process.kill()
        with suppress(OSError), self._process:  # waits for it and closes the pipes
            pass

    def _write(self, what: Any) -> None:
        with suppress(OSError):  # it is dead, which reading notices
            pickle.dump(what, self._requests, protocol=pickle.HIGHEST_PROTOCOL)
            self._requests.flush()

    def _dead(self, task: str) -> BaseException:
        try:
            code = self._process.wait(PATIENCE)
        except TimeoutExpired:
            return SolverError(f"{task}: its process answered nonsense")
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
        return TaskLost(f"{task}: its process died (signal 9), somebody's kill: memory was not the reason")


def _stderr() -> int | None:
    """That of this process, or nothing where it has none: the first pipe would take its place."""
    try:
        os.fstat(2)
    except OSError:
        return DEVNULL
    return None


@contextmanager
def _ctrl_c_blocked() -> Iterator[None]:
    """Ctrl-C goes to every process of a terminal: those started here hear of it when they are ready to, this thread afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # is what a process started here begins with
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
