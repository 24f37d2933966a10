"""Progress of long computations: a bar on a terminal or in a notebook, and a record of the logger `ngbrain` every 30 s.

The bar is tqdm's, of the extra `progress`; without it, or in a notebook without ipywidgets, there is one plain line.
"""

from __future__ import annotations

import contextvars
import functools
import inspect
import logging
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

LOG = logging.getLogger("ngbrain")
PATIENCE, APART, EVERY = 2.0, 0.2, 30.0
"""Seconds before anything is shown, between two updates, and between log records."""
TICK = 1.0
"""Seconds after which the time on show is renewed where nothing is reported."""
WIDTH, LINE = 24, 118
"""Number of characters of a plain bar, and of a line."""


@dataclass(frozen=True)
class Step:
    """What a computation reports.

    Parameters
    ----------
    text : str
        What is done.
    share : float, optional
        Share of the computation that is done, 0 to 1; None where it is not known.
    """

    text: str
    share: float | None = None

    def __str__(self) -> str:
        if self.share is None:
            return self.text
        bar = ("#" * round(WIDTH * self.share)).ljust(WIDTH, ".")
        return f"[{bar}] {100 * self.share:3.0f} %  {self.text}"


Show = Callable[[Step | None, float], Any]
"""Replaces what is shown by a step and the time (s) since the start; None clears it."""
Words = Callable[..., str | Step]
"""Turns the arguments of `callback` into a text or a step."""


def display(quiet: bool = False) -> Show | None:
    """Function that shows progress below a notebook cell or on the terminal; None elsewhere, in a worker process, or if `quiet`."""
    return None if quiet else notebook() or terminal()


def terminal(quiet: bool = False) -> Show | None:
    """Function that shows progress in the last line of the terminal; None without one, in a worker process, or if `quiet`."""
    if quiet or multiprocessing.parent_process() or not sys.stderr.isatty():
        return None
    if find_spec("tqdm"):
        return _bar(
            f"{{bar:{WIDTH}}}",
            file=sys.stderr,
            **({"dynamic_ncols": True} if _columns() else {"ncols": LINE, "nrows": 2}),
        )

    def show(step: Step | None, seconds: float) -> None:
        line = "" if step is None else _line(step, seconds)[:LINE]
        print("\r\x1b[K" + line, end="", file=sys.stderr, flush=True)

    return show


