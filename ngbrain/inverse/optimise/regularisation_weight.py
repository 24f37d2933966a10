"""Weight policies: how regularisation weights are updated from what the data determine.

`Evidence` is the default. For each block b it maximises the probability of the data given the weights (type-II maximum
likelihood): α = γ_b / (x - x̄)·R(x - x̄), with γ_b = n_b - tr(α R_b H⁻¹) the effective number of parameters. `DiscrepancyPrinciple`
scales all weights by one factor until the misfit is at its expected level, the number of data less the effective number of
parameters, by the secant method for ln 2Φ against ln α. Both are fixed-point iterations: at convergence, more iterations change
nothing.

References
----------
MacKay 1992, 10.1162/neco.1992.4.3.415; Morozov 1966; Hansen and O'Leary 1993, 10.1137/0914086 (`l_curve_corner`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from ngbrain.adjoint.reduced import Reduced
from ngbrain.look import BriefText

Array = np.ndarray
MAX_FACTOR = 10.0
"""Largest factor by which a weight changes in one iteration. When weights fall faster, noise is fitted before the large scale."""

SLOPE, SLOPES = 0.2, (0.02, 2.0)
"""Slope d ln 2Φ / d ln α: initial estimate, and its bounds. Close to the noise level it is small."""


class EffectiveParameterCounter(Protocol):
    """Curvature that provides effective numbers of parameters."""

    def effective_parameters(self, random: np.random.Generator) -> float:
        """Effective number of data that the unknowns use up."""

    def effective_parameters_by_block(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """Effective number of parameters of each block.

        Parameters
        ----------
        blocks : mapping of str to slice
            Name and place of each block in x.
        regular : mapping of str to sparse array
            Weighted regulariser matrix of each block.
        random : Generator
            Random probes.

        Returns
        -------
        dict of str to float
        """


@dataclass
class MisfitLevel:
    """Misfit and its expected value.

    Parameters
    ----------
    misfit : float
        2Φ.
    expected : float
        Number of data less the effective number of parameters.
    """

    misfit: float
    expected: float

    @property
    def ratio(self) -> float:
        """Misfit over its expected value: 1 where the data are fitted to their noise; NaN where all data are used up."""
        return self.misfit / self.expected if self.expected else float("nan")


@dataclass(repr=False)
class WeightPolicy(BriefText):
    """Update of the regularisation weights between iterations.

    Attributes
    ----------
    determined : dict of str to float
        Effective number of parameters of each block, from the last update.
    """

    determined: dict[str, float] = field(default_factory=dict, init=False)

    def update(
        self,
        reduced: Reduced,
        x: Array,
        level: MisfitLevel,
        counter: EffectiveParameterCounter,
        random: np.random.Generator,
    ) -> float:
        """Update the weights of `reduced`.

        Parameters
        ----------
        reduced : Reduced
            Objective, whose weights are changed.
        x : array (n,)
            Current unknowns.
        level : MisfitLevel
            Misfit and its expected value.
        counter : EffectiveParameterCounter
            Gauss-Newton curvature at x.
        random : Generator
            Random probes.

        Returns
        -------
        float
            Largest factor by which a weight changed, up or down.
        """
        raise NotImplementedError


@dataclass
class Evidence(WeightPolicy):
    """Evidence maximisation: the weight of each block is chosen by the data.

    No weight goes below the `min_weight` of its regulariser. Evidence assumes independent errors; model errors, which are
    correlated over many points, would otherwise be fitted by rough fields.

    Parameters
    ----------
    max_factor : float
        Largest factor by which a weight changes in one iteration.
    """

    max_factor: float = MAX_FACTOR

    def update(
        self,
        reduced: Reduced,
        x: Array,
        level: MisfitLevel,
        counter: EffectiveParameterCounter,
        random: np.random.Generator,
    ) -> float:
        """Update the weights of `reduced`.

        Parameters
        ----------
        reduced, x, level, counter, random
            As for `WeightPolicy.update`.

        Returns
        -------
        float
            Largest factor by which a weight changed.
        """
        blocks = reduced.unknowns.blocks
        regular = {name: reduced.weights[name] * r.matrix(x[blocks[name]]) for name, r in reduced.regularisers.items()}
        largest = 1.0
        self.determined = counter.effective_parameters_by_block(blocks, regular, random)
        for name, number in self.determined.items():
            energy = 2 * reduced.regularisers[name].value(x[blocks[name]])
            min_weight = getattr(
                reduced.regularisers[name], "min_weight", 0.0
            )  # user-defined regularisers need not have one
            wanted = max(self.noise_factor(level) * max(number, 1.0) / max(energy, 1e-12), min_weight)
            factor = float(np.clip(wanted / reduced.weights[name], 1 / self.max_factor, self.max_factor))
            reduced.weights[name] *= factor
            if number >= 1 or factor < 1:  # otherwise the field is uniform already
                largest = max(largest, factor, 1 / factor)
        return largest

    def noise_factor(self, level: MisfitLevel) -> float:
        """Variance of the data relative to the stated one; here as stated, 1."""
        return 1.0


@dataclass
class EvidenceWithModelError(Evidence):
    """Evidence maximisation that counts misfit beyond the expected level as noise, for models with an error of their own.

    Otherwise the weights fall until the fields fit discretisation errors. These are the same at all points that one node of the
    mesh stands for, so that the mean of the points is no more accurate than one of them: the excess is multiplied by their number.

    Parameters
    ----------
    max_factor : float
        Largest factor by which a weight changes in one iteration.
    points_per_node : float
        Mean number of measurement points per node.
    """

    points_per_node: float = 1.0

    def noise_factor(self, level: MisfitLevel) -> float:
        """1 + `points_per_node` times the relative excess of 2Φ over its expected value, at least 1."""
        return 1.0 + max(1.0, self.points_per_node) * max(0.0, level.ratio - 1.0)


@dataclass
class DiscrepancyPrinciple(WeightPolicy):
    """Morozov's discrepancy principle: one factor for all weights, to where the misfit is at its expected level.

    If the misfit stays above that level for any weight (a model error, or more noise than stated), the weights stay as they are.

    Parameters
    ----------
    tolerance : float
        Relative deviation from the level at which the weights have converged.
    """

    tolerance: float = 0.02
    _last: tuple[float, float] | None = field(default=None, repr=False)

    def update(
        self,
        reduced: Reduced,
        x: Array,
        level: MisfitLevel,
        counter: EffectiveParameterCounter,
        random: np.random.Generator,
    ) -> float:
        """Update the weights of `reduced`.

        Parameters
        ----------
        reduced, x, level, counter, random
            As for `WeightPolicy.update`.

        Returns
        -------
        float
            Factor by which all weights changed.
        """
        if abs(level.ratio - 1) <= self.tolerance:
            return 1.0
        names = list(reduced.regularisers)
        now = float(np.log(reduced.weights[names[0]])), float(np.log(level.ratio))
        slope = SLOPE
        if self._last is not None and now[0] != self._last[0]:
            slope = (now[1] - self._last[1]) / (now[0] - self._last[0])
            if slope < SLOPES[0] and level.ratio > 1 and now[0] < self._last[0]:
                return 1.0  # the remaining misfit does not depend on the weight
        self._last, slope = now, float(np.clip(slope, *SLOPES))
        change = float(np.exp(np.clip(-now[1] / slope, -np.log(MAX_FACTOR), np.log(MAX_FACTOR))))
        for name in names:
            reduced.weights[name] *= change
        return max(change, 1 / change)


@dataclass
class FixedWeights(WeightPolicy):
    """Constant weights."""

    def update(
        self,
        reduced: Reduced,
        x: Array,
        level: MisfitLevel,
        counter: EffectiveParameterCounter,
        random: np.random.Generator,
    ) -> float:
        """Change nothing.

        Parameters
        ----------
        reduced, x, level, counter, random
            As for `WeightPolicy.update`; not used.

        Returns
        -------
        float
            1.
        """
        return 1.0


def l_curve_corner(misfits: Array, energies: Array) -> int:
    """Index of the corner of an L-curve: the point of largest curvature, never one of the ends.

    Parameters
    ----------
    misfits : array (n,)
        2Φ of each point, in order of falling weights.
    energies : array (n,)
        Energy of the regularisers at each point.

    Returns
    -------
    int

    Examples
    --------
    >>> l_curve_corner(np.array([1e4, 1e2, 1.1, 1.0, 0.99]), np.array([1.0, 1.5, 2.0, 30.0, 900.0]))
    2
    """
    x, y = np.log(np.asarray(misfits, float)), np.log(np.asarray(energies, float))
    x1, y1, x2, y2 = np.gradient(x), np.gradient(y), np.gradient(np.gradient(x)), np.gradient(np.gradient(y))
    bend = (y1 * x2 - x1 * y2) / np.maximum((x1**2 + y1**2) ** 1.5, 1e-30)
    return int(1 + np.argmax(bend[1:-1]))
