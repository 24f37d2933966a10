"""Main loop of a process of `ProcessExecutor`: receive a task, send messages and wait for replies, until the parent ends.

The process receives (name, pickled function and arguments). It sends (kind, content): `progress`, to which the reply is the
number of threads that the task may use from now on; then `computed`, `raised`, or `unreadable` for a task that cannot be
unpickled, to which the reply is the next task.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import sys
import threading
from contextlib import suppress
from types import ModuleType
from typing import Any

from ngbrain.parallel.tasks import picklable_error
from ngbrain.threads import set_threads

START = "import sys; sys.path[:] = sys.argv[1:]; from ngbrain.parallel.worker import work; work()"
"""Python code that starts the process; its arguments are the parent's `sys.path`."""


def work() -> None:
    """Read tasks and replies from stdin, and write messages to stdout."""
    sys.modules["__main__"] = ModuleType("__main__")  # so that the caller's `__main__` is not looked up here
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of tasks goes to stderr, also from compiled code
    sys.stdout = sys.stderr
    _hear_ctrl_c()
    replies = queue.SimpleQueue[Any]()

    def say(kind: str, what: Any) -> None:
        message = pickle.dumps((kind, what))
        try:
            answers.write(message)
            answers.flush()
        except OSError:
            os._exit(1)

    def callback(*what: Any) -> int:
        say("progress", what)
        return replies.get()

    def listen() -> None:
        with suppress(EOFError, OSError, pickle.UnpicklingError):
            while True:
                replies.put(pickle.load(requests))
        os._exit(1)  # also within a task: nobody waits for it, and a successor may write the same files

    threading.Thread(target=listen, daemon=True).start()
    set_threads(1)
    while True:
        name, sent = replies.get()
        try:
            function, args, kwargs = pickle.loads(sent)
        except Exception as error:
            say("unreadable", f"{type(error).__name__}: {error}")
            continue
        try:
            extra = {} if name is None else {"callback": callback}
            say("computed", function(*args, **kwargs, **extra))
        except Exception as error:
            say("raised", picklable_error(error, name or getattr(function, "__name__", "task")))
        del function, args, kwargs, sent


def _hear_ctrl_c() -> None:
    """Let Ctrl-C end the process silently, as the parent may ignore it in a thread. It was blocked while modules were imported."""
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
