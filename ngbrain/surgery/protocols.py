"""Retraction protocols: the advance or the force of a blade over time, piecewise linear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.contact.force_control import PrescribedForce
from ngbrain.scene.protocols import CLEAR

PROBE_DEPTH = 1e-5
"""Distance (m) beyond its gap that a force-controlled blade advances to detect the tissue."""


@dataclass(frozen=True)
class ToolMotion:
    """Prescribed advance of a blade over time, piecewise linear.

    Parameters
    ----------
    name : str
    times : tuple of float
        Times (s), starting at 0 and increasing.
    advance : tuple of float
        Advance (m) from first contact at these times; negative values are clear of the tissue.

    Raises
    ------
    InputError
        Different numbers of times and advances, fewer than two, or times that do not increase from 0.
    """

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
        """Time (s) at full opening, during which a surgeon can work."""
        return _time_of_maximum(self.times, self.advance)

    @property
    def maximum(self) -> float:
        """Largest advance (m)."""
        return max(self.advance)

    @property
    def beginning(self) -> Any:
        """Key of the first piece; protocols with equal keys can share its computation."""
        return "advance", self.times[:2], self.advance[:2]

    def drive(self) -> Drive:
        """The motion as a `Drive`."""
        return Drive(self)


@dataclass(frozen=True)
class ForceProtocol:
    """Prescribed force of a blade over time, piecewise linear; its advance is an unknown (`ngbrain.forward.contact.force_control`).

    Without force the blade is clear of the tissue and returns as the tissue recovers.

    Parameters
    ----------
    name : str
    times : tuple of float
        Times (s), starting at 0 and increasing.
    force : tuple of float
        Forces (N) at these times: 0 at first, none negative, at least one positive.

    Raises
    ------
    InputError
        Times or forces outside these limits.

    Examples
    --------
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
        """Time (s) at full force, during which a surgeon can work."""
        return _time_of_maximum(self.times, self.force)

    @property
    def maximum(self) -> float:
        """Largest force (N)."""
        return max(self.force)

    @property
    def beginning(self) -> Any:
        """Key of the first piece; protocols with equal keys can share its computation."""
        return "force", self.times[:2], self.force[:2]

    def drive(self, limit: float = np.inf) -> PrescribedForce:
        """The force control, which advances the blade no farther than `limit` (m)."""
        return PrescribedForce(self.times, self.force, -CLEAR, PROBE_DEPTH, limit)


def _check(name: str, times: Sequence[float], values: Sequence[float], what: str) -> None:
    if len(times) != len(values) or len(times) < 2:
        found = f"{len(times)} times, {len(values)} {what}"
        raise InputError(f"protocol {name!r}", found, "as many of each, two or more")
    if times[0] != 0 or np.any(np.diff(times) <= 0):
        raise InputError(f"protocol {name!r} times", list(times), "times that start at 0 and increase")


def _time_of_maximum(times: Sequence[float], values: Sequence[float]) -> float:
    """Time (s) at the largest value."""
    t, v = np.array(times), np.array(values)
    full = (v[1:] == v.max()) & (v[:-1] == v.max())
    return float(np.sum(np.diff(t)[full]))


class Drive:
    """A tool motion as a `Motion` of the time stepper: it sets a Parameter that the blade's signed distance depends on.

    Parameters
    ----------
    protocol : ToolMotion
    """

    def __init__(self, protocol: ToolMotion) -> None:
        self.protocol = protocol
        self.events = protocol.times[1:]
        self.parameter = ngs.Parameter(protocol.value(0.0))

    def set(self, t: float) -> None:
        """Move the blade to its position at time t (s)."""
        self.parameter.Set(self.protocol.value(t))

    def travel(self, start: float, end: float) -> float:
        """Advance between two times.

        Parameters
        ----------
        start, end : float
            Times (s).

        Returns
        -------
        float
            Advance (m).
        """
        return self.protocol.value(end) - self.protocol.value(start)


def continuous_retraction(opening: float, ramp: float, elapsed: float, name: str = "continuous") -> ToolMotion:
    """Continuous retraction: open at a constant rate, then hold.

    Parameters
    ----------
    opening : float
        Advance (m) of the blade.
    ramp : float
        Time (s) to reach it.
    elapsed : float
        End (s) of the hold.
    name : str, optional

    Returns
    -------
    ToolMotion
    """
    return ToolMotion(name, (0.0, ramp, elapsed), (0.0, opening, opening))


def intermittent_retraction(
    opening: float, ramp: float, elapsed: float, hold: float, rest: float, name: str = "intermittent"
) -> ToolMotion:
    """Intermittent retraction: open and hold, release, rest, open again, …; opening and release have the same rate.

    Parameters
    ----------
    opening : float
        Advance (m) of the blade.
    ramp : float
        Time (s) to reach it.
    elapsed : float
        End (s) of the protocol; it must lie within a hold.
    hold : float
        Duration (s) of a hold.
    rest : float
        Time (s) from release to the next opening. One cycle takes ramp + hold + rest.
    name : str, optional

    Returns
    -------
    ToolMotion

    Raises
    ------
    InputError
        A rest too short for the blade to leave and return, or an end outside a hold.
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
    """Staged retraction: reach the opening in equal steps at the same rate, with rests between them, then hold.

    Parameters
    ----------
    opening : float
        Final advance (m) of the blade.
    ramp : float
        Total time (s) of the steps.
    elapsed : float
        End (s) of the last hold.
    stages : int
        Number of steps.
    rest : float
        Time (s) between two steps.
    name : str, optional

    Returns
    -------
    ToolMotion
    """
    times, advance = [0.0], [0.0]
    for stage in range(1, stages + 1):
        times.append(times[-1] + ramp / stages)
        advance.append(opening * stage / stages)
        last = stage == stages
        times.append(elapsed if last else times[-1] + rest)
        advance.append(advance[-1])
    return ToolMotion(name, tuple(times), tuple(advance))
