"""Quantities derived from a model's data, as models of their own: dose, time above a threshold, amplitude and phase of waves.

d' = T(d(θ)) ,    J' δθ = T' J δθ ,    J'ᵀ w = Re Jᵀ conj(T'ᵀ w) ,    (w·d')'' δθ = (T'ᵀw · d)'' δθ + Re Jᵀ conj((T'ᵀ w)' J δθ)
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.adjoint.derived_quantity import DerivedQuantity
from ngbrain.adjoint.reduced import Model
from ngbrain.adjoint.time_curve import Interpolation, TimeCurve
from ngbrain.errors import InputError, check_shape
from ngbrain.materials.base import check_parameter

Array = np.ndarray
CLOSE = 1e-4
"""Difference of two arguments of the logistic function below which means are computed by a series."""
GAUSS = 24
"""Gauss points in each interval of a cubic."""


class WaveQuantity(DerivedQuantity):
    """A real number for each complex displacement (m) of a wave.

    Raises
    ------
    InputError
        Where a displacement is 0: it has no phase, and its amplitude no derivative.
    """

    @staticmethod
    def _size(data: Array) -> Array:
        size = np.abs(data)
        if still := int(np.sum(size == 0)):
            raise InputError(
                "data", f"0 in {still} of {data.size} displacements", "points and components with non-zero amplitude"
            )
        return size


class Amplitude(WaveQuantity):
    """|u|."""

    name = "amplitude"

    def value(self, data: Array) -> Array:
        """|u|."""
        return np.abs(data)

    def jvp(self, data: Array, change: Array) -> Array:
        """Re(ū δu)/|u|.

        Parameters
        ----------
        data, change : complex array
            Displacements u (m) and their change δu.

        Returns
        -------
        array
        """
        return np.asarray((np.conj(data) * change).real / self._size(data))

    def vjp(self, data: Array, w: Array) -> Array:
        """w u/|u|.

        Parameters
        ----------
        data : complex array
            Displacements u (m).
        w : array
            Weights.

        Returns
        -------
        complex array
        """
        return np.asarray(w * data / self._size(data))

    def vjp_derivative(self, data: Array, w: Array, change: Array) -> Array:
        """w (δu - u Re(ū δu)/|u|²)/|u|.

        Parameters
        ----------
        data, w, change : array
            Displacements u, weights, change δu.

        Returns
        -------
        complex array
        """
        size = self._size(data)
        return np.asarray(w * (change - data * (np.conj(data) * change).real / size**2) / size)


class Phase(WaveQuantity):
    """arg u (rad, -π to π)."""

    name = "phase"

    def value(self, data: Array) -> Array:
        """arg u."""
        return np.angle(data)

    def jvp(self, data: Array, change: Array) -> Array:
        """Im(ū δu)/|u|².

        Parameters
        ----------
        data, change : complex array
            Displacements u (m) and their change δu.

        Returns
        -------
        array
        """
        return np.asarray((np.conj(data) * change).imag / self._size(data) ** 2)

    def vjp(self, data: Array, w: Array) -> Array:
        """w i u/|u|², which is w i/ū.

        Parameters
        ----------
        data : complex array
            Displacements u (m).
        w : array
            Weights.

        Returns
        -------
        complex array
        """
        return np.asarray(1j * w * data / self._size(data) ** 2)

    def vjp_derivative(self, data: Array, w: Array, change: Array) -> Array:
        """-w i conj(δu)/ū².

        Parameters
        ----------
        data, w, change : array
            Displacements u, weights, change δu.

        Returns
        -------
        complex array
        """
        return np.asarray(-1j * w * np.conj(change) / np.conj(data) ** 2)


class TimeQuantity(DerivedQuantity):
    """One number for each column of a run's data (m, k): an integral over time.

    A run begins at rest at 0 s, where the data are taken to be 0.

    Parameters
    ----------
    times : array (m,)
        Times of the data's rows (s), as `RunModel.times` has them.
    interpolation : Interpolation
        Interpolation between the times: linear, or the monotone cubic that a retraction's report uses.
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
        """The `TimeCurve` of each column of the data."""
        check_shape("data", np.shape(data), (len(self.times), np.shape(data)[-1]))
        times, rest = np.concatenate([[0.0], self.times]), np.zeros((1, data.shape[1]))
        return [TimeCurve(times, each, self.events, self.interpolation) for each in np.vstack([rest, data]).T]

    @property
    def steps(self) -> Array:
        """Lengths of the intervals (m, 1) s."""
        return np.diff(self.times, prepend=0.0)[:, None]

    def sides(self, data: Array) -> tuple[Array, Array]:
        """Data at the beginning and at the end of each interval."""
        check_shape("data", np.shape(data), (len(self.times), np.shape(data)[-1]))
        return np.concatenate([np.zeros((1, data.shape[1])), data[:-1]]), data

    @abstractmethod
    def gradient(self, data: Array) -> Array:
        """Derivative of each column's number with respect to its data, of the shape of the data."""

    def jvp(self, data: Array, change: Array) -> Array:
        """T' δd, from `gradient`.

        Parameters
        ----------
        data, change : array (m, k)
            Data and their change.

        Returns
        -------
        array (k,)
        """
        return np.asarray((self.gradient(data) * change).sum(axis=0))

    def vjp(self, data: Array, w: Array) -> Array:
        """T'ᵀ w, from `gradient`.

        Parameters
        ----------
        data : array (m, k)
            Data.
        w : array (k,)
            Weights.

        Returns
        -------
        array (m, k)
        """
        return self.gradient(data) * w


