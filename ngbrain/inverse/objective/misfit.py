"""Data misfit in units of the measurement noise: least squares, and Huber's robust misfit."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ngbrain.errors import InputError, check_shape, nearest

Array = np.ndarray
REAL_MEDIAN = 0.454936423
"""Median of the square of a standard normal deviate; of a complex one it is 2 ln 2."""


class LeastSquares:
    """Least-squares misfit Φ = ½ Σ |(d - m)/σ|² over all measured components.

    With the correct σ, 2Φ at the true parameters is close to `count`, the number of real data.

    Parameters
    ----------
    measured : array (loads, n, dim)
        Measured data m: complex displacements in m, or real data of any shape. NaN where a component is not measured.
    sigma : array or float
        Standard deviation of the data, broadcastable to the shape of `measured`. For complex data: of the real and of the
        imaginary part.

    Raises
    ------
    InputError
        If no datum is known, `sigma` has the wrong shape, or a standard deviation is not positive.
    """

    def __init__(self, measured: Array, sigma: Array | float) -> None:
        self.known, given = ~np.isnan(measured), np.asarray(sigma, float)
        if not self.known.any():
            raise InputError("measured", f"{measured.size} numbers, none of them known", "data that are not all NaN")
        try:
            self.sigma = np.broadcast_to(given, measured.shape)
        except ValueError:
            raise InputError("sigma", f"of shape {given.shape}", f"one that fits data of {measured.shape}") from None
        if not np.all(self.sigma[self.known] > 0):
            raise InputError("sigma", float(np.min(self.sigma)), "a positive standard deviation in m")
        self.measured = np.where(self.known, measured, 0)
        self.count = int(self.known.sum()) * (2 if np.iscomplexobj(measured) else 1)

    def residual(self, data: Array) -> Array:
        """Residual (d - m)/σ, zero where nothing is measured; `InputError` for data of another shape."""
        check_shape("measured", self.measured.shape, np.shape(data))
        return np.where(self.known, (data - self.measured) / self.sigma, 0)

    def value(self, data: Array) -> float:
        """Misfit Φ of predicted data."""
        return 0.5 * float(np.sum(np.abs(self.residual(data)) ** 2))

    def weighted_squares(self, data: Array) -> float:
        """Sum of squared residuals Σ |(d - m)/σ|² = 2Φ, which the noise level and the regularisation weights are judged by."""
        return 2 * self.value(data)

    def gradient(self, data: Array) -> Array:
        """Gradient w with respect to the data (1/m), such that dΦ = Re Σ w̄ · δd."""
        return self.residual(data) / self.sigma

    def weight(self, data: Array) -> Array:
        """Gauss-Newton weight 1/σ² of the data (1/m²), zero where nothing is measured."""
        return np.where(self.known, 1 / self.sigma**2, 0)

    def gauss_newton_product(self, data: Array, change: Array) -> Array:
        """Product of the Gauss-Newton weight with a change of the data.

        Parameters
        ----------
        data : array (loads, n, dim)
            Predicted data.
        change : array (loads, n, dim)
            Change of the data.

        Returns
        -------
        array (loads, n, dim)
            `weight(data) * change`.
        """
        return self.weight(data) * change

    def hvp(self, data: Array, change: Array) -> Array:
        """Product of the Hessian Φ'' with a change of the data; for least squares, the Gauss-Newton product.

        Parameters
        ----------
        data : array (loads, n, dim)
            Predicted data.
        change : array (loads, n, dim)
            Change of the data.

        Returns
        -------
        array (loads, n, dim)
            Φ'' δd.
        """
        return self.gauss_newton_product(data, change)


class Huber(LeastSquares):
    """Huber's robust misfit Φ = Σ ρ(|r|): ρ = ½ r² up to a threshold k, and k |r| - ½ k² beyond it.

    The influence of an outlier is bounded. This is enough for moderate outliers; outliers as large as the waves spoil the
    initial guess and must be removed first, see `outliers.without_outliers`.

    Parameters
    ----------
    measured : array (loads, n, dim)
        Measured data, as for `LeastSquares`.
    sigma : array or float
        Standard deviation of the data, as for `LeastSquares`.
    threshold : float
        Threshold k in standard deviations.

    Raises
    ------
    InputError
        If the threshold is not positive, and as for `LeastSquares`.

    References
    ----------
    Huber 1964, 10.1214/aoms/1177703732.
    """

    def __init__(self, measured: Array, sigma: Array | float, threshold: float = 2.5) -> None:
        super().__init__(measured, sigma)
        if not threshold > 0:
            raise InputError("threshold", threshold, "a positive number of standard deviations")
        self.threshold = threshold

    def value(self, data: Array) -> float:
        """Misfit Φ of predicted data."""
        size, k = np.abs(self.residual(data)), self.threshold
        return float(np.sum(np.where(size <= k, 0.5 * size**2, k * size - 0.5 * k**2)))

    def weighted_squares(self, data: Array) -> float:
        """Robust estimate of Σ |(d - m)/σ|²: the median of |r|² relative to that of Gaussian noise, times `count`."""
        usual = 2 * np.log(2) if np.iscomplexobj(self.measured) else REAL_MEDIAN
        return self.count * float(np.median(np.abs(self.residual(data)[self.known]) ** 2)) / usual

    def gradient(self, data: Array) -> Array:
        """Gradient w with respect to the data (1/m), such that dΦ = Re Σ w̄ · δd."""
        return self._share(data) * super().gradient(data)

    def weight(self, data: Array) -> Array:
        """Gauss-Newton weight (1/m²): 1/σ², reduced for outliers."""
        return self._share(data) * super().weight(data)

    def hvp(self, data: Array, change: Array) -> Array:
        """Product of the Hessian Φ'' with a change of the data.

        For an outlier it is zero along the residual, and k/|r| times the least-squares product across it.

        Parameters
        ----------
        data : array (loads, n, dim)
            Predicted data.
        change : array (loads, n, dim)
            Change of the data.

        Returns
        -------
        array (loads, n, dim)
            Φ'' δd.
        """
        r = self.residual(data)
        size = np.maximum(np.abs(r), self.threshold)
        along = np.where(size > self.threshold, r * (np.conj(r) * change).real / size**2, 0)
        return self.weight(data) * (change - along)

    def _share(self, data: Array) -> Array:
        return self.threshold / np.maximum(np.abs(self.residual(data)), self.threshold)


MisfitKind: TypeAlias = Callable[[Array, Array], LeastSquares]
"""Constructor of a misfit from measured displacements and their σ."""
MISFITS: dict[str, MisfitKind] = {"squares": LeastSquares, "huber": Huber}
"""Misfits that `invert` offers by name."""


def resolve_misfit(chosen: str | MisfitKind) -> MisfitKind:
    """Return the misfit of a name in `MISFITS`, or a constructor of your own unchanged; `InputError` for an unknown name.

    >>> resolve_misfit("huber").__name__
    'Huber'
    """
    if callable(chosen):
        return chosen
    if chosen not in MISFITS:
        raise InputError("misfit", repr(chosen), nearest(chosen, MISFITS))
    return MISFITS[chosen]
