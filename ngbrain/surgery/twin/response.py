"""The measures of a plan to first order: ln q(θ) = ln q(θ₀) + g · (θ - θ₀)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ngbrain.look import BriefText
from ngbrain.surgery.quantities import QUANTITIES

Array = np.ndarray
PRESSURE, DOSE, FORCE, STRAIN = "peak_pressure_mmHg", "dose_mmHg_min", "peak_force_N", "mps_p95"
MEASURES = (PRESSURE, DOSE, FORCE, STRAIN)
"""Measures that plans are compared by: keys of a protocol's answer."""


def unit(measure: str) -> str:
    """Unit of a measure."""
    return QUANTITIES[measure].unit


@dataclass(frozen=True, eq=False, repr=False)
class Response(BriefText):
    """Measures of a plan about the prior's centre.

    Parameters
    ----------
    values : dict of float
        Measure → its value at the centre.
    theta : (size,) array
        θ₀.
    gradients : dict of (size,) array
        Measure → gradient of its logarithm with respect to θ.
    nodes : (n, 3) array
        Places (m) of the last n entries of θ, the field.
    """

    values: Mapping[str, float]
    theta: Array
    gradients: Mapping[str, Array]
    nodes: Array

    def log_values(self, thetas: Array) -> dict[str, Array]:
        """Logarithms of the measures at other parameters.

        Parameters
        ----------
        thetas : (n, size) array

        Returns
        -------
        dict of (n,) array
        """
        change = thetas - self.theta
        return {key: np.log(self.values[key]) + change @ self.gradients[key] for key in self.values}

    def field(self, measure: str) -> Array:
        """Gradient of ln of a measure with respect to the field at the nodes."""
        return self.gradients[measure][-len(self.nodes) :]
