"""Numbers made of a model's data, as a model of their own: dose and time above a threshold of a run, amplitude and phase of waves.

d' = T(d(θ)) ,    J' δθ = T' J δθ ,    J'ᵀ w = Re Jᵀ conj(T'ᵀ w) ,    (w·d')'' δθ = (T'ᵀw · d)'' δθ + Re Jᵀ conj((T'ᵀ w)' J δθ)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.adjoint.reduced import Model
from ngbrain.adjoint.time_curve import Interpolation, TimeCurve
from ngbrain.errors import InputError, check_shape
from ngbrain.materials.base import check_parameter

Array = np.ndarray
CLOSE = 1e-4
"""Of two arguments of the logistic function: nearer ones have their means by a series."""
GAUSS = 24
"""Points in each interval of a cubic at which it is asked whether it is above a threshold."""


class DerivedQuantity(ABC):
    """Real numbers made of a model's data.

    Attributes
    ----------
    name : str
        In words.
    """

    name: str

    @abstractmethod
    def value(self, data: Array) -> Array:
        """T(d), real."""

    @abstractmethod
    def jvp(self, data: Array, change: Array) -> Array:
        """T' δd, as `value`."""

    @abstractmethod
    def vjp(self, data: Array, w: Array) -> Array:
        """T'ᵀ w, as `data`, such that Re Σ conj(T'ᵀw) · δd = w · T' δd."""

    def bend(self, data: Array, w: Array, change: Array) -> Array:
        """How `vjp` changes along a change of the data."""
        raise InputError(type(self).__name__, "asked for second derivatives", "a quantity that has them")


class OfWaves(DerivedQuantity):
    """A number for each complex displacement (m) of waves; `InputError` where one is 0, which has no phase, its size no slope."""

    @staticmethod
    def _size(data: Array) -> Array:
        size = np.abs(data)
        if still := int(np.sum(size == 0)):
            raise InputError("data", f"0 in {still} of {data.size} displacements", "points and components that move")
        return size


class Amplitude(OfWaves):
    """|u|."""

    name = "amplitude"

    def value(self, data: Array) -> Array:
        """|u|."""
        return np.abs(data)

    def jvp(self, data: Array, change: Array) -> Array:
        """Re(ū δu)/|u|."""
        return np.asarray((np.conj(data) * change).real / self._size(data))

    def vjp(self, data: Array, w: Array) -> Array:
        """w u/|u|."""
        return np.asarray(w * data / self._size(data))

    def bend(self, data: Array, w: Array, change: Array) -> Array:
        """w (δu - u Re(ū δu)/|u|²)/|u|."""
        size = self._size(data)
        return np.asarray(w * (change - data * (np.conj(data) * change).real / size**2) / size)


class Phase(OfWaves):
    """arg u (rad, -π to π)."""

    name = "phase"

    def value(self, data: Array) -> Array:
        """arg u."""
        return np.angle(data)

    def jvp(self, data: Array, change: Array) -> Array:
        """Im(ū δu)/|u|²."""
        return np.asarray((np.conj(data) * change).imag / self._size(data) ** 2)

    def vjp(self, data: Array, w: Array) -> Array:
        """w i u/|u|², which is w i/ū."""
        return np.asarray(1j * w * data / self._size(data) ** 2)

    def bend(self, data: Array, w: Array, change: Array) -> Array:
        """-w i conj(δu)/ū²."""
        return np.asarray(-1j * w * np.conj(change) / np.conj(data) ** 2)