class Dose(TimeQuantity):
    """Time integral ∫ d dt, such as the dose of a pressure (Pa s); parameters as `TimeQuantity`.

    Examples
    --------
    >>> Dose([10.0, 20.0]).value(np.array([[4.0], [4.0]])).tolist()
    [60.0]
    """

    name = "dose"

    def value(self, data: Array) -> Array:
        """Time integral of each column."""
        return np.array([curve.integral() for curve in self.curves(data)])

    def gradient(self, data: Array) -> Array:
        """Quadrature weights of the times, with the contribution of a cubic's slopes."""
        return np.array([curve.integral_slope()[1:] for curve in self.curves(data)]).T

    def vjp_derivative(self, data: Array, w: Array, change: Array) -> Array:
        """Zero with linear interpolation.

        Parameters
        ----------
        data, w, change : array
            Data, weights, change.

        Returns
        -------
        array (m, k)

        Raises
        ------
        InputError
            With the monotone cubic, which has no second derivatives here.
        """
        if self.interpolation is not Interpolation.LINEAR:
            return super().vjp_derivative(data, w, change)
        return np.zeros_like(data)


@dataclass
class _SmoothedTime:
    """Mean of 1/(1 + exp(-x)) over intervals in which x is linear from a to b, and its derivatives with respect to a and b."""

    mean: Array
    by_begin: Array
    by_end: Array


class TimeAbove(TimeQuantity):
    """Time (s) that data spend above a threshold, smoothed.

    The time itself has no derivative where data touch the threshold. Here time is weighted by the logistic function 1/(1 +
    exp(-(d - threshold)/width)), which is smooth.

    Parameters
    ----------
    times, interpolation, events
        See `TimeQuantity`.
    threshold : float
        In the unit of the data.
    width : float
        Half the range over which the weight rises from 0.27 to 0.73; the smaller, the closer to `raw`.
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
        """Smoothed time above the threshold, of each column."""
        if self.interpolation is not Interpolation.LINEAR:
            return np.array([time for time, _ in self._counted(data)])
        return np.asarray((self.steps * self._logistic_mean(data).mean).sum(axis=0))

    def raw(self, data: Array) -> Array:
        """Time above the threshold without smoothing: the difference is the smoothing error."""
        return np.array([curve.above(self.threshold)[0] for curve in self.curves(data)])

    def gradient(self, data: Array) -> Array:
        """Derivative with respect to the values at both ends of each interval, with the contribution of a cubic's slopes."""
        if self.interpolation is not Interpolation.LINEAR:
            return np.array([by[1:] for _, by in self._counted(data)]).T
        above = self._logistic_mean(data)
        by_begin, by_end = (self.steps * each / self.width for each in (above.by_begin, above.by_end))
        return np.asarray(by_end + np.concatenate([by_begin[1:], np.zeros((1, data.shape[1]))]))

    def _counted(self, data: Array) -> list[tuple[float, Array]]:
        points, weights = np.polynomial.legendre.leggauss(GAUSS)
        count = (points + 1) / 2, weights / 2
        return [curve.smoothed_time_above(count, self.threshold, self.width) for curve in self.curves(data)]

    def _logistic_mean(self, data: Array) -> _SmoothedTime:
        a, b = ((side - self.threshold) / self.width for side in self.sides(data))
        apart = b - a
        near = np.abs(apart) < CLOSE
        safe = np.where(near, 1.0, apart)
        count_a, count_b, middle = (1 / (1 + np.exp(-np.clip(x, -700, 700))) for x in (a, b, (a + b) / 2))
        mean = np.where(near, middle, (np.logaddexp(0, b) - np.logaddexp(0, a)) / safe)
        flat = middle * (1 - middle) / 2
        by_begin, by_end = (mean - count_a) / safe, (count_b - mean) / safe
        return _SmoothedTime(mean, np.where(near, flat, by_begin), np.where(near, flat, by_end))


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
        """Linearised state at θ; raises what the model raises."""
        return DerivedState(self.quantity, self.model.evaluate(theta))


class DerivedState:
    """Linearised state of a derived quantity: `data` and the products of its derivatives.

    Parameters
    ----------
    quantity : DerivedQuantity
        T.
    inner : LinearisedState
        State of the model.
    """

    def __init__(self, quantity: DerivedQuantity, inner: Any) -> None:
        self.quantity, self.inner = quantity, inner
        self.data = quantity.value(inner.data)

    def jvp(self, direction: Array) -> Array:
        """Jacobian-vector product J δθ."""
        return self.quantity.jvp(self.inner.data, self.inner.jvp(direction))

    def vjp(self, w: Array) -> Array:
        """Vector-Jacobian product Jᵀ w, for many w."""
        return np.asarray(self.inner.vjp(self._back(w)))

    def gradient(self, w: Array) -> Array:
        """Vector-Jacobian product Jᵀ w, for one w."""
        return np.asarray(self.inner.gradient(self._back(w)))

    def hvp(self, w: Array, direction: Array) -> Array:
        """Hessian-vector product (w · data)'' δθ.

        Parameters
        ----------
        w : array
            Weights, of the shape of the data.
        direction : array (n,)
            Direction δθ.

        Returns
        -------
        array (n,)

        Raises
        ------
        InputError
            Where the quantity or the model has no second derivatives.
        """
        derivative_weights = self.quantity.vjp_derivative(self.inner.data, w, self.inner.jvp(direction))
        return np.asarray(self.inner.hvp(self._back(w), direction) + self.inner.vjp(derivative_weights))

    def _back(self, w: Array) -> Array:
        check_shape("w", np.shape(w), self.data.shape)
        return self.quantity.vjp(self.inner.data, w)
