"""The next step of a search: the axes that are enriched, and their levels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ngbrain.ladder.axes import ELEMENTS, Axis
from ngbrain.ladder.search_result import Rung

Array = np.ndarray
REMAINING_FRACTION = 0.25
"""Fraction of a refinement step that the next one changes at least; the same is left where only some elements are refined."""
HALF_OF_ORDER = 0.5
"""Fraction of the change by a higher order that a refinement changes at least: an error proportional to the element size is halved.
"""
CHEAP_STEP = 8.0
"""Growth in cost above which a single refinement step is tried alone, as for waves, which are solved once."""
MAX_GAIN = 1e3
"""Gain, in tolerances, above which all gains count the same: among the most important steps the cheapest comes first."""


def next_axes(above: Mapping[str, Axis], rung: Rung, tolerances: Array) -> tuple[str, ...]:
    """The axes to enrich next: first all indispensable physics, which is cheap on coarse elements, then the discretisation.

    Where one refinement step would not reach the tolerance, element size and order are refined together, unless a single step is
    cheap (`CHEAP_STEP`): the model in between would not be the last.

    Parameters
    ----------
    above : mapping of Axis
        Axes that are not at their richest level.
    rung : Rung
        The current model, with its estimates.
    tolerances : (n,) array
        Relative tolerance of each answer.

    Returns
    -------
    tuple of str
    """

    def gains(name: str) -> float:
        return float(np.max(np.abs(rung.estimates[name].change) / tolerances))

    must = [name for name in above if gains(name) > 1 and name not in ELEMENTS]
    taken = max(must or above, key=lambda name: _benefit(above[name], rung, tolerances))
    if taken not in ELEMENTS or not set(ELEMENTS) <= set(above):
        return (taken,)
    (other,) = (name for name in ELEMENTS if name != taken)
    short = np.any(_remaining_change(above, rung, taken) > tolerances) and _cost_factor(above[other], rung) < CHEAP_STEP
    return (taken, other) if short else (taken,)


def _remaining_change(above: Mapping[str, Axis], rung: Rung, taken: str) -> Array:
    """Remaining change of the discretisation after a step along one of its axes.

    The larger of a part of the step (`LEFT`) and the change of the other axis: half of it for the order, as elements became
    smaller, and all of it for the size, as elements stay large.
    """
    kept = {
        name: REMAINING_FRACTION if name == taken else HALF_OF_ORDER if name == "order" else 1.0 for name in ELEMENTS
    }
    parts = [part * np.abs(rung.estimates[name].change) * above[name].tail for name, part in kept.items()]
    return np.asarray(np.max(parts, axis=0))


def target_level(axis: Axis, rung: Rung, tolerances: Array) -> str:
    """The level of the next step: a partial level, if there is one and the change left after it is tolerable.

    The remaining change is that of `model_search`, for all axes that are enriched together: otherwise another step would
    follow.

    Parameters
    ----------
    axis : Axis
    rung : Rung
        The current model, with its estimates and the axes that are enriched next.
    tolerances : (n,) array
        Relative tolerance of each answer.

    Returns
    -------
    str
    """
    whole, part = rung.estimates[axis.name].to, axis.next_level(rung.model[axis.name])
    if not part or not part.is_partial:
        return whole
    told = sum(np.abs(rung.estimates[name].change) for name in rung.next_axes)
    return part if np.all(REMAINING_FRACTION ** len(rung.next_axes) * told * axis.tail <= tolerances) else whole


def _benefit(axis: Axis, rung: Rung, tolerances: Array) -> float:
    """Benefit of the next step of an axis, in tolerances, over its cost."""
    gain = np.abs(rung.estimates[axis.name].change) * axis.tail / tolerances
    return float(np.max(np.minimum(gain, MAX_GAIN))) / _cost_factor(axis, rung)


def _cost_factor(axis: Axis, rung: Rung) -> float:
    """Factor in cost of the next step."""
    return axis.growth[axis.index(rung.model[axis.name])]
