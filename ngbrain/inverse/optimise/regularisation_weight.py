"""How strongly regularisers weigh against data: chosen by what the data determine.

`Evidence` is the default: for each block b the weight at which the regulariser's energy is what the determined numbers are
expected to have, α = γ_b / (x - x̄)·R(x - x̄) with γ_b = n_b - tr(α R_b H⁻¹): where the probability of the data, given the
weights, is largest. `Discrepancy` changes all weights by one factor until the misfit is at its expected level, the number of
data less those that the unknowns use up, by the secant of ln 2Φ against ln α. Both are fixed points, so that more iterations
change nothing.
Sources: MacKay 1992, 10.1162/neco.1992.4.3.415; Morozov 1966; Hansen and O'Leary 1993, 10.1137/0914086 (`corner`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from ngbrain.adjoint.reduced import Reduced

Array = np.ndarray
LARGEST = 10.0
"""Factor by which a weight changes in one iteration at most: lowered faster, an inversion fits noise before it sees the whole."""

SLOPE, SLOPES = 0.2, (0.02, 2.0)
"""d ln 2Φ / d ln α: what a first step takes it to be, and what it can be. Near the level of noise it is small."""


class EffectiveParameterCounter(Protocol):
    """What a factor of the optimality conditions knows."""

    def effective_parameters(self, random: np.random.Generator) -> float:
        """Of all data."""

    def effective_parameters_by_block(
        self, blocks: Mapping[str, slice], regular: Mapping[str, sp.csr_array], random: np.random.Generator
    ) -> dict[str, float]:
        """Of each block; its regulariser's matrix with its weight."""


@dataclass
class MisfitLevel:
    """Where the misfit is and where it is expected: 2Φ, and the number of data less those used up."""

    misfit: float
    expected: float

    @property
    def ratio(self) -> float:
        """1 when the data are fitted as well as their noise allows; not a number where all data are used up."""
        return self.misfit / self.expected if self.expected else float("nan")


@dataclass
class WeightPolicy:
    """What changes the weights between iterations; `determined`: how many numbers of each block the data determined."""

    determined: dict[str, float] = field(default_factory=dict, init=False)

    def update(
        self,
        reduced: Reduced,
        x: Array,
        level: MisfitLevel,
        factor: EffectiveParameterCounter,
        random: np.random.Generator,
    ) -> float:
        """New weights in `reduced`; the largest factor by which one changed, up or down."""
        raise NotImplementedError


@dataclass
class Evidence(WeightPolicy):
    """Each block's weight from the data; `largest`: factor by which one changes in one iteration at most.

    None goes below its regulariser's `least`: evidence takes errors for independent, and those of a model that does not hold,
    alike over many points, would be taken for fields as rough as it takes.
    """

    largest: float = LARGEST

    def update(
        self,
        reduced: Reduced,
        x: Array,
        level: MisfitLevel,
        factor: EffectiveParameterCounter,
        random: np.random.Generator,
    ) -> float:
        """New weights in `reduced`; the largest factor by which one changed."""
        blocks = reduced.unknowns.blocks
        regular = {name: reduced.weights[name] * r.matrix(x[blocks[name]]) for name, r in reduced.regularisers.items()}
        largest = 1.0
        self.determined = factor.effective_parameters_by_block(blocks, regular, random)
        for name, number in self.determined.items():
            energy = 2 * reduced.regularisers[name].value(x[blocks[name]])
            min_weight = getattr(reduced.regularisers[name], "min_weight", 0.0)  # one of one's own need not have it
            wanted = max(self.noise(level) * max(number, 1.0) / max(energy, 1e-12), min_weight)
            factor_of_change = float(np.clip(wanted / reduced.weights[name], 1 / self.largest, self.largest))
            reduced.weights[name] *= factor_of_change
            if number >= 1 or factor_of_change < 1:  # else the field is uniform, and no weight makes it more so
                largest = max(largest, factor_of_change, 1 / factor_of_change)
        return largest

    def noise(self, level: MisfitLevel) -> float:
        """Variance of the data over the stated one: taken as stated."""
        return 1.0


@dataclass
class EvidenceWithModelError(Evidence):
    """The same where the model is off by more than the stated noise: what the misfit shows beyond it counts as noise.

    Without it a weight falls until the fields fit errors of the discretisation. Those are alike at the `shared` points (in the
    mean) that one node of the elements stands for, so that the mean of these points knows no more than one: they count so often.
    """

    shared: float = 1.0

    def noise(self, level: MisfitLevel) -> float:
        """1 + `shared` times the excess of 2Φ over its expected level, at least 1."""
        return 1.0 + max(1.0, self.shared) * max(0.0, level.ratio - 1.0)


@dataclass
class DiscrepancyPrinciple(WeightPolicy):
    """All weights by one factor, to the level where the misfit is expected; `slack` is what counts as there.

    A misfit that stays above its level whatever the weight (a model error, a noise larger than stated) leaves them as they are.
    """

    slack: float = 0.02
    _last: tuple[float, float] | None = field(default=None, repr=False)

    def update(
        self,
        reduced: Reduced,
        x: Array,
        level: MisfitLevel,
        factor: EffectiveParameterCounter,
        random: np.random.Generator,
    ) -> float:
        """New weights in `reduced`; the factor by which they changed."""
        if abs(level.ratio - 1) <= self.slack:
            return 1.0
        names = list(reduced.regularisers)
        now = float(np.log(reduced.weights[names[0]])), float(np.log(level.ratio))
        slope = SLOPE
        if self._last is not None and now[0] != self._last[0]:
            slope = (now[1] - self._last[1]) / (now[0] - self._last[0])
            if slope < SLOPES[0] and level.ratio > 1 and now[0] < self._last[0]:
                return 1.0  # what is left is no matter of the weight
        self._last, slope = now, float(np.clip(slope, *SLOPES))
        change = float(np.exp(np.clip(-now[1] / slope, -np.log(LARGEST), np.log(LARGEST))))
        for name in names:
            reduced.weights[name] *= change
        return max(change, 1 / change)


@dataclass
class FixedWeights(WeightPolicy):
    """Weights as they are."""

    def update(
        self,
        reduced: Reduced,
        x: Array,
        level: MisfitLevel,
        factor: EffectiveParameterCounter,
        random: np.random.Generator,
    ) -> float:
        """1."""
        return 1.0


def l_curve_corner(misfits: Array, energies: Array) -> int:
    """Which point of an L-curve bends most towards the origin: ln 2Φ against ln of the regulariser's energy, in order of falling
    weights. Never one of its ends.

    >>> l_curve_corner(np.array([1e4, 1e2, 1.1, 1.0, 0.99]), np.array([1.0, 1.5, 2.0, 30.0, 900.0]))
    2
    """
    x, y = np.log(np.asarray(misfits, float)), np.log(np.asarray(energies, float))
    x1, y1, x2, y2 = np.gradient(x), np.gradient(y), np.gradient(np.gradient(x)), np.gradient(np.gradient(y))
    bend = (y1 * x2 - x1 * y2) / np.maximum((x1**2 + y1**2) ** 1.5, 1e-30)
    return int(1 + np.argmax(bend[1:-1]))
