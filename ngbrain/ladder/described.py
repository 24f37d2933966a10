"""A climb as plain data, as `result.json` holds it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.ladder.climb import Climb

Array = np.ndarray


@dataclass(frozen=True)
class AskedFor:
    """A question, as far as `result.json` says what its answer is: the unit is the answer's, the tolerance relative."""

    name: str
    unit: str
    tolerance: float


def described(climb: Climb, questions: Sequence[AskedFor]) -> dict[str, Any]:
    """The climb as plain data: answers, model, what was left out and how much it matters, every rung."""
    answers, errors = climb.chosen.answers.tolist(), _plain(climb.error)
    names = [each.name for each in questions]
    return {
        "answers": dict(zip(names, answers, strict=True)),
        "error": dict(zip(names, errors, strict=True)),
        "quantities": [
            {
                "quantity": each.name,
                "value": value,
                "unit": each.unit,
                "tolerance": each.tolerance,
                "error_estimate": error,
            }
            for each, value, error in zip(questions, answers, errors, strict=True)
        ],
        "model": climb.chosen.model,
        "left_out": [
            {
                "what": climb.axes[name].left_out[climb.axes[name].at(climb.chosen.model[name])],
                "axis": name,
                "change": _plain(each.change),
                "how": each.how,
                "doubt": each.doubt,
            }
            for name, each in climb.chosen.estimates.items()
        ],
        "flags": climb.warnings,
        "rungs": [
            {
                "model": rung.model,
                "answers": rung.answers.tolist(),
                "ndof": rung.ndof,
                "missing": _plain(rung.missing),
                "taken": " and ".join(rung.taken),
                "cost_s": rung.cost_s,
                "estimates": {
                    name: {"change": _plain(each.change), "how": each.how, "doubt": each.doubt}
                    for name, each in rung.estimates.items()
                },
            }
            for rung in climb.history
        ],
    }


def _plain(values: Array) -> list[float | None]:
    """As JSON has them: what is not known is null."""
    return [float(value) if np.isfinite(value) else None for value in values]
