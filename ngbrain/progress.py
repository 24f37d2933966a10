"""Progress of long computations: a line on a terminal or in a notebook, and a record of the logger `ngbrain` every 30 s."""

from __future__ import annotations

import functools
import inspect
import logging
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
Show = Callable[[str], Any]
"""Replaces the shown text; an empty text clears it."""
Words = Callable[..., str]
"""Turns the arguments of `callback` into a text."""

LOG = logging.getLogger("ngbrain")
PATIENCE, APART, EVERY = 2.0, 0.2, 30.0
"""Seconds before the line is shown, between two updates, and between log records."""
WIDTH = 24


def terminal(quiet: bool = False) -> Show | None:
    """Function that overwrites one line of the terminal; None if `quiet` or if stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        return None
    return lambda text: print("\r\x1b[K" + text[:118], end="", file=sys.stderr, flush=True)


def notebook() -> Show | None:
    """Function that overwrites one line below a notebook cell; None outside a notebook."""
    ipython = sys.modules.get("IPython")
    if not hasattr(ipython and ipython.get_ipython(), "kernel"):
        return None
    from IPython.display import DisplayHandle

    handle = DisplayHandle()
    put = handle.display

    def show(text: str) -> None:
        nonlocal put
        put({"text/plain": text}, raw=True)
        put = handle.update

    return show


def first_message(*what: Any) -> str:
    """Text of the first argument of the callback."""
    return str(what[0])


class Progress:
    """Progress line of a computation: use it as a context manager and pass its `callback` on.

    Parameters
    ----------
    show : callable, optional
        `terminal()` or `notebook()`. The logger gets the text in any case.
    words : callable, optional
        Turns the arguments of the callback into a text.
    text : str, optional
        Text before the first call.
    """

    def __init__(self, show: Show | None = None, words: Words = first_message, text: str = "at work") -> None:
        self.text = text
        self._show, self._words, self._over = show, words, threading.Event()
        self._started = time.monotonic()
        self._shown = 0.0

    def callback(self, *what: Any) -> None:
        """Replace the current text."""
        self.text = self._words(*what)
        now = time.monotonic()
        if self._show and now > max(self._started + PATIENCE, self._shown + APART):
            self._show(self._line(now))
            self._shown = now

    def say(self, text: str) -> None:
        """Print a text permanently."""
        self._wipe()
        print(text, flush=True)

    def _wipe(self) -> None:
        if self._show and self._shown:
            self._show("")

    def _line(self, now: float) -> str:
        return f"{now - self._started:4.0f} s  {self.text}"

    def _log(self) -> None:
        while not self._over.wait(EVERY):
            LOG.info(self._line(time.monotonic()))

    def __enter__(self) -> Self:
        with suppress(RuntimeError):  # Python 3.12 starts no threads after the main thread has ended
            threading.Thread(target=self._log, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._wipe()


class RunProgress:
    """Progress bar over several runs side by side; each reports its name, its time (s) and the share of it that is done.

    >>> RunProgress(2)("continuous", 30.0, 0.5)
    '[######..................]  25 %  estimating  continuous t = 30.0 s'
    """

    def __init__(self, total: int) -> None:
        self.total, self._started = max(total, 1), time.monotonic()
        self._first: dict[str, float] = {}
        self._now: dict[str, tuple[float, float]] = {}

    def __call__(self, name: str, t: float, share: float) -> str:
        """Update one run and return the text of the bar with the estimated time left.

        Parameters
        ----------
        name : str
            Name of the run.
        t : float
            Its own time (s).
        share : float
            Share of the run that is done, 0 to 1.

        Returns
        -------
        str
        """
        self._first.setdefault(name, share)
        self._now[name] = t, share
        done = sum(share for _, share in self._now.values())
        own = done - sum(self._first.values())  # without what was finished before this run was resumed
        bar = ("#" * round(WIDTH * done / self.total)).ljust(WIDTH, ".")
        under_way = ", ".join(f"{name} t = {t:.1f} s" for name, (t, share) in self._now.items() if share < 1)
        to_go = (time.monotonic() - self._started) * (self.total - done) / own if own > 0.02 * self.total else None
        left = "estimating" if to_go is None else f"about {to_go:.0f} s left"
        return f"[{bar}] {100 * done / self.total:3.0f} %  {left}  {under_way}"


def log_progress(*_: Any) -> None:
    """Default of the argument `callback` of `reporting` functions: progress is logged, and shown in a notebook."""


def reporting(
    words: Callable[[Mapping[str, Any]], Words] = lambda _: first_message,
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of functions whose argument `callback` is `log_progress` by default; `words` makes the texts from the arguments,
    by name.
    """

    def of(function: Callable[P, R]) -> Callable[P, R]:
        signature = inspect.signature(function)

        @functools.wraps(function)
        def report(*args: P.args, **kwargs: P.kwargs) -> R:
            given = signature.bind(*args, **kwargs)
            given.apply_defaults()
            if given.arguments["callback"] is not log_progress:
                return function(*args, **kwargs)
            with Progress(notebook(), words(given.arguments), f"{function.__name__}: at work") as progress:
                given.arguments["callback"] = progress.callback
                return function(*given.args, **given.kwargs)

        return report

    return of
