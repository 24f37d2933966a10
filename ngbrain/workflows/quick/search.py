"""First answers of a scene that is answered by models of the ladder, with the ladder's own bounds as intervals."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ngbrain.io import write_json
from ngbrain.ladder import axes
from ngbrain.ladder.levels import Model
from ngbrain.ladder.model_search import NOT_FINAL
from ngbrain.scene import Scene
from ngbrain.scene.result import SceneResult
from ngbrain.workflows.quick.first_answers import Result, compare

BASIS = "An interval is the ladder's bound of what all richer models would change together."


def full_model(scene: Scene) -> Model:
    """The richest model of a body, on the scene's own elements."""
    return {**axes.richest(axes.axes_of(scene)), "mesh": "0", "order": str(scene.mesh.order)}


def lower_order_model(scene: Scene) -> Model | None:
    """`full_model` with elements one order lower; None where there is no lower one."""
    model = full_model(scene)
    levels = [str(level) for level in axes.axes_of(scene)["order"].levels]
    below = [level for level in levels if int(level) < int(model["order"])]
    return {**model, "order": below[-1]} if below else None


@dataclass
class SearchAnswers:
    """The result of a search, or of a body as described, with its first answers.

    Parameters
    ----------
    folder : path, optional
        Where `result.json` goes.
    callback : callable, optional
        Called with each result.
    data : dict, optional
        Contents of `result.json` so far.
    started : float, optional
        When the search began, by `time.perf_counter` (s).
    """

    folder: str | Path | None
    callback: Callable[[Result], None] | None
    data: Result = field(default_factory=dict)
    started: float = field(default_factory=time.perf_counter)

    def add(self, found: Mapping[str, Any], is_last: bool = True) -> None:
        """Take a result: the first one becomes the first answers, others refine them.

        Parameters
        ----------
        found : mapping
            Contents of `result.json`.
        is_last : bool
            False for a first model that another one follows.
        """
        first, last = self.data.get("first_answers"), is_last and NOT_FINAL not in found["cautions"]
        if first is None:
            first = self._first(found)
        if len(found["models"]) > 1 or self.data:
            values = {each["quantity"]: each["value"] for each in found["answers"]}
            first = compare(first, lambda each: values[each["quantity"]])
        self.data = {**found, "first_answers": {**first, "refined": last}}
        if self.folder is not None:
            Path(self.folder).mkdir(parents=True, exist_ok=True)
            write_json(Path(self.folder) / "result.json", self.data)
        if self.callback is not None:
            self.callback(self.data)

    def result(self, found: SceneResult) -> SceneResult:
        """The last result, with the status of another one."""
        return SceneResult(self.data, status=found.status, warnings=found.warnings)

    def _first(self, found: Mapping[str, Any]) -> Result:
        rung = found["models"][0]
        answers = [
            {
                "protocol": "",
                "quantity": asked["quantity"],
                "name": asked["quantity"],
                "unit": asked["unit"],
                "value": value,
                "interval": error_interval(value, bound),
                "refined": None,
                "inside": None,
            }
            for asked, value, bound in zip(found["answers"], rung["answers"], rung["error_bound"], strict=True)
        ]
        return {
            "model": f"{rung['ndof']} unknowns",
            "basis": BASIS,
            "time_s": time.perf_counter() - self.started,
            "refined": False,
            "answers": answers,
        }


def error_interval(value: float, change: float | None) -> list[float] | None:
    """The interval of a value that may change by a part of the larger of itself and the new value.

    Parameters
    ----------
    value : float
    change : float, optional

    Returns
    -------
    list of float or None
        None where nothing is known: no change is, or one of 1 or more.

    Examples
    --------
    >>> error_interval(2.0, 0.2), error_interval(-2.0, 0.2), error_interval(1.0, None)
    ([1.6, 2.5], [-2.5, -1.6], None)
    """
    if change is None or change >= 1:
        return None
    return sorted((value * (1 - change), value / (1 - change)))
