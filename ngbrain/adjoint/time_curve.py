"""A quantity over time from its values at the ends of steps: integral, time above a threshold, and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy

from ngbrain.errors import InputError
from ngbrain.look import BriefText

Array = np.ndarray


class Interpolation(StrEnum):
    """Interpolation of a quantity between two time steps."""

    LINEAR = "linear"
    MONOTONE_CUBIC = "monotone cubic"


@dataclass(frozen=True, eq=False, repr=False)
class TimeCurve(BriefText):
    """Values at the ends of time steps as a function of time.

    The monotone cubic follows long steps of a hold to a part of a percent, where linear interpolation lies above the solution.

    Parameters
    ----------
    times : array (n,)
        Increasing times (s).
    values : array (n,)
        Values, in any unit.
    events : sequence of float, optional
        Times (s) at which the slope of a cubic may jump: steps end on them, and the first and the last are the curve's ends. None:
        only these.
    interpolation : Interpolation

    Raises
    ------
    InputError
        For times that do not increase, or are not as many as the values.

    References
    ----------
    Fritsch & Butland 1984, 10.1137/0905021.

    Examples
    --------
    >>> pressed = TimeCurve([0.0, 10.0, 20.0], [0.0, 40.0, 0.0], [0.0, 10.0, 20.0])
    >>> pressed.integral(), pressed.above(20.0), pressed.peak
    (400.0, (10.0, 10.0), 40.0)
    """

    times: Sequence[float] | Array
    values: Sequence[float] | Array
    events: Sequence[float] | Array | None = None
    interpolation: Interpolation = Interpolation.MONOTONE_CUBIC

    def __post_init__(self) -> None:
        times, values = np.asarray(self.times, float), np.asarray(self.values, float)
        if times.ndim != 1 or len(times) < 2 or times.shape != values.shape or not np.all(np.diff(times) > 0):
            found = f"of shape {times.shape} with values of shape {values.shape}"
            raise InputError("times", found, "two or more increasing times, with a value of each")

    def __call__(self, t: float | Array) -> Array:
        """Value at times (s)."""
        return np.asarray(self.polynomial(t))

    @cached_property
    def pieces(self) -> list[slice]:
        """Steps between consecutive events, both ends included."""
        ends = np.asarray(self.times)[[0, -1]] if self.events is None else self.events
        return [slice(i, j + 1) for i, j in pairwise(np.searchsorted(self.times, ends))]

    @cached_property
    def polynomial(self) -> scipy.interpolate.PPoly:
        """Piecewise polynomial between steps."""
        t, values, first, last = *self._arrays, self.pieces[0].start, self.pieces[-1].stop
        if self.interpolation is Interpolation.LINEAR:
            t, values = t[first:last], values[first:last]
            return scipy.interpolate.PPoly(np.array([np.diff(values) / np.diff(t), values[:-1]]), t)
        pieces = [scipy.interpolate.PchipInterpolator(t[piece], values[piece]) for piece in self.pieces]
        return scipy.interpolate.PPoly(np.concatenate([piece.c for piece in pieces], axis=1), t[first:last])

    @property
    def _arrays(self) -> tuple[Array, Array]:
        return np.asarray(self.times, float), np.asarray(self.values, float)

    @property
    def peak(self) -> float:
        """Largest value; it is at the end of a step, as the interpolation is monotone between steps."""
        return float(self.polynomial(self.polynomial.x).max())

    def integral(self, until: float | None = None) -> float:
        """∫ dt from the start to the end, or until a time (s)."""
        start, end = self.polynomial.x[[0, -1]]
        return float(self.polynomial.integrate(start, end if until is None else until))

    def crossings(self, value: float) -> Array:
        """Times (s) at which the curve crosses a value; none while it is constant at it."""
        found = self.polynomial.solve(value, discontinuity=False, extrapolate=False)
        return np.asarray(found[np.isfinite(found)])

    def above(self, threshold: float) -> tuple[float, float]:
        """Total and longest uninterrupted time (s) above a threshold."""
        curve = self.polynomial
        ends = np.unique([*curve.x[[0, -1]], *self.crossings(threshold)])
        lengths = np.where(curve((ends[1:] + ends[:-1]) / 2) > threshold, np.diff(ends), 0.0)
        total = longest = current = 0.0
        for length in lengths.tolist():
            current = current + length if length else 0.0
            total, longest = total + length, max(longest, current)
        return total, longest

    def integral_slope(self) -> Array:
        """Derivative of the integral with respect to each value (n,)."""
        h = np.diff(self._arrays[0])[:, None]
        return self._gather(h / 2, h / 2, h**2 / 12, -(h**2) / 12)[:, 0]

    def smoothed_time_above(self, count: tuple[Array, Array], threshold: float, width: float) -> tuple[float, Array]:
        """Smoothed time above a threshold, ∫ 1/(1 + exp(-(c - threshold)/width)) dt, by Gauss quadrature in each step.

        Parameters
        ----------
        count : tuple of array
            Quadrature points and weights on [0, 1].
        threshold, width : float
            In the unit of the values.

        Returns
        -------
        time : float
            In seconds.
        gradient : array (n,)
            Its derivative with respect to each value.
        """
        s, weights = count
        t, values = self._arrays
        h, d = np.diff(t)[:, None], self._slopes[0]
        s2, s3 = s**2, s**3
        basis = 1 - 3 * s2 + 2 * s3, 3 * s2 - 2 * s3, h * (s - 2 * s2 + s3), h * (s3 - s2)
        begin, end = d
        at = basis[0] * values[:-1, None] + basis[1] * values[1:, None]
        at = at + basis[2] * begin[:, None] + basis[3] * end[:, None]
        part = 1 / (1 + np.exp(-np.clip((at - threshold) / width, -700, 700)))
        slope = h * weights * part * (1 - part) / width
        by = [np.sum(slope * each, axis=1, keepdims=True) for each in basis]
        return float(np.sum(h * weights * part)), self._gather(*by)[:, 0]

    def _gather(self, begin: Array, end: Array, rise_begin: Array, rise_end: Array) -> Array:
        """Derivative with respect to the values, from those with respect to values and slopes at the ends of each step (m,
        1)."""
        found = np.zeros((len(self.times), 1))
        for piece in self.pieces:
            steps = slice(piece.start, piece.stop - 1)
            found[steps] += begin[steps]
            found[steps.start + 1 : piece.stop] += end[steps]
        if self.interpolation is Interpolation.MONOTONE_CUBIC:
            by_begin, by_end = self._slopes[1]
            found += by_begin.T @ rise_begin + by_end.T @ rise_end
        return found

    @cached_property
    def _slopes(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Slopes at the beginning and the end of each step (n - 1,), and how they change with the values (n - 1, n)."""
        t, values = self._arrays
        n = len(t)
        slopes, by = (np.zeros(n - 1), np.zeros(n - 1)), (np.zeros((n - 1, n)), np.zeros((n - 1, n)))
        for piece in self.pieces:
            steps = slice(piece.start, piece.stop - 1)
            if self.interpolation is Interpolation.LINEAR:
                for each in slopes:
                    each[steps] = np.diff(values[piece]) / np.diff(t[piece])
                continue
            found, change = monotone_slopes(t[piece], values[piece])
            slopes[0][steps], slopes[1][steps] = found[:-1], found[1:]
            by[0][steps, piece], by[1][steps, piece] = change[:-1], change[1:]
        return slopes, by


