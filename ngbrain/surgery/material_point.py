"""Retraction of a homogeneous tissue column between a blade and a fixed support, the cheapest model of a protocol.

A column of depth L is compressed to the stretch λ = 1 - s/L by a blade that has advanced by s, or by a given force; the blade
never pulls. The stress is that of `materials.lab`, with the time steps of a body. The model contains the protocol and the tissue's
law but no geometry: ratios between protocols are meaningful results, pressures in a head are not.

Why rests cannot lower the dose at equal working time, at small strain: with a blade that returns to the same opening, let a branch
of modulus 1 have the overstress h at the end of a hold. Before the next opening it has -(1 - h) exp(-rest/τ) where the strain was
returned to zero, and after it 1 - (1 - h) exp(-rest/τ) ≥ h. So no hold starts lower than the previous one ended, nor higher than
the first one began, for any sum of branches: for any monotonic relaxation, including that of a draining fluid. After a free
release tissue recovers less; of 20 000 random combinations of branches, holds and rests none had a lower dose either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.errors import InputError
from ngbrain.look import BriefText
from ngbrain.materials import Law, Viscous, lab
from ngbrain.materials.points import number
from ngbrain.materials.viscous import viscous
from ngbrain.surgery.protocols import ToolMotion
from ngbrain.units import to_minutes, to_mmHg

RELEASED = 1e-9
"""Pressure, relative to the peak, below which a blade counts as released."""


@dataclass(frozen=True, repr=False)
class LoadingHistory(BriefText):
    """Pressure and displacement of a column over time.

    Parameters
    ----------
    t : (n,) array
        Times (s).
    advance : (n,) array
        Displacement (m) of the wall.
    pressure : (n,) array
        Pressure (Pa).
    events : tuple of float
        Times (s) at which the blade's rate changes.
    """

    t: np.ndarray
    advance: np.ndarray
    pressure: np.ndarray
    events: tuple[float, ...]

    @property
    def curve(self) -> TimeCurve:
        """Pressure (mmHg) over time."""
        return TimeCurve(self.t, to_mmHg(self.pressure), self.events)

    def peaks(self) -> np.ndarray:
        """The largest pressure (Pa) of each contact period."""
        pressed = np.concatenate([[False], self.pressure > RELEASED * self.pressure.max(), [False]])
        ends = np.flatnonzero(pressed[1:] != pressed[:-1]).reshape(-1, 2)
        return np.array([self.pressure[start:end].max() for start, end in ends])


@dataclass(frozen=True)
class Column:
    """Incompressible viscoelastic tissue column under a blade.

    The pressure is the force over the current area, p = -λ P with the nominal stress P.

    Parameters
    ----------
    material : Viscous or Law
        Such as `materials.constants(name).law()`.
    depth : float
        Depth (m) of the column.
    mode : str
        "uniaxial" (free sides) or "planar" (one pair of sides fixed).
    steps : int
        Time steps in each linear piece of a protocol, short ones first; second order in their length.

    Raises
    ------
    InputError
        Another mode, a depth that is not positive, or a blade that advances through the column.

    Examples
    --------
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
        """Loading by a prescribed advance of the blade, which separates where the tissue does not follow."""
        return self.push_each([self.depth], protocol)[0]

    def push_each(self, depths: Sequence[float], protocol: ToolMotion) -> list[LoadingHistory]:
        """Loading of columns with several depths by one protocol, in the time of two.

        Parameters
        ----------
        depths : sequence of float
            Depths (m).
        protocol : ToolMotion

        Returns
        -------
        list of LoadingHistory

        Raises
        ------
        InputError
            The blade advances through the shallowest column.
        """
        if max(protocol.advance) >= min(depths):
            far = f"less than the depth of {min(depths):g} m"
            raise InputError(f"protocol {protocol.name!r} advance", f"{max(protocol.advance):g} m", far)
        t, deep = self._step_times(protocol.times), np.asarray(depths)[:, None]
        asked = 1 - np.interp(t, protocol.times, protocol.advance) / deep
        stretch, stress = lab.press(viscous(self.material), self.mode, t, asked)
        rows = zip(deep * (1 - stretch), -stretch * stress, strict=True)
        return [LoadingHistory(t, advance, pressure, protocol.times) for advance, pressure in rows]

    def load(self, times: Sequence[float], force: Sequence[float]) -> LoadingHistory:
        """Loading by a prescribed force, piecewise linear.

        Parameters
        ----------
        times : sequence of float
            Times (s), from 0 on.
        force : sequence of float
            Force per unloaded area (Pa), not negative.

        Returns
        -------
        LoadingHistory
        """
        if min(force) < 0:
            raise InputError("force", min(force), "at least 0: a blade does not pull")
        t = self._step_times(times)
        nominal = np.interp(t, times, force)
        stretch = lab.creep(viscous(self.material), self.mode, -nominal, t)
        return LoadingHistory(t, self.depth * (1 - stretch), stretch * nominal, tuple(times))

    def _step_times(self, events: Sequence[float]) -> np.ndarray:
        """Times of the steps: equal steps of log(1 + time since the event), in units of the shortest relaxation time."""
        tau = min((number(branch.tau) for branch in viscous(self.material).branches), default=1.0)
        even = np.linspace(0, 1, self.steps + 1)[1:]
        pieces = [a + tau * np.expm1(even * np.log1p((b - a) / tau)) for a, b in pairwise(events)]
        t = np.concatenate([[events[0]], *pieces])
        t[:: self.steps] = events
        return t


def dose_with_recovery(pressure: TimeCurve, recovery: float) -> float:
    """Largest dose ∫ p dt if the accumulated dose decays exponentially while the blade is released.

    Parameters
    ----------
    pressure : TimeCurve
        Pressure over time (s).
    recovery : float
        Time constant (s) of the decay; ∞ gives `injury.dose`. No such constant has been measured for brain under a blade: it is
        an assumption.

    Returns
    -------
    float
        In (unit of the pressure) minutes.

    Examples
    --------
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
