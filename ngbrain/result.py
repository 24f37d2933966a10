"""Base class of all results: status, history, statistics, and reasons against using the value."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, is_dataclass
from enum import StrEnum
from html import escape
from pathlib import Path
from typing import Any

from ngbrain.atomic import atomic_write


class Status(StrEnum):
    """Final status of a computation."""

    CONVERGED = "converged"
    STOPPED = "stopped before it converged"
    STALLED = "no convergence"
    INVERTED = "inverted element"
    SINGULAR = "singular matrix"
    NOT_FINITE = "not finite"
    PENETRATION = "penetration"
    INACCURATE = "error over the tolerance"


@dataclass(kw_only=True, repr=False, eq=False)
class Result:
    """Base class of everything that a solver, a fit or an inversion returns.

    A subclass defines its `value`, its counts (`statistics`), and the `reasons` against using the value even though the
    computation converged.

    Parameters
    ----------
    status : Status, optional
        Final status.
    reason : str, optional
        Why the computation did not converge; empty if it did.
    history : list, optional
        Record of each iteration or step.
    warnings : list of str, optional
        Warnings for the reader of the result.

    Examples
    --------
    >>> @dataclass(repr=False)
    ... class Root(Result):
    ...     x: float
    ...
    ...     @property
    ...     def value(self):
    ...         return self.x
    ...
    ...     @property
    ...     def statistics(self):
    ...         return {"iterations": len(self.history)}
    >>> Root(1.5, status=Status.CONVERGED, history=[2.0, 1.6, 1.5])
    Root: 1.5; converged; 3 iterations
    >>> Root(1.5).usable, Root(1.5).reasons
    (False, ['stopped before it converged'])
    """

    status: Status = Status.STOPPED
    reason: str = ""
    history: list[Any] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def value(self) -> Any:
        """The computed value."""
        raise NotImplementedError

    @property
    def statistics(self) -> Mapping[str, float]:
        """Counts by name."""
        return {}

    @property
    def converged(self) -> bool:
        """Whether the computation converged."""
        return self.status is Status.CONVERGED

    @property
    def reasons(self) -> list[str]:
        """Reasons against using the value."""
        return [] if self.converged else [self.reason or str(self.status)]

    @property
    def usable(self) -> bool:
        """Whether there is no reason against using the value."""
        return not self.reasons

    @property
    def headline(self) -> str:
        """The value in a few words."""
        value = self.value
        if isinstance(value, Mapping):
            return ", ".join(f"{name} {_short(each)}" for name, each in value.items())
        return _short(value)

    def plot(self) -> Any:
        """Plot the result as a matplotlib figure; `NotImplementedError` if it has no plot."""
        raise NotImplementedError(f"{type(self).__name__} has no plot")

    def to_dict(self) -> dict[str, Any]:
        """The result as plain data."""
        return {
            "result": type(self).__name__,
            "value": self.value,
            "status": str(self.status),
            "usable": self.usable,
            "reasons": self.reasons,
            "statistics": dict(self.statistics),
            "warnings": list(self.warnings),
        }

    def save(self, path: str | Path) -> Path:
        """Write `to_dict` as JSON, atomically."""
        path, text = Path(path), json.dumps(_plain(self.to_dict()), indent=1, allow_nan=False)
        atomic_write(path, lambda part: part.write_text(text, encoding="utf-8"))
        return path

    def __repr__(self) -> str:
        counts = [f"{number:g} {name.replace('_', ' ')}" for name, number in self.statistics.items()]
        state = [str(self.status), *([] if self.usable or not self.converged else ["not to be used"])]
        return f"{type(self).__name__}: {'; '.join([self.headline, *state, *counts])}"

    def _repr_html_(self) -> str:
        rows = {"value": self.headline, "status": str(self.status), "usable": "yes" if self.usable else "no"}
        rows |= {name.replace("_", " "): f"{number:g}" for name, number in self.statistics.items()}
        lines = [*(f"Not usable: {reason}" for reason in self.reasons), *self.warnings]
        notes = "".join(f"<li>{escape(line)}</li>" for line in lines)
        return html_table(type(self).__name__, rows) + (f"<ul>{notes}</ul>" if notes else "")


def html_table(caption: str, rows: Mapping[str, str]) -> str:
    """Table of names and texts, as a notebook shows it.

    Parameters
    ----------
    caption : str
    rows : mapping
        Name → text.

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> html_table("Body", {"mesh": "a < b"})
    '<table><caption>Body</caption><tr><th>mesh</th><td>a &lt; b</td></tr></table>'
    """
    cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in rows.items())
    return f"<table><caption>{caption}</caption>{cells}</table>"


def _short(value: Any) -> str:
    """Text of a number, or of the mean of an array."""
    if isinstance(value, int | float):
        return f"{value:.4g}"
    if hasattr(value, "mean") and hasattr(value, "size"):
        return f"{value.mean():.4g} in the mean of {value.size}"
    return str(value)


def _plain(value: Any) -> Any:
    """JSON-compatible data: arrays as lists, non-finite numbers as null."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(name): _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
