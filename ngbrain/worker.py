"""What a process of `ngbrain.pool` does: it says something and waits for the reply, until it is ended or its parent is gone.

It says (kind, what): `ready`, and is sent a task's name; `told`, and is sent how many threads the task may use from now on;
`computed` or `raised`, and is sent the next task's name; or `unreadable`, of tasks that it cannot make sense of, and ends.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import sys
import threading
import traceback
from contextlib import suppress
from types import ModuleType
from typing import Any

from ngbrain.errors import SolverError
from ngbrain.threads import set_threads

START = "import sys; sys.path[:] = sys.argv[1:]; from ngbrain.worker import work; work()"
"""Python that begins it; its arguments are the parent's `sys.path`."""


def work() -> None:
    """Read tasks and replies from stdin, and speak on stdout."""
    sys.modules["__main__"] = ModuleType("__main__")  # so that nothing of the caller's is found in a namesake
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what tasks print goes where errors go, also from below Python
    sys.stdout = sys.stderr
    _hear_ctrl_c()
    replies = queue.SimpleQueue[Any]()

    def say(kind: str, what: Any) -> Any:
        message = pickle.dumps((kind, what))
        try:
            answers.write(message)
            answers.flush()
        except OSError:
            os._exit(1)
        return replies.get()

    def listen() -> None:
        with suppress(EOFError, OSError, pickle.UnpicklingError):
            while True:
                replies.put(pickle.load(requests))
        os._exit(1)  # also in the middle of a task: nobody waits for it, and a successor may write where it writes

    try:
        tasks = {name: (function, args) for name, function, args in pickle.load(requests)}
    except Exception as error:
        with suppress(OSError), answers:
            pickle.dump(("unreadable", f"{type(error).__name__}: {error}"), answers)
        return
    threading.Thread(target=listen, daemon=True).start()
    set_threads(1)
    name = say("ready", None)
    while True:
        function, args = tasks[name]
        try:
            name = say("computed", function(*args, tell=lambda *what: say("told", what)))
        except Exception as error:
            name = say("raised", _portable(error, name))


def _hear_ctrl_c() -> None:
    """Die of it without a word; the parent may be deaf, as it is in a thread. It was held back while modules were imported."""
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _portable(error: Exception, task: str) -> Exception:
    """An exception that can be raised in another process, and says there where it came from."""
    if isinstance(error, MemoryError):
        return SolverError(f"{task}: out of memory; fewer at once take less")
    error.add_note("in another process:\n" + "".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return SolverError(f"{task}: {type(error).__name__}: {error}")
    return error
