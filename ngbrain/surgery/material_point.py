"""A retraction at one point: tissue in an even state between a blade and what holds it, the cheapest model of a protocol.

A column of depth L is pressed to λ = 1 - s/L by a blade that has advanced by s, or by a given force; the blade never pulls.
Its stress is that of the laboratory (`materials.lab`), whose steps are those of a body. It knows time and the tissue's law, and
nothing of shapes: ratios between protocols are its answers, pressures of a head are not.

Why rests cannot lower the dose of equal work, at small strain: with a blade that goes to one opening, a branch of modulus 1 has the
overstress h at the end of a hold, -(1 - h) exp(-rest/τ) before the next opening where the strain was put back to zero, and
1 - (1 - h) exp(-rest/τ) ≥ h after it. So no hold starts lower than the last one ended, nor higher than the first began, in any sum
of branches: in any relaxation that falls monotonously, a draining fluid's too. Let go, tissue comes back less far; of 20 000 random
pairs of branches, holds and rests none had a lower dose either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.errors import InputError
from ngbrain.materials import Law, Viscous, lab
from ngbrain.materials.points import number
from ngbrain.materials.viscous import viscous
from ngbrain.surgery.protocols import ToolMotion
from ngbrain.units import to_minutes, to_mmHg

RELEASED = 1e-9
"""Pressure, of the peak, below which a blade counts as released."""


@dataclass(frozen=True)
class LoadingHistory:
    """Pressure (Pa) and advance of the wall (m) at times t (s), arrays of one shape, and the times where the blade changes."""

    t: np.ndarray
    advance: np.ndarray
    pressure: np.ndarray
    events: tuple[float, ...]

    @property
    def curve(self) -> TimeCurve:
        """Pressure (mmHg) over time."""
        return TimeCurve(self.t, to_mmHg(self.pressure), self.events)

    def peaks(self) -> np.ndarray:
        """The largest pressure (Pa) of each time that the blade presses."""
        pressed = np.concatenate([[False], self.pressure > RELEASED * self.pressure.max(), [False]])
        ends = np.flatnonzero(pressed[1:] != pressed[:-1]).reshape(-1, 2)
        return np.array([self.pressure[start:end].max() for start, end in ends])


@dataclass(frozen=True)
class Column:
    """Incompressible relaxing tissue of `depth` (m) under a blade, its sides free ("uniaxial") or one pair held ("planar").

    material   a law that relaxes or not, such as `materials.constants(name).law()`
    steps      time steps in each straight piece of a protocol, short ones first; second order in their length

    The pressure is a force over the area that it acts on now, p = -λ P with the nominal stress P. Raises `InputError` for
    another mode, a depth that is not positive, and a blade that goes through the column.

    >>> from ngbrain.materials import constants
    >>> from ngbrain.surgery.protocols import continuous_retraction
    >>> course = Column(constants("griffiths2024:white_matter").law(), 50e-3).push(continuous_retraction(5e-3, 10.0, 600.0))
    >>> left = course.pressure[-1] / course.pressure.max()
    >>> print(f"{to_mmHg(course.pressure.max()):.1f} mmHg, after ten minutes {left:.2f} of it")
    4.6 mmHg, after ten minutes 0.36 of it
    """

    material: Viscous | Law
    depth: float
    mode: str = "uniaxial"
    steps: int = 24

    def __post_init__(self) -> None:
        if self.mode not in ("uniaxial", "planar"):
            raise InputError("Column.mode", repr(self.mode), "uniaxial or planar")
        if not self.depth > 0:
            raise InputError("Column.depth", self.depth, "a length > 0 (m)")
        if self.steps < 1:
            raise InputError("Column.steps", self.steps, "at least 1")

    def push(self, protocol: ToolMotion) -> LoadingHistory:
        """A blade whose advance is given: it presses, and lets go where the tissue does not follow."""
        return self.push_each([self.depth], protocol)[0]

    def push_each(self, depths: Sequence[float], protocol: ToolMotion) -> list[LoadingHistory]:
        """The same for columns of several depths (m), in the time of two."""
        if max(protocol.advance) >= min(depths):
            far = f"less than the depth of {min(depths):g} m"
            raise InputError(f"protocol {protocol.name!r} advance", f"{max(protocol.advance):g} m", far)
        t, deep = self._moments(protocol.times), np.asarray(depths)[:, None]
        asked = 1 - np.interp(t, protocol.times, protocol.advance) / deep
        stretch, stress = lab.press(viscous(self.material), self.mode, t, asked)
        rows = zip(deep * (1 - stretch), -stretch * stress, strict=True)
        return [LoadingHistory(t, advance, pressure, protocol.times) for advance, pressure in rows]

    def load(self, times: Sequence[float], force: Sequence[float]) -> LoadingHistory:
        """A blade whose force is given: per unloaded area (Pa) at times (s) from 0 on, straight in between, none of it negative."""
        if min(force) < 0:
            raise InputError("force", min(force), "at least 0: a blade does not pull")
        t = self._moments(times)
        nominal = np.interp(t, times, force)
        stretch = lab.creep(viscous(self.material), self.mode, -nominal, t)
        return LoadingHistory(t, self.depth * (1 - stretch), stretch * nominal, tuple(times))

    def _moments(self, events: Sequence[float]) -> np.ndarray:
        """Times of steps: even in log(1 + time since the event), in the shortest time of relaxation."""
        tau = min((number(branch.tau) for branch in viscous(self.material).branches), default=1.0)
        even = np.linspace(0, 1, self.steps + 1)[1:]
        pieces = [a + tau * np.expm1(even * np.log1p((b - a) / tau)) for a, b in pairwise(events)]
        t = np.concatenate([[events[0]], *pieces])
        t[:: self.steps] = events
        return t


def dose_with_recovery(pressure: TimeCurve, recovery: float) -> float:
    """Largest dose ∫ p dt (unit of p, minutes) if what has come together decays while the blade is released.

    recovery   time (s) in which it falls to 1/e; no such time has been measured for brain under a blade: an assumption.
               With ∞ it is `injury.dose`

    >>> t = np.array([0.0, 60.0, 61.0, 119.0, 120.0, 180.0])
    >>> pressed = TimeCurve(t, np.array([9.0, 9.0, 0.0, 0.0, 9.0, 9.0]), t)
    >>> round(dose_with_recovery(pressed, 1e9), 2), round(dose_with_recovery(pressed, 1e-9), 2)
    (18.15, 9.08)
    """
    if not recovery > 0:
        raise InputError("recovery", recovery, "a time > 0 (s)")
    x, whole = pressure.polynomial.x, pressure.polynomial.antiderivative()
    released = np.maximum(pressure(x[:-1]), pressure((x[1:] + x[:-1]) / 2)) <= RELEASED * pressure(x).max()
    now = largest = 0.0
    for length, part, free in zip(np.diff(x), np.diff(whole(x)), released, strict=True):
        now = now * float(np.exp(-length / recovery)) if free else now + float(part)
        largest = max(largest, now)
    return to_minutes(largest)
