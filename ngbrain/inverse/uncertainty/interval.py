"""Credible intervals of a number, or of each entry of an array: value, standard deviation and interval ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from ngbrain.errors import InputError
from ngbrain.inverse.objective.parameters import ScaledTransform, Transform
from ngbrain.look import BriefText

Array = np.ndarray
LEVEL = 0.95
"""Default probability of a credible interval."""
NODES = 40
"""Quadrature nodes of moments."""


@dataclass(frozen=True, repr=False)
class CredibleInterval(BriefText):
    """Credible interval of a number, or of each entry of an array.

    Parameters
    ----------
    value : array or float
        Value at x*.
    deviation : array or float
        Standard deviation.
    low, high : array or float
        Ends of the interval.
    """

    value: Array | float
    deviation: Array | float
    low: Array | float
    high: Array | float

    @staticmethod
    def from_gaussian(
        centre: Array, deviation: Array, transform: Transform | None = None, level: float = LEVEL
    ) -> CredibleInterval:
        """Interval of θ = transform(x) for Gaussian x: transformed interval of x, standard deviation of θ by quadrature.

        Parameters
        ----------
        centre : array
            Mean of x.
        deviation : array
            Standard deviation of x.
        transform : Transform, optional
            Change of variable. Default identity.
        level : float
            Probability.

        Returns
        -------
        CredibleInterval

        Raises
        ------
        InputError
            If `level` is not between 0 and 1.

        Examples
        --------
        >>> from ngbrain.inverse.objective.parameters import LogTransform
        >>> interval = CredibleInterval.from_gaussian(np.zeros(1), np.ones(1), LogTransform())
        >>> float(interval.low[0]), float(interval.high[0]), float(interval.deviation[0])  # e^-1.96, e^1.96, √(e² - e)
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
        with np.errstate(over="ignore", invalid="ignore"):  # of an undetermined logarithm
            values = np.array([transform.value(centre + node * deviation) for node in nodes])
            spread = np.sqrt(weights @ (values - weights @ values) ** 2)
        return CredibleInterval(transform.value(centre), spread, ends[0], ends[1])

    @staticmethod
    def from_samples(value: Array | float, draws: Array, level: float = LEVEL) -> CredibleInterval:
        """Interval from samples: their standard deviation and quantiles.

        Parameters
        ----------
        value : array or float
            Value at x*.
        draws : array (number, ...)
            Samples.
        level : float
            Probability.

        Returns
        -------
        CredibleInterval
        """
        low, high = np.quantile(draws, [0.5 - level / 2, 0.5 + level / 2], axis=0)
        return CredibleInterval(value, draws.std(axis=0), low, high)
