"""Independent computations side by side: one process a thread, each single-threaded, so that results do not depend on how many.

The processes (`ngbrain.worker`) never import the caller's `__main__`: a script needs no main guard, and may come from stdin, from
`python -c`, from a notebook or run in a thread. They end when their parent does, however that ends.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from subprocess import DEVNULL, PIPE, Popen, TimeoutExpired
from typing import Any

from ngbrain.errors import SolverError
from ngbrain.progress import LOG
from ngbrain.threads import threads
from ngbrain.worker import START

Task = tuple[str, Callable[..., Any], tuple[Any, ...]]
"""Name, function and its arguments; it is also passed `tell`."""
Tell = Callable[..., Any]
"""Called with what a task tells: a run's name, its time (s) and the share of it that is done; or what has been agreed on.

The one that a task is passed returns how many threads it may use from now on.
"""

POLL, PATIENCE = 0.5, 5.0
"""Seconds between looks whether the program has been interrupted; and until a process that has closed its pipe is gone."""


class _NotSent(Exception):
    """Tasks cannot be computed in other processes."""


def run(
    tasks: Sequence[Task], workers: int, tell: Tell | None = None, finished: Callable[[str, Any], None] | None = None
) -> dict[str, Any]:
    """Compute tasks, so many at a time.

    Where they cannot be sent to other processes (a function of the user's `__main__`, an object that no pickle holds), they are
    computed in this one, one after the other, which a warning of the logger `ngbrain` says.

    Parameters
    ----------
    tasks : sequence of Task
        With different names.
    workers : int
        How many at a time; with 1 no process is started.
    tell : callable, optional
        Called in this thread with what a task tells.
    finished : callable, optional
        Called in this thread with a task's name and result as soon as it has ended.

    Returns
    -------
    dict
        Results by task name, in the order of the tasks.

    Raises
    ------
    SolverError
        A task's process died, for want of memory, or because it was killed; the message names the task.
    Exception
        The first that a task raises. It ends the others.
    """
    tell, finished = tell or (lambda *_: None), finished or (lambda *_: None)
    if workers > 1:
        try:
            return _side_by_side(tasks, workers, tell, finished)
        except _NotSent as reason:
            words = "%s; what was to be computed side by side is computed in this process, one after the other"
            LOG.warning(words, reason)
    return _here(tasks, max(workers, 1), tell, finished)


def _here(tasks: Sequence[Task], share: int, tell: Tell, finished: Callable[[str, Any], None]) -> dict[str, Any]:
    def told(*what: Any) -> int:
        _heed()
        tell(*what)
        return share

    results = dict[str, Any]()
    with threads(1):
        for name, function, args in tasks:
            results[name] = function(*args, tell=told)
            finished(name, results[name])
    return results


def _side_by_side(
    tasks: Sequence[Task], workers: int, tell: Tell, finished: Callable[[str, Any], None]
) -> dict[str, Any]:
    try:
        sent = pickle.dumps(list(tasks))
    except Exception as error:  # whatever an object raises that does not want to be pickled
        raise _NotSent(f"tasks cannot be sent to another process ({type(error).__name__}: {error})") from error
    waiting, results = deque(name for name, *_ in tasks), dict[str, Any]()
    inbox = queue.SimpleQueue[tuple[_Worker, str, Any]]()
    with ExitStack() as crew:
        for _ in range(min(workers, len(tasks))):
            worker = _Worker(inbox)
            crew.callback(worker.end)
            worker.begin(sent)
        while len(results) < len(tasks):
            worker, kind, what = _next(inbox)
            if kind == "told":
                tell(*what)
                worker.send(max(1, workers // (len(tasks) - len(results))))
                continue
            if kind == "unreadable":
                raise _NotSent(f"another process cannot read the tasks ({what})")
            if kind == "raised":
                raise what
            if kind == "computed":
                results[worker.task] = what
                finished(worker.task, what)
            if waiting:
                worker.task = waiting.popleft()
                worker.send(worker.task)
            else:
                worker.end()
    return {name: results[name] for name, *_ in tasks}


def _next(inbox: queue.SimpleQueue[Any]) -> Any:
    while True:
        with suppress(queue.Empty):
            return inbox.get(timeout=POLL)
        _heed()


def _heed() -> None:
    """Ctrl-C is heard in the main thread only: in another, stop when it has ended the program."""
    if isinstance(getattr(sys, "last_value", None), KeyboardInterrupt) and not hasattr(sys, "ps1"):
        raise KeyboardInterrupt


class _Worker:
    """A process that computes tasks, seen from here: what it says comes into `inbox`, with it, as (worker, kind, what)."""

    def __init__(self, inbox: queue.SimpleQueue[tuple[_Worker, str, Any]]) -> None:
        command = [sys.executable, "-c", START, *map(str, sys.path)]
        try:
            with _ctrl_c_blocked():
                self._process = Popen(command, stdin=PIPE, stdout=PIPE, stderr=_stderr())
        except OSError as error:
            raise _NotSent(f"no other process can be started ({error.strerror})") from error
        self._requests: Any = self._process.stdin
        self._answers: Any = self._process.stdout
        self._inbox, self._ended, self.task = inbox, False, ""

    def begin(self, sent: bytes) -> None:
        """Send it the tasks and listen, in a thread, as it is seconds until it reads. Raises `_NotSent` where there can be none."""
        try:
            threading.Thread(target=self._listen, args=(sent,), daemon=True).start()
        except RuntimeError as error:  # of a program whose main thread has ended, in Python 3.12
            raise _NotSent(f"nobody can listen to another process ({error})") from error

    def send(self, what: Any) -> None:
        """A reply."""
        self._write(pickle.dumps(what))

    def end(self) -> None:
        """At once, whatever it is doing."""
        self._ended = True
        self._process.kill()
        with suppress(OSError), self._process:  # waits for it and closes the pipes
            pass

    def _listen(self, sent: bytes) -> None:
        self._write(sent)
        try:
            while True:
                self._inbox.put((self, *pickle.load(self._answers)))
        except Exception:  # nothing more, or the half of something
            if not self._ended:
                self._inbox.put((self, "raised", self._dead()))

    def _write(self, what: bytes) -> None:
        with suppress(OSError):  # it is dead, which `_listen` notices
            self._requests.write(what)
            self._requests.flush()

    def _dead(self) -> BaseException:
        try:
            code = self._process.wait(PATIENCE)
        except TimeoutExpired:
            return SolverError(f"{self.task}: its process answered nonsense")
        if code == -signal.SIGINT:
            return KeyboardInterrupt()
        ended = f"signal {-code}" if code < 0 else f"status {code}"
        if self.task:
            return SolverError(
                f"{self.task}: its process died ({ended}); was there memory enough? Fewer at once take less"
            )
        words = "was there memory enough? With threads=1 none is started"
        return SolverError(f"a process died before its work began ({ended}); {words}")


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


@contextmanager
def helped(tell: Tell) -> Iterator[Tell]:
    """Within a task: use its share of the threads, more once fewer tasks than threads are left; noticed when it tells.

    NGSolve's task manager then adds up in another order, so that results differ by round-off from those of one thread.
    """
    with ExitStack() as stack:
        used = 1

        def told(*what: Any) -> None:
            nonlocal used
            share = tell(*what)
            if share != used:
                stack.close()
                stack.enter_context(threads(share))
                used = share

        yield told
