"""The result of a search as plain data, as in `result.json`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.ladder.quantities import Asked, Question
from ngbrain.ladder.search_result import SearchResult

Array = np.ndarray


@dataclass(frozen=True)
class RequestedQuantity:
    """A requested quantity as described in `result.json`.

    Parameters
    ----------
    label : str
        Description.
    name : str
        Kind of quantity.
    where, when : str
        Place and time; empty if not applicable.
    unit : str
        Of its value.
    tolerance : float
        Relative.
    """

    label: str
    name: str
    where: str
    when: str
    unit: str
    tolerance: float

    @classmethod
    def from_quantity(cls, asked: Asked) -> RequestedQuantity:
        """From a scene's quantity or a `Question`."""
        if isinstance(asked, Question):
            return cls(asked.label, asked.observable.name, "", asked.when, asked.observable.unit, asked.tolerance)
        return cls(asked.label, asked.name, asked.where, asked.moment, asked.unit, asked.tolerance)


def summarise(search: SearchResult, questions: Sequence[RequestedQuantity]) -> dict[str, Any]:
    """A search as plain data: answers, model, what was left out and its estimated effect, all models.

    Parameters
    ----------
    search : SearchResult
    questions : sequence of RequestedQuantity

    Returns
    -------
    dict
    """
    answers, errors = search.chosen.answers.tolist(), _plain(search.error)
    return {
        "answers": [
            {
                "quantity": each.label,
                "name": each.name,
                "where": each.where,
                "when": each.when,
                "value": value,
                "unit": each.unit,
                "tolerance": each.tolerance,
                "error_estimate": error,
                "model": search.chosen.model,
                "warnings": list(search.warnings),
            }
            for each, value, error in zip(questions, answers, errors, strict=True)
        ],
        "model": search.chosen.model,
        "left_out": [
            {
                "what": search.axes[name].left_out[search.axes[name].index(search.chosen.model[name])],
                "axis": name,
                "change": _plain(each.change),
                "method": each.method,
                "caution": each.caution,
            }
            for name, each in search.chosen.estimates.items()
        ],
        "cautions": search.warnings,
        "models": [
            {
                "model": rung.model,
                "answers": rung.answers.tolist(),
                "ndof": rung.ndof,
                "error_bound": _plain(rung.error_bound),
                "next_axes": list(rung.next_axes),
                "cost_s": rung.cost_s,
                "estimates": {
                    name: {"change": _plain(each.change), "method": each.method, "caution": each.caution}
                    for name, each in rung.estimates.items()
                },
            }
            for rung in search.history
        ],
    }


def _plain(values: Array) -> list[float | None]:
    """As JSON has them: unknown values are null."""
    return [float(value) if np.isfinite(value) else None for value in values]
