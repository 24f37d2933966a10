"""What a process of `ProcessExecutor` does: it is sent a task, says something and waits for the reply, until its parent is gone.

It is sent (name, pickled function and arguments). It says (kind, what): `told`, and is sent how many threads the task may use
from now on; then `computed`, `raised` or, of a task that it cannot make sense of, `unreadable`, and is sent the next task.
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
"""Python that begins it; its arguments are the parent's `sys.path`."""


def work() -> None:
    """Read tasks and replies from stdin, and speak on stdout."""
    sys.modules["__main__"] = ModuleType("__main__")  # so that nothing of the caller's is found in a namesake
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what tasks print goes where errors go, also from below Python
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
        say("told", what)
        return replies.get()

    def listen() -> None:
        with suppress(EOFError, OSError, pickle.UnpicklingError):
            while True:
                replies.put(pickle.load(requests))
        os._exit(1)  # also in the middle of a task: nobody waits for it, and a successor may write where it writes

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
            told = {} if name is None else {"callback": callback}
            say("computed", function(*args, **kwargs, **told))
        except Exception as error:
            say("raised", picklable_error(error, name or getattr(function, "__name__", "task")))
        del function, args, kwargs, sent


def _hear_ctrl_c() -> None:
    """Die of it without a word; the parent may be deaf, as it is in a thread. It was held back while modules were imported."""
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
