"""Independent computations side by side: one process a thread, each single-threaded, so that results do not depend on how many."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any

from ngbrain.threads import set_threads

Task = tuple[str, Callable[..., Any], tuple[Any, ...]]
"""Name, function (importable by name) and its arguments; it is also passed `tell`."""
Tell = Callable[[str, float, float], None]
"""Called with a run's name, its time (s) and the share of it that is done."""

_queue: Any = None
_parent: int = 0
_tasks: dict[str, Task] = {}


def run(tasks: Sequence[Task], workers: int, tell: Tell | None = None) -> dict[str, Any]:
    """Results by task name; `tell(name, t, share)` hears of progress. The first exception ends the others and is raised."""
    tell = tell or (lambda *_: None)
    if workers <= 1:
        set_threads(1)
        return {name: function(*args, tell=tell) for name, function, args in tasks}
    context = multiprocessing.get_context("spawn")  # NGSolve's threads do not survive a fork
    messages = context.Queue()
    done = threading.Event()
    listener = threading.Thread(target=_listen, args=(messages, done, tell), daemon=True)
    listener.start()
    results = {}
    # Tasks go with the start of a process: in the executor's own pipe megabytes would block it for ever once nobody reads.
    shared = (messages, os.getpid(), list(tasks))
    with ProcessPoolExecutor(min(workers, len(tasks)), context, _start, shared) as executor:
        try:
            with _undisturbed():
                futures = {executor.submit(_call, name): name for name, _, _ in tasks}
            for future in as_completed(futures):
                results[futures[future]] = future.result()
        except BaseException:
            for process in list(executor._processes.values()):
                process.terminate()
            executor.shutdown(wait=False, cancel_futures=True)
            raise
        finally:
            done.set()
    return {name: results[name] for name, _, _ in tasks}


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


def _start(messages: Any, parent: int, tasks: Sequence[Task]) -> None:
    global _queue, _parent
    _queue, _parent = messages, parent
    _tasks.update({task[0]: task for task in tasks})
    set_threads(1)


def _call(name: str) -> Any:
    _, function, args = _tasks[name]
    return function(*args, tell=_report)


def _report(name: str, t: float, share: float) -> None:
    if os.getppid() != _parent:  # the run was killed: do not go on writing beside its successor
        os._exit(1)
    _queue.put((name, t, share))
