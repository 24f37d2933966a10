"""How strongly regularisers weigh against data: chosen by what the data determine.

`Evidence` is the default: for each block b the weight at which the regulariser's energy is what the determined numbers are
expected to have, α = γ_b / (x - x̄)·R(x - x̄) with γ_b = n_b - tr(α R_b H⁻¹): where the probability of the data, given the
weights, is largest. `Discrepancy` changes all weights by one factor until the misfit is at its expected level, the number of
data less those that the unknowns use up. Both are fixed points, so that more iterations change nothing.
Sources: MacKay 1992, 10.1162/neco.1992.4.3.415; Morozov 1966; Hansen and O'Leary 1993, 10.1137/0914086 (`corner`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ngbrain.adjoint.reduced import Reduced

Array = np.ndarray
LARGEST = 10.0
"""Factor by which a weight changes in one iteration at most: lowered faster, an inversion fits noise before it sees the whole."""


class Determined(Protocol):
    """What a factor of the optimality conditions knows."""

    def determined(self, random: np.random.Generator) -> float:
        """Of all data."""

    def determined_of(self, blocks, regular, random: np.random.Generator) -> dict[str, float]:  # type: ignore[no-untyped-def]
        """Of each block."""


@dataclass
class Level:
    """Where the misfit is and where it is expected: 2Φ, and the number of data less those used up."""

    misfit: float
    expected: float

    @property
    def ratio(self) -> float:
        """1 when the data are fitted as well as their noise allows."""
        return self.misfit / self.expected


class Policy(Protocol):
    """What changes weights."""

    def update(
        self, reduced: Reduced, x: Array, level: Level, factor: Determined, random: np.random.Generator
    ) -> float:
        """New weights in `reduced`; the largest factor by which one changed."""


@dataclass
class Evidence:
    """Each block's weight from the data."""

    def update(
        self, reduced: Reduced, x: Array, level: Level, factor: Determined, random: np.random.Generator
    ) -> float:
        """New weights in `reduced`; the largest factor by which one changed."""
        blocks = reduced.unknowns.blocks
        regular = {name: reduced.weights[name] * r.matrix(x[blocks[name]]) for name, r in reduced.regularisers.items()}
        largest = 1.0
        for name, number in factor.determined_of(blocks, regular, random).items():
            energy = 2 * reduced.regularisers[name].value(x[blocks[name]])
            wanted = self.noise(level) * max(number, 1.0) / max(energy, 1e-12)
            factor_of_change = float(np.clip(wanted / reduced.weights[name], 1 / LARGEST, LARGEST))
            reduced.weights[name] *= factor_of_change
            largest = max(largest, factor_of_change, 1 / factor_of_change)
        return largest

    def noise(self, level: Level) -> float:
        """Variance of the data over the stated one: taken as stated."""
        return 1.0


@dataclass
class EvidenceOfNoise(Evidence):
    """The same where the model is off by more than the stated noise: what the misfit shows beyond it counts as noise.

    Without it a weight falls until the fields fit errors of the discretisation.
    """

    def noise(self, level: Level) -> float:
        """2Φ over its expected level, at least 1."""
        return max(1.0, level.ratio)


@dataclass
class Discrepancy:
    """All weights by one factor, to the level where the misfit is expected; `slack` is what counts as there."""

    slack: float = 0.02

    def update(
        self, reduced: Reduced, x: Array, level: Level, factor: Determined, random: np.random.Generator
    ) -> float:
        """New weights in `reduced`; the factor by which they changed."""
        if abs(level.ratio - 1) <= self.slack:
            return 1.0
        # Near its level the misfit hardly depends on the weight: (ratio - 1) times the data over those used up.
        change = 1 / LARGEST if level.ratio > 2 else float(np.clip(level.ratio**-20.0, 1 / LARGEST, LARGEST))
        for name in reduced.weights:
            reduced.weights[name] *= change
        return max(change, 1 / change)


@dataclass
class Given:
    """Weights as they are."""

    def update(
        self, reduced: Reduced, x: Array, level: Level, factor: Determined, random: np.random.Generator
    ) -> float:
        """1."""
        return 1.0


def corner(misfits: Array, energies: Array) -> int:
    """Which point of an L-curve bends most: ln 2Φ against ln of the regulariser's energy, in order of falling weights.

    >>> corner(np.array([1e4, 1e2, 1.1, 1.0, 0.99]), np.array([1.0, 1.5, 2.0, 30.0, 900.0]))
    2
    """
    x, y = np.log(np.asarray(misfits, float)), np.log(np.asarray(energies, float))
    x1, y1, x2, y2 = np.gradient(x), np.gradient(y), np.gradient(np.gradient(x)), np.gradient(np.gradient(y))
    bend = np.abs(x1 * y2 - y1 * x2) / np.maximum((x1**2 + y1**2) ** 1.5, 1e-30)
    return int(1 + np.argmax(bend[1:-1]))