class OverTime(DerivedQuantity):
    """A number for each column of a run's data (m, k): an integral over its times, of a `TimeCurve`.

    A run begins at rest at 0 s, where what is seen is taken to be 0.

    Parameters
    ----------
    times : array (m,)
        Of the data's rows (s), as `RunModel.times` has them.
    interpolation : Interpolation
        Between them: straight lines, or the monotone cubic of a retraction's report.
    events : sequence of float, optional
        See `TimeCurve`.
    """

    def __init__(
        self,
        times: Sequence[float] | Array,
        interpolation: Interpolation = Interpolation.LINEAR,
        events: Sequence[float] | None = None,
    ) -> None:
        self.times, self.interpolation, self.events = np.asarray(times, float), interpolation, events
        if self.times.ndim != 1 or not np.all(np.diff(self.times, prepend=0.0) > 0):
            raise InputError("times", np.array2string(self.times, threshold=4), "increasing, after 0 s")

    def curves(self, data: Array) -> list[TimeCurve]:
        """Of each column."""
        check_shape("data", np.shape(data), (len(self.times), np.shape(data)[-1]))
        times, rest = np.concatenate([[0.0], self.times]), np.zeros((1, data.shape[1]))
        return [TimeCurve(times, each, self.events, self.interpolation) for each in np.vstack([rest, data]).T]

    @property
    def steps(self) -> Array:
        """Lengths of the intervals (m, 1) s."""
        return np.diff(self.times, prepend=0.0)[:, None]

    def sides(self, data: Array) -> tuple[Array, Array]:
        """Data at the beginning and the end of each interval."""
        check_shape("data", np.shape(data), (len(self.times), np.shape(data)[-1]))
        return np.concatenate([np.zeros((1, data.shape[1])), data[:-1]]), data

    @abstractmethod
    def gradient(self, data: Array) -> Array:
        """How each column's number changes with its data, as `data`."""

    def jvp(self, data: Array, change: Array) -> Array:
        """By the slope."""
        return np.asarray((self.gradient(data) * change).sum(axis=0))

    def vjp(self, data: Array, w: Array) -> Array:
        """The same transposed."""
        return self.gradient(data) * w


class Dose(OverTime):
    """∫ d dt, such as that of a pressure (Pa s).

    >>> Dose([10.0, 20.0]).value(np.array([[4.0], [4.0]])).tolist()
    [60.0]
    """

    name = "dose"

    def value(self, data: Array) -> Array:
        """Of the curve."""
        return np.array([curve.integral() for curve in self.curves(data)])

    def gradient(self, data: Array) -> Array:
        """Half of the intervals on both sides, and what a cubic bends."""
        return np.array([curve.integral_slope()[1:] for curve in self.curves(data)]).T

    def bend(self, data: Array, w: Array, change: Array) -> Array:
        """Nothing of straight lines; `InputError` of a cubic."""
        if self.interpolation is not Interpolation.LINEAR:
            return super().bend(data, w, change)
        return np.zeros_like(data)


@dataclass
class _Above:
    """∫ 1/(1 + exp(-x)) over intervals in which x goes evenly from a to b: mean, and slopes by a and b."""

    mean: Array
    by_begin: Array
    by_end: Array


class TimeAbove(OverTime):
    """Time (s) that data spend above a threshold.

    That has no derivative where data touch the threshold; the time counts by 1/(1 + exp(-(d - threshold)/width)), which has.

    Parameters
    ----------
    times, interpolation, events
        See `OverTime`.
    threshold : float
        In the unit of the data.
    width : float
        Over which the count rises from .27 to .73, twice; the smaller, the nearer to `raw`.
    """

    name = "time above a threshold"

    def __init__(
        self,
        times: Sequence[float] | Array,
        threshold: float,
        width: float,
        interpolation: Interpolation = Interpolation.LINEAR,
        events: Sequence[float] | None = None,
    ) -> None:
        super().__init__(times, interpolation, events)
        self.threshold = threshold
        self.width = float(
            check_parameter(width, "width", lambda w: w > 0, "a positive number, in the unit of the data")
        )

    def value(self, data: Array) -> Array:
        """Smoothed."""
        if self.interpolation is not Interpolation.LINEAR:
            return np.array([time for time, _ in self._counted(data)])
        return np.asarray((self.steps * self._above(data).mean).sum(axis=0))

    def raw(self, data: Array) -> Array:
        """As it is: what smoothing changes is the difference."""
        return np.array([curve.above(self.threshold)[0] for curve in self.curves(data)])

    def gradient(self, data: Array) -> Array:
        """By each interval's values at its two ends, and what a cubic bends."""
        if self.interpolation is not Interpolation.LINEAR:
            return np.array([by[1:] for _, by in self._counted(data)]).T
        above = self._above(data)
        by_begin, by_end = (self.steps * each / self.width for each in (above.by_begin, above.by_end))
        return np.asarray(by_end + np.concatenate([by_begin[1:], np.zeros((1, data.shape[1]))]))

    def _counted(self, data: Array) -> list[tuple[float, Array]]:
        points, weights = np.polynomial.legendre.leggauss(GAUSS)
        count = (points + 1) / 2, weights / 2
        return [curve.smoothed_time_above(count, self.threshold, self.width) for curve in self.curves(data)]

    def _above(self, data: Array) -> _Above:
        a, b = ((side - self.threshold) / self.width for side in self.sides(data))
        apart = b - a
        near = np.abs(apart) < CLOSE
        safe = np.where(near, 1.0, apart)
        count_a, count_b, middle = (1 / (1 + np.exp(-np.clip(x, -700, 700))) for x in (a, b, (a + b) / 2))
        mean = np.where(near, middle, (np.logaddexp(0, b) - np.logaddexp(0, a)) / safe)
        flat = middle * (1 - middle) / 2
        by_begin, by_end = (mean - count_a) / safe, (count_b - mean) / safe
        return _Above(mean, np.where(near, flat, by_begin), np.where(near, flat, by_end))


