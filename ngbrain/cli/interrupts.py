"""Ctrl-C in a command: a clean end if possible, and a prompt one otherwise."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

EXIT_INTERRUPTED = 130
GRACE = 5.0
"""Time (s) for a clean end. Python notices Ctrl-C when it regains control, which in a mesh generator may take a minute."""


@contextmanager
def interruptible(words: str) -> Iterator[None]:
    """Raise `KeyboardInterrupt` on Ctrl-C; after `GRACE`, or on a second Ctrl-C, end the process at once with a message.

    Any error after Ctrl-C counts as an interrupt: libraries that are interrupted during their import report other errors.
    """
    before = signal.getsignal(signal.SIGINT)
    if before in (signal.SIG_IGN, None) or threading.current_thread() is not threading.main_thread():
        yield
        return
    heard, over = threading.Event(), threading.Event()
    reading, writing = os.pipe()
    os.set_blocking(writing, False)

    def interrupt(*_: Any) -> None:
        if not heard.is_set():
            heard.set()
            raise KeyboardInterrupt

    def end() -> None:
        if not over.is_set():
            print(words, file=sys.stderr, flush=True)
            os._exit(EXIT_INTERRUPTED)

    def watch() -> None:
        with open(reading, "rb", buffering=0) as signals:
            while (number := signals.read(1)) and number[0] != signal.SIGINT:
                pass
            patience = threading.Timer(GRACE, end)
            patience.daemon = True
            if number:
                patience.start()
                if signals.read(1):  # a second one; there is nothing more to read when it is over
                    end()
                patience.cancel()

    threading.Thread(target=watch, daemon=True).start()
    woken = signal.set_wakeup_fd(writing)
    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    except BaseException:
        if heard.is_set():
            raise KeyboardInterrupt from None
        raise
    finally:
        over.set()
        signal.signal(signal.SIGINT, before)
        signal.set_wakeup_fd(woken)
        os.close(writing)
