"""How a blade is driven: its advance or its force over time, as straight pieces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.contact.force_control import GivenForce
from ngbrain.scene.protocols import CLEAR

PROBE_DEPTH = 1e-5
"""How far (m) beyond its gap a blade of given force goes to feel the tissue."""


@dataclass(frozen=True)
class ToolMotion:
    """Advance (m) of a blade from first contact at times (s), straight in between; negative is clear of the tissue."""

    name: str
    times: tuple[float, ...]
    advance: tuple[float, ...]

    def __post_init__(self) -> None:
        _check(self.name, self.times, self.advance, "advances")

    def value(self, t: float) -> float:
        """Advance (m) at time t (s)."""
        return float(np.interp(t, self.times, self.advance))

    @property
    def working_s(self) -> float:
        """Time (s) at the full opening, while a surgeon can work."""
        return _at_most(self.times, self.advance)

    @property
    def most(self) -> float:
        """Furthest advance (m)."""
        return max(self.advance)

    @property
    def beginning(self) -> Any:
        """The first piece: the same for protocols that may share it."""
        return "advance", self.times[:2], self.advance[:2]

    def drive(self) -> Drive:
        """What moves the blade."""
        return Drive(self)


@dataclass(frozen=True)
class ForceProtocol:
    """Force (N) of a blade at times (s), straight in between, from 0 on; the blade goes as far as it takes (`forward.forced`).

    Without force it is off the tissue, and comes back as the tissue does.

    >>> from ngbrain.units import gf
    >>> round(ForceProtocol("30 gf", (0.0, 10.0, 600.0), (0.0, gf(30.0), gf(30.0))).value(5.0), 5)
    0.1471
    """

    name: str
    times: tuple[float, ...]
    force: tuple[float, ...]

    def __post_init__(self) -> None:
        _check(self.name, self.times, self.force, "forces")
        if self.force[0] != 0 or min(self.force) < 0 or not max(self.force) > 0:
            raise InputError(
                f"protocol {self.name!r} force", list(self.force), "forces (N) from 0 on, some > 0, none < 0"
            )

    def value(self, t: float) -> float:
        """Force (N) at time t (s)."""
        return float(np.interp(t, self.times, self.force))

    @property
    def working_s(self) -> float:
        """Time (s) at the full force, while a surgeon can work."""
        return _at_most(self.times, self.force)

    @property
    def most(self) -> float:
        """Largest force (N)."""
        return max(self.force)

    @property
    def beginning(self) -> Any:
        """The first piece: the same for protocols that may share it."""
        return "force", self.times[:2], self.force[:2]

    def drive(self, limit: float = np.inf) -> GivenForce:
        """What asks for the force, and takes the blade no farther than a limit (m)."""
        return GivenForce(self.times, self.force, -CLEAR, PROBE_DEPTH, limit)


def _check(name: str, times: Sequence[float], values: Sequence[float], what: str) -> None:
    if len(times) != len(values) or len(times) < 2:
        found = f"{len(times)} times, {len(values)} {what}"
        raise InputError(f"protocol {name!r}", found, "as many of each, two or more")
    if times[0] != 0 or np.any(np.diff(times) <= 0):
        raise InputError(f"protocol {name!r} times", list(times), "times that start at 0 and increase")


def _at_most(times: Sequence[float], values: Sequence[float]) -> float:
    """Time (s) at the largest of the values."""
    t, v = np.array(times), np.array(values)
    full = (v[1:] == v.max()) & (v[:-1] == v.max())
    return float(np.sum(np.diff(t)[full]))


class Drive:
    """A protocol as a `Motion`: it moves a Parameter that the blade's distance depends on."""

    def __init__(self, protocol: ToolMotion) -> None:
        self.protocol = protocol
        self.events = protocol.times[1:]
        self.parameter = ngs.Parameter(protocol.value(0.0))

    def set(self, t: float) -> None:
        """Put the blade where it is at time t."""
        self.parameter.Set(self.protocol.value(t))

    def travel(self, start: float, end: float) -> float:
        """Advance (m) between two times."""
        return self.protocol.value(end) - self.protocol.value(start)


def continuous_retraction(opening: float, ramp: float, elapsed: float, name: str = "continuous") -> ToolMotion:
    """Open at an even rate in `ramp` seconds, hold until `elapsed`."""
    return ToolMotion(name, (0.0, ramp, elapsed), (0.0, opening, opening))


def intermittent_retraction(
    opening: float, ramp: float, elapsed: float, hold: float, rest: float, name: str = "intermittent"
) -> ToolMotion:
    """Hold for `hold` s after opening, let go, rest for `rest` s from letting go to opening again, …; same rate both ways.

    A cycle is ramp + hold + rest; `elapsed` must end a hold.
    """
    rate = opening / ramp
    away = (opening + CLEAR) / rate
    if not rest > 2 * away - ramp:
        raise InputError(
            f"protocol {name!r} rest",
            f"{rest} s",
            f"more than the {2 * away - ramp:g} s that the blade needs to go and come back",
        )
    times, advance = [0.0], [0.0]
    start = 0.0
    while True:
        times += [start + ramp, min(start + ramp + hold, elapsed)]
        advance += [opening, opening]
        if times[-1] >= elapsed * (1 - 1e-12):
            break
        start = times[-1] + rest
        back = start - CLEAR / rate
        if start + ramp >= elapsed:
            raise InputError(
                f"protocol {name!r} elapsed",
                f"{elapsed} s",
                f"a time within a hold, not in the rest that ends at {start:g} s",
            )
        times += [times[-1] + away, back, start]
        advance += [-CLEAR, -CLEAR, 0.0]
    return ToolMotion(name, tuple(times), tuple(advance))


def staged_retraction(
    opening: float, ramp: float, elapsed: float, stages: int, rest: float, name: str = "staged"
) -> ToolMotion:
    """Reach the opening in equal steps at the same rate, `rest` s between them, then hold until `elapsed`."""
    times, advance = [0.0], [0.0]
    for stage in range(1, stages + 1):
        times.append(times[-1] + ramp / stages)
        advance.append(opening * stage / stages)
        last = stage == stages
        times.append(elapsed if last else times[-1] + rest)
        advance.append(advance[-1])
    return ToolMotion(name, tuple(times), tuple(advance))