def monotone_slopes(t: Array, values: Array) -> tuple[Array, Array]:
    """Slopes of a monotone cubic interpolant and their derivatives.

    The slopes are those of `scipy.interpolate.PchipInterpolator`, which has no derivative. At a local extremum of the values the
    slope is 0, and so is its derivative.

    Parameters
    ----------
    t : array (n,)
        Increasing times (s).
    values : array (n,)
        Values.

    Returns
    -------
    slopes : array (n,)
        Slopes at the points.
    jacobian : array (n, n)
        Their derivatives with respect to the values.
    """
    h, n = np.diff(t), len(t)
    secant = np.diff(values) / h
    by = np.zeros((n, n - 1))  # contribution of the secants
    if n == 2:
        slopes, by[:] = np.repeat(secant, 2), 1.0
    else:
        slopes = np.zeros(n)
        before, after = secant[:-1], secant[1:]
        same = before * after > 0
        one, other = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
        safe = [np.where(same, each, 1.0) for each in (before, after)]
        mean = (one + other) / (one / safe[0] + other / safe[1])
        slopes[1:-1] = np.where(same, mean, 0.0)
        inner = np.arange(1, n - 1)
        for k, weight in enumerate((one, other)):
            by[inner, inner - 1 + k] = np.where(same, mean**2 * weight / (one + other) / safe[k] ** 2, 0.0)
        slopes[0], by[0, :2] = _end_slope(h[0], h[1], secant[0], secant[1])
        slopes[-1], last = _end_slope(h[-1], h[-2], secant[-1], secant[-2])
        by[-1, -2:] = last[::-1]
    to_secants = (np.eye(n - 1, n, 1) - np.eye(n - 1, n)) / h[:, None]
    return slopes, by @ to_secants


def _end_slope(near: float, next_to: float, secant: float, following: float) -> tuple[float, Array]:
    """Slope at an end, by a three-point formula limited to the sign of the first secant and to three times its size."""
    by = np.array([2 * near + next_to, -near]) / (near + next_to)
    slope = float(by @ [secant, following])
    if np.sign(slope) != np.sign(secant):
        return 0.0, np.zeros(2)
    if np.sign(secant) != np.sign(following) and abs(slope) > 3 * abs(secant):
        return 3 * secant, np.array([3.0, 0.0])
    return slope, by
