"""Independent computations side by side: one process a thread, each single-threaded, so that results do not depend on how many.

Where that may depend on them by round-off, a task can use the threads that are left over: `helped`.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from multiprocessing.process import BaseProcess
from typing import Any

from ngbrain.errors import SolverError
from ngbrain.threads import set_threads, threads

Task = tuple[str, Callable[..., Any], tuple[Any, ...]]
"""Name, function (importable by name) and its arguments; it is also passed `tell`."""
Tell = Callable[..., None]
"""Called with what a task tells: a run's name, its time (s) and the share of it that is done; or what has been agreed on."""

_queue: Any = None
_begun: Any = None
_running: Any = None
_workers: int = 1
_parent: int = 0
_tasks: dict[str, Task] = {}


def run(tasks: Sequence[Task], workers: int, tell: Tell | None = None) -> dict[str, Any]:
    """Results by task name; `tell` hears of progress. The first exception ends the others and is raised.

    Raises `SolverError`, naming the task, when its process dies: for want of memory, or because it was killed.
    """
    tell = tell or (lambda *_: None)
    if workers <= 1:
        set_threads(1)
        return {name: function(*args, tell=tell) for name, function, args in tasks}
    context = multiprocessing.get_context("spawn")  # NGSolve's threads do not survive a fork
    messages, begun, running = context.Queue(), context.SimpleQueue(), context.Value("i", 0)
    done = threading.Event()
    listener = threading.Thread(target=_listen, args=(messages, done, tell), daemon=True)
    listener.start()
    results, doing = dict[str, Any](), dict[int, str]()
    # Tasks go with the start of a process: in the executor's own pipe megabytes would block it for ever once nobody reads.
    shared = (messages, begun, running, workers, os.getpid(), list(tasks))
    with ProcessPoolExecutor(min(workers, len(tasks)), context, _start, shared) as executor:
        try:
            with _undisturbed():
                futures = {executor.submit(_call, name): name for name, _, _ in tasks}
            processes = dict(executor._processes)
            for future in as_completed(futures):
                _heard(begun, doing)
                results[futures[future]] = future.result()
        except BrokenProcessPool as error:
            executor.shutdown(cancel_futures=True)
            _heard(begun, doing)
            raise SolverError(_dead(processes, doing)) from error
        except BaseException:
            for process in list(executor._processes.values()):
                process.terminate()
            executor.shutdown(wait=False, cancel_futures=True)
            raise
        finally:
            done.set()
    return {name: results[name] for name, _, _ in tasks}


def _heard(begun: Any, doing: dict[int, str]) -> None:
    """Process → the task that it last began; taken up at once, as a pipe holds some hundred."""
    while not begun.empty():
        pid, name = begun.get()
        doing[pid] = name


def _dead(processes: Mapping[int, BaseProcess], doing: Mapping[int, str]) -> str:
    """Which task's process died; those that only went down with it were terminated."""
    codes = {
        pid: process.exitcode for pid, process in processes.items() if process.exitcode not in (0, -signal.SIGTERM)
    }
    names = sorted({doing[pid] for pid in codes if pid in doing})
    if not names:
        return "a process died before its work began: a script that starts several has to do so under if __name__ == '__main__'"
    ended = ", ".join(f"signal {-code}" if code and code < 0 else f"status {code}" for code in codes.values())
    return f"{', '.join(names)}: its process died ({ended}); was there memory enough? Fewer at once take less"


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Ctrl-C goes to every process of a terminal: those started here never hear of it, and this one once all are started."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    heard: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # is what a process started here begins with
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
    if heard:
        raise KeyboardInterrupt


def _listen(messages: Any, done: threading.Event, tell: Tell) -> None:
    while not done.is_set():
        try:
            tell(*messages.get(timeout=0.2))
        except queue.Empty:
            continue


def _start(messages: Any, begun: Any, running: Any, workers: int, parent: int, tasks: Sequence[Task]) -> None:
    global _queue, _begun, _running, _workers, _parent
    _queue, _begun, _running, _workers, _parent = messages, begun, running, workers, parent
    _tasks.update({task[0]: task for task in tasks})
    set_threads(1)


def _call(name: str) -> Any:
    _, function, args = _tasks[name]
    _begun.put((os.getpid(), name))
    _count(1)
    try:
        return function(*args, tell=_report)
    finally:
        _count(-1)


def _count(change: int) -> None:
    with _running.get_lock():
        _running.value += change


@contextmanager
def helped(tell: Tell) -> Iterator[Tell]:
    """Within a task: use its share of the threads, more once fewer tasks than threads are left; noticed when it tells.

    NGSolve's task manager then adds up in another order, so that results differ by round-off from those of one thread.
    """
    with ExitStack() as stack:
        used = 1

        def told(*what: Any) -> None:
            nonlocal used
            tell(*what)
            share = max(1, _workers // _running.value) if _running else 1
            if share != used:
                stack.close()
                stack.enter_context(threads(share))
                used = share

        yield told


def _report(*told: Any) -> None:
    if os.getppid() != _parent:  # the run was killed: do not go on writing beside its successor
        os._exit(1)
    _queue.put(told)
