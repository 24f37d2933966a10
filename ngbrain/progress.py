"""A progress bar for a terminal: which run, its time, what is left."""

from __future__ import annotations

import sys
import time
from types import TracebackType

PATIENCE = 2.0
"""Nothing is shown before this many seconds."""
WIDTH = 24


class ProgressBar:
    """One line, redrawn: runs under way with their time and share, and an estimate of the time left.

    Shows only on a terminal and not when `quiet`. Use it as a context manager and pass `tell` on.
    """

    def __init__(self, total: int, quiet: bool = False) -> None:
        self.total = total
        self.shown = not quiet and sys.stderr.isatty()
        self._started = time.monotonic()
        self._first: dict[str, tuple[float, float]] = {}
        self._now: dict[str, tuple[float, float]] = {}

    def tell(self, name: str, t: float, share: float) -> None:
        """Note where a run stands and redraw."""
        now = time.monotonic()
        self._first.setdefault(name, (now, share))
        self._now[name] = (t, share)
        if self.shown and now - self._started > PATIENCE:
            print("\r\x1b[K" + self.line(now), end="", file=sys.stderr, flush=True)

    def line(self, now: float) -> str:
        """The text of the bar at a (monotonic) time."""
        share = sum(done for _, done in self._now.values()) / max(self.total, 1)
        bar = ("#" * round(WIDTH * share)).ljust(WIDTH, ".")
        under_way = ", ".join(f"{name} t = {t:.1f} s" for name, (t, done) in self._now.items() if done < 1)
        spent = now - self._started
        left = f"about {spent / share - spent:.0f} s left" if share > 0.02 else "estimating"
        return f"[{bar}] {100 * share:3.0f} %  {left}  {under_way}"[:118]

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.shown:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