def _columns() -> int:
    """Width of the terminal; 0 where it is not known, with which tqdm would show nothing."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError):
        return 0


def notebook() -> Show | None:
    """Function that shows progress below a notebook cell; None outside a notebook."""
    ipython = sys.modules.get("IPython")
    if not hasattr(ipython and ipython.get_ipython(), "kernel"):
        return None
    if find_spec("tqdm") and find_spec("ipywidgets"):
        return _bar("{bar}")
    from IPython.display import DisplayHandle

    handle = DisplayHandle()
    put = handle.display

    def show(step: Step | None, seconds: float) -> None:
        nonlocal put
        put({"text/plain": "" if step is None else _line(step, seconds)}, raw=True)
        put = handle.update

    return show


def _bar(bar_format: str, **place: Any) -> Show:
    """A bar of tqdm; a text without a bar where the share is not known."""
    bar: Any = None

    def show(step: Step | None, seconds: float) -> None:
        nonlocal bar
        counted = step is not None and step.share is not None
        if bar is not None and (step is None or counted != (bar.total is not None)):
            bar.n = bar.total or 0.0  # in a notebook, what is closed before its end stays there in red
            bar.close()
            bar = None
        if step is None:
            return
        text = _line(Step(step.text), seconds)
        if bar is None:
            from tqdm.auto import tqdm

            shape = "{percentage:3.0f} %|" + bar_format + "|{desc}" if counted else "{desc}"
            bar = tqdm(
                total=1.0 if counted else None,
                desc=text,
                initial=step.share or 0.0,
                bar_format=shape,
                leave=False,
                **place,
            )
        bar.desc, bar.n = text, step.share or 0.0
        bar.refresh()

    return show


def _line(step: Step, seconds: float) -> str:
    return f"{seconds:4.0f} s  {step}"


def first_message(*what: Any) -> str | Step:
    """First argument of the callback, as a text unless it is a step."""
    return what[0] if isinstance(what[0], Step) else str(what[0])


class Progress:
    """Progress of a computation on show: use it as a context manager and pass its `callback` on.

    Parameters
    ----------
    show : callable, optional
        `display()`, `terminal()` or `notebook()`. The logger gets the text in any case. Of several that are at work, one within
        the other, only the first is shown.
    words : callable, optional
        Turns the arguments of the callback into a text or a step.
    text : str, optional
        Text before the first call.
    """

    _first: Progress | None = None

    def __init__(self, show: Show | None = None, words: Words = first_message, text: str = "at work") -> None:
        self.step = Step(text)
        self._show, self._words, self._over = show, words, threading.Event()
        self._started = time.monotonic()
        self._shown = 0.0
        self._lock = threading.Lock()

    @property
    def text(self) -> str:
        """The present text."""
        return str(self.step)

    def callback(self, *what: Any) -> None:
        """Replace the current text."""
        found = self._words(*what)
        self.step = found if isinstance(found, Step) else Step(found)
        self._update(APART)

    def say(self, text: str) -> None:
        """Print a text permanently."""
        self._wipe()
        print(text, flush=True)

    def _update(self, apart: float) -> None:
        """Show the current step, unless that was done less than `apart` seconds ago."""
        with self._lock:
            now = time.monotonic()
            if self._show and now > max(self._started + PATIENCE, self._shown + apart) and not self._over.is_set():
                self._show(self.step, now - self._started)
                self._shown = now

    def _wipe(self) -> None:
        with self._lock:
            if self._show and self._shown:
                self._show(None, 0.0)

    def _tick(self) -> None:
        """Renew what is shown every second, and log it every half minute."""
        logged = self._started
        while not self._over.wait(min(TICK, EVERY) if self._show else EVERY):
            self._update(TICK / 2)
            if (now := time.monotonic()) >= logged + EVERY:
                LOG.info(_line(self.step, now - self._started))
                logged = now

    def __enter__(self) -> Self:
        if Progress._first is None:
            Progress._first = self
        else:
            self._show = None
        with suppress(RuntimeError):  # Python 3.12 starts no threads after the main thread has ended
            # In a copy of the context, by which a kernel knows the cell that an output belongs to.
            threading.Thread(target=contextvars.copy_context().run, args=(self._tick,), daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._wipe()
        if Progress._first is self:
            Progress._first = None


class RunProgress:
    """Progress of several runs side by side; each reports its name, its time (s) and the share of it that is done.

    >>> print(RunProgress(2)("continuous", 30.0, 0.5))
    [######..................]  25 %  estimating  continuous t = 30.0 s
    """

    def __init__(self, total: int) -> None:
        self.total, self._started = max(total, 1), time.monotonic()
        self._first: dict[str, float] = {}
        self._now: dict[str, tuple[float, float]] = {}

    def __call__(self, name: str, t: float, share: float) -> Step:
        """Update one run and return the share of all that is done, with the estimated time left.

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
        Step
        """
        self._first.setdefault(name, share)
        self._now[name] = t, share
        done = sum(share for _, share in self._now.values())
        own = done - sum(self._first.values())  # without what was finished before this run was resumed
        under_way = ", ".join(f"{name} t = {t:.1f} s" for name, (t, share) in self._now.items() if share < 1)
        to_go = (time.monotonic() - self._started) * (self.total - done) / own if own > 0.02 * self.total else None
        left = "estimating" if to_go is None else f"about {to_go:.0f} s left"
        return Step(f"{left}  {under_way}", min(done / self.total, 1.0))


def log_progress(*_: Any) -> None:
    """Default of the argument `callback` of `reporting` functions: progress is logged, and shown in a notebook or on a terminal."""


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
            with Progress(display(), words(given.arguments), f"{function.__name__}: at work") as progress:
                given.arguments["callback"] = progress.callback
                return function(*given.args, **given.kwargs)

        return report

    return of
