"""Progress on a terminal: one line, redrawn."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Self

PATIENCE = 2.0
"""Nothing is shown before this many seconds."""
WIDTH = 24


class _Line:
    """One line of a terminal; a context manager that wipes it in the end. Nothing shows elsewhere, or when `quiet`."""

    def __init__(self, quiet: bool = False) -> None:
        self.shown = not quiet and sys.stderr.isatty()
        self._started = time.monotonic()

    def draw(self, text: str, now: float) -> None:
        """Put a text in place of the line, at a (monotonic) time."""
        if self.shown and now - self._started > PATIENCE:
            print("\r\x1b[K" + text, end="", file=sys.stderr, flush=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.shown:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


class ProgressLine(_Line):
    """What is under way and since when, for work of which nobody knows how much is left.

    Shows only on a terminal and not when `quiet`. Use it as a context manager and `tell` it what is done.
    """

    def tell(self, text: str) -> None:
        """Say what is under way."""
        now = time.monotonic()
        self.draw(f"{now - self._started:4.0f} s  {text}"[:118], now)


class ProgressBar(_Line):
    """Runs under way with their time and share, and an estimate of the time left.

    Shows only on a terminal and not when `quiet`. Use it as a context manager and pass `tell` on.
    """

    def __init__(self, total: int, quiet: bool = False) -> None:
        super().__init__(quiet)
        self.total = total
        self._first: dict[str, tuple[float, float]] = {}
        self._now: dict[str, tuple[float, float]] = {}

    def tell(self, name: str, t: float, share: float) -> None:
        """Note where a run stands and redraw."""
        now = time.monotonic()
        self._first.setdefault(name, (now, share))
        self._now[name] = (t, share)
        self.draw(self.line(now), now)

    def line(self, now: float) -> str:
        """The text of the bar at a (monotonic) time."""
        share = sum(done for _, done in self._now.values()) / max(self.total, 1)
        bar = ("#" * round(WIDTH * share)).ljust(WIDTH, ".")
        under_way = ", ".join(f"{name} t = {t:.1f} s" for name, (t, done) in self._now.items() if done < 1)
        spent = now - self._started
        left = f"about {spent / share - spent:.0f} s left" if share > 0.02 else "estimating"
        return f"[{bar}] {100 * share:3.0f} %  {left}  {under_way}"[:118]
