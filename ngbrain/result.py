"""What a computation gives back, whatever it is of: how it ended, what was done, and whether it may be used."""

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
    """How a computation ended."""

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
    """Base of everything that a solver, a fit or an inversion returns.

    A subclass says what its `value` is, what it has counted (`statistics`), and, where a converged computation may be wrong all
    the same, what speaks against using it (`reasons`).

    Parameters
    ----------
    status
        How it ended.
    reason
        What kept it from converging, in words; empty where it did.
    history
        What each iteration or step did.
    warnings
        What a reader has to know.

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
        """What was asked for."""
        raise NotImplementedError

    @property
    def statistics(self) -> Mapping[str, float]:
        """Name → number: what was counted."""
        return {}

    @property
    def converged(self) -> bool:
        """Whether it came to its end."""
        return self.status is Status.CONVERGED

    @property
    def reasons(self) -> list[str]:
        """What speaks against using the value."""
        return [] if self.converged else [self.reason or str(self.status)]

    @property
    def usable(self) -> bool:
        """Whether nothing does."""
        return not self.reasons

    @property
    def headline(self) -> str:
        """The value in a few words."""
        value = self.value
        if isinstance(value, Mapping):
            return ", ".join(f"{name} {_short(each)}" for name, each in value.items())
        return _short(value)

    def plot(self) -> Any:
        """A picture of it, as a matplotlib Figure; `NotImplementedError` of what has none."""
        raise NotImplementedError(f"{type(self).__name__} has no picture")

    def to_dict(self) -> dict[str, Any]:
        """As plain data."""
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
        """Write `to_dict` as JSON, whole or not at all."""
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
        cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in rows.items())
        lines = [*(f"Not usable: {reason}" for reason in self.reasons), *self.warnings]
        notes = "".join(f"<li>{escape(line)}</li>" for line in lines)
        return f"<table><caption>{type(self).__name__}</caption>{cells}</table>" + (
            f"<ul>{notes}</ul>" if notes else ""
        )


def _short(value: Any) -> str:
    """A number, or the mean of many."""
    if isinstance(value, int | float):
        return f"{value:.4g}"
    if hasattr(value, "mean") and hasattr(value, "size"):
        return f"{value.mean():.4g} in the mean of {value.size}"
    return str(value)


def _plain(value: Any) -> Any:
    """As JSON has it: arrays as lists, what is not finite as null."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(name): _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