class Derived:
    """A model whose data are a quantity of another's.

    Parameters
    ----------
    model : Model
        Such as `WaveModel` or `RunModel`.
    quantity : DerivedQuantity
        Such as `Amplitude()` or `Dose(model.times)`.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> from ngbrain.forward import HarmonicProblem, Wave, WaveModel
    >>> from ngbrain.materials import Shearing
    >>> from ngbrain.mesh.geometry.structured import rectangles
    >>> mesh = rectangles(np.linspace(0, 0.1, 6), np.linspace(0, 0.1, 6))
    >>> storage = ngs.GridFunction(ngs.H1(mesh, order=1)); storage.Set(2000.0)
    >>> body = HarmonicProblem(mesh, Shearing(storage * (1 + 0.2j)), [Wave(50.0, {"top": (1e-3, 0)})], bulk=1e5, form="P2")
    >>> waves = WaveModel(body, {"storage": storage}, np.array([[0.03, 0.05]]))
    >>> there = Derived(waves, Amplitude()).evaluate(waves.theta)
    >>> there.data.shape, there.gradient(there.data).shape == waves.theta.shape
    ((1, 1, 2), True)
    """

    def __init__(self, model: Model, quantity: DerivedQuantity) -> None:
        self.model, self.quantity = model, quantity

    def evaluate(self, theta: Array) -> DerivedState:
        """Its state at θ; raises what the model raises."""
        return DerivedState(self.quantity, self.model.evaluate(theta))


class DerivedState:
    """`data`, and the products of their derivatives."""

    def __init__(self, quantity: DerivedQuantity, inner: Any) -> None:
        self.quantity, self.inner = quantity, inner
        self.data = quantity.value(inner.data)

    def jvp(self, direction: Array) -> Array:
        """J δθ."""
        return self.quantity.jvp(self.inner.data, self.inner.jvp(direction))

    def vjp(self, w: Array) -> Array:
        """Jᵀ w, by what is cheap for many."""
        return np.asarray(self.inner.vjp(self._back(w)))

    def gradient(self, w: Array) -> Array:
        """Jᵀ w, by what is cheap for one."""
        return np.asarray(self.inner.gradient(self._back(w)))

    def hvp(self, w: Array, direction: Array) -> Array:
        """(w · data)'' δθ; `InputError` where the quantity or the model has none."""
        bent = self.quantity.bend(self.inner.data, w, self.inner.jvp(direction))
        return np.asarray(self.inner.hvp(self._back(w), direction) + self.inner.vjp(bent))

    def _back(self, w: Array) -> Array:
        check_shape("w", np.shape(w), self.data.shape)
        return self.quantity.vjp(self.inner.data, w)
