"""Models of a search, and its result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ngbrain.ladder.axes import Axis
from ngbrain.ladder.estimates import Estimate
from ngbrain.ladder.quantities import BodyState
from ngbrain.look import BriefText
from ngbrain.result import Result

Array = np.ndarray


@dataclass(eq=False, repr=False)
class Rung(BriefText):
    """A model of the search.

    Parameters
    ----------
    model : dict of str
        Axis → level.
    answers : (n,) array
        SI units.
    ndof : int
        Number of unknowns.
    estimates : dict of Estimate
        Axis → estimated change by its next step.
    error_bound : (n,) array
        Estimated bound of the relative error of each answer: the sum of all changes.
    next_axes : tuple of str
        Axes that were enriched next; empty at the end of the search.
    cost_s : float
        Computing time (s) up to and including this model's estimates.
    scales : (n,) array
        Reference size of each answer where it is nearly zero.
    expected : (n,) array
        Expected relative error: changes of different axes may have different signs.
    """

    model: dict[str, str]
    answers: Array
    ndof: int
    estimates: dict[str, Estimate]
    error_bound: Array
    next_axes: tuple[str, ...] = ()
    cost_s: float = 0.0
    scales: Array | float = 0.0
    expected: Array = field(default_factory=lambda: np.zeros(0))

    def __str__(self) -> str:
        """A short progress text."""
        return f"{self.ndof} unknowns, estimated error {100 * float(self.error_bound.max()):.3g} %"


@dataclass(repr=False, eq=False)
class SearchResult(Result):
    """Result of a search: all models (`history`, the last one chosen), and `warnings` on the answer's reliability.

    Attributes
    ----------
    axes : dict of Axis
        Axes of the scene.
    states : mapping of BodyState
        States of the chosen model by the time of their questions, of an elastic body.
    """

    axes: dict[str, Axis]
    states: Mapping[str, BodyState] = field(default_factory=dict, kw_only=True)

    @property
    def value(self) -> Array:
        """The answers of the chosen model."""
        return self.chosen.answers

    @property
    def statistics(self) -> dict[str, float]:
        """Number of models with estimates, and number of unknowns of the chosen one."""
        return {"models": len(self.history), "unknowns": self.chosen.ndof}

    @property
    def error(self) -> Array:
        """Expected relative error of each answer; the search ends by `error_bound`."""
        return self.chosen.expected

    @property
    def chosen(self) -> Rung:
        """The last model."""
        rung: Rung = self.history[-1]
        return rung
