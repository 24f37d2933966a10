"""What is known of a number, or of each of many by itself: its value, how far it may be off, and between which ends it lies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from ngbrain.errors import InputError
from ngbrain.inverse.objective.parameters import ScaledTransform, Transform

Array = np.ndarray
LEVEL = 0.95
"""Probability of a credible interval, unless another one is asked for."""
NODES = 40
"""Of the quadrature for moments."""


@dataclass(frozen=True)
class CredibleInterval:
    """What is known of one number, or of each of many: value at x*, standard deviation, ends of a credible interval."""

    value: Array | float
    deviation: Array | float
    low: Array | float
    high: Array | float

    @staticmethod
    def from_gaussian(
        centre: Array, deviation: Array, transform: Transform | None = None, level: float = LEVEL
    ) -> CredibleInterval:
        """Of θ = transform(x), x Gaussian: the interval of x transformed, and θ's own deviation by quadrature.

        >>> from ngbrain.inverse.objective.parameters import LogTransform
        >>> band = CredibleInterval.from_gaussian(np.zeros(1), np.ones(1), LogTransform())
        >>> float(band.low[0]), float(band.high[0]), float(band.deviation[0])  # e^-1.96, e^1.96, √(e² - e)
        (0.1408635, 7.0990713, 2.16119742)
        """
        if not 0 < level < 1:
            raise InputError("level", level, "a probability between 0 and 1, such as 0.95")
        transform, reach = transform or ScaledTransform(), float(ndtri(0.5 + level / 2))
        ends = np.sort(
            [transform.value(centre - reach * deviation), transform.value(centre + reach * deviation)], axis=0
        )
        nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
        weights = weights / weights.sum()
        with np.errstate(over="ignore", invalid="ignore"):  # of a logarithm that nothing holds
            values = np.array([transform.value(centre + node * deviation) for node in nodes])
            spread = np.sqrt(weights @ (values - weights @ values) ** 2)
        return CredibleInterval(transform.value(centre), spread, ends[0], ends[1])

    @staticmethod
    def from_samples(value: Array | float, draws: Array, level: float = LEVEL) -> CredibleInterval:
        """From draws (number, ...): their deviation and quantiles."""
        low, high = np.quantile(draws, [0.5 - level / 2, 0.5 + level / 2], axis=0)
        return CredibleInterval(value, draws.std(axis=0), low, high)
