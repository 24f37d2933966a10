"""How far predicted data are off the measured ones, in units of their noise."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ngbrain.errors import InputError, check_shape, nearest

Array = np.ndarray
REAL_MEDIAN = 0.454936423
"""Of the square of a normal deviate; of a complex one, 2 ln 2."""


class LeastSquares:
    """Φ = ½ Σ |(d - m)/σ|² over what is measured.

    measured   m (loads, n, dim), complex, m, or real data of any shape; NaN where a component is not measured
    sigma      standard deviation of the data, of complex ones that of the real and of the imaginary part, of any shape that
               fits m's

    With the right σ, 2Φ of the truth is close to `count`, the number of real data.
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
        """(d - m)/σ, 0 where nothing is measured; `InputError` for data of another shape."""
        check_shape("measured", self.measured.shape, np.shape(data))
        return np.where(self.known, (data - self.measured) / self.sigma, 0)

    def value(self, data: Array) -> float:
        """Φ."""
        return 0.5 * float(np.sum(np.abs(self.residual(data)) ** 2))

    def weighted_squares(self, data: Array) -> float:
        """Σ |(d - m)/σ|², by which noise and weights are judged: 2Φ."""
        return 2 * self.value(data)

    def gradient(self, data: Array) -> Array:
        """w with dΦ = Re Σ w̄ · δd (1/m)."""
        return self.residual(data) / self.sigma

    def weight(self, data: Array) -> Array:
        """What Gauss and Newton weigh squares by, 1/σ² (1/m²)."""
        return np.where(self.known, 1 / self.sigma**2, 0)

    def gauss_newton_product(self, data: Array, change: Array) -> Array:
        """`weight` times a change of the data."""
        return self.weight(data) * change

    def hvp(self, data: Array, change: Array) -> Array:
        """Φ'' times a change of the data: here the same."""
        return self.gauss_newton_product(data, change)


class Huber(LeastSquares):
    """Φ = Σ ρ(|r|), ρ = ½ r² up to a threshold k and k |r| - ½ k² beyond: outliers pull with a bounded force.

    For moderate ones: those as large as the waves spoil the start, see `outliers.remove_outliers`.

    Source: Huber 1964, 10.1214/aoms/1177703732.
    """

    def __init__(self, measured: Array, sigma: Array | float, threshold: float = 2.5) -> None:
        super().__init__(measured, sigma)
        if not threshold > 0:
            raise InputError("threshold", threshold, "a positive number of standard deviations")
        self.threshold = threshold

    def value(self, data: Array) -> float:
        """Φ."""
        size, k = np.abs(self.residual(data)), self.threshold
        return float(np.sum(np.where(size <= k, 0.5 * size**2, k * size - 0.5 * k**2)))

    def weighted_squares(self, data: Array) -> float:
        """What the sum of squares would be without outliers: by the median of |(d - m)/σ|² beside that of Gaussian noise."""
        usual = 2 * np.log(2) if np.iscomplexobj(self.measured) else REAL_MEDIAN
        return self.count * float(np.median(np.abs(self.residual(data)[self.known]) ** 2)) / usual

    def gradient(self, data: Array) -> Array:
        """w with dΦ = Re Σ w̄ · δd (1/m)."""
        return self._share(data) * super().gradient(data)

    def weight(self, data: Array) -> Array:
        """1/σ², less for outliers (1/m²)."""
        return self._share(data) * super().weight(data)

    def hvp(self, data: Array, change: Array) -> Array:
        """Φ'' times a change of the data: nothing along an outlier's residual, k/|r| of the squares' across it."""
        r = self.residual(data)
        size = np.maximum(np.abs(r), self.threshold)
        along = np.where(size > self.threshold, r * (np.conj(r) * change).real / size**2, 0)
        return self.weight(data) * (change - along)

    def _share(self, data: Array) -> Array:
        return self.threshold / np.maximum(np.abs(self.residual(data)), self.threshold)


MisfitKind: TypeAlias = Callable[[Array, Array], LeastSquares]
"""Measured displacements and σ → a misfit."""
MISFITS: dict[str, MisfitKind] = {"squares": LeastSquares, "huber": Huber}
"""Misfits by name, as `invert` offers them."""


def resolve_misfit(chosen: str | MisfitKind) -> MisfitKind:
    """That of a name in `MISFITS`, or one of one's own; `InputError` for another name.

    >>> resolve_misfit("huber").__name__
    'Huber'
    """
    if callable(chosen):
        return chosen
    if chosen not in MISFITS:
        raise InputError("misfit", repr(chosen), nearest(chosen, MISFITS))
    return MISFITS[chosen]
