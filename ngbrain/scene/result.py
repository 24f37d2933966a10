"""The result of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.errors import InputError, nearest
from ngbrain.io.labelled_arrays import Variable, dataset, series
from ngbrain.look import curves
from ngbrain.result_file import FileResult

COUNTED = {"unknowns": "n_unknowns", "time_steps": "n_steps", "Newton_iterations": "newton"}
"""Statistics of an operation, by key in `result.json`."""
SUFFIXES = ("mmHg", "mm2", "mm", "ml", "gf", "kPa", "Pa", "mJ", "J", "N", "s")
"""Units at the end of a key."""


@dataclass(repr=False, eq=False)
class SceneResult(FileResult):
    """Answers of a scene, with the contents of `result.json`: `result["answers"]`."""

    @property
    def value(self) -> dict[str, Any]:
        """Quantity → number, or protocol → its numbers."""
        answers: Any = self.data.get("answers", {})
        return answers if isinstance(answers, dict) else {each["quantity"]: each["value"] for each in answers}

    @property
    def errors(self) -> dict[str, float | None]:
        """Quantity → estimated relative error, None where it is unknown; empty for an operation without requested
        quantities."""
        answers: Any = self.data.get("answers", {})
        asked = answers if isinstance(answers, list) else []
        return {each["quantity"]: each["error_estimate"] for each in asked}

    @property
    def headline(self) -> str:
        """Peak pressure and force of each protocol of an operation, else each answer."""
        return ", ".join(f"{name} {_format_answer(answer)}" for name, answer in self.value.items())

    @property
    def statistics(self) -> dict[str, float]:
        """Wall-clock time, and the computational work of an operation."""
        model = self.data.get("model", {})
        counted = {told: model[name] for told, name in COUNTED.items() if name in model}
        return counted | {"s": round(self.data.get("time_s", 0.0), 1)}

    def plot(self) -> Any:
        """Pressure over time of an operation's protocols."""
        series = {
            name: each["series"] for name, each in self.value.items() if isinstance(each, dict) and "series" in each
        }
        if not series:
            return super().plot()
        lines = {name: (each["t_s"], each["pressure_mmHg"]) for name, each in series.items()}
        return curves(lines, "time, s", "pressure, mmHg")

    def to_xarray(self, protocol: str | None = None) -> Any:
        """As `xarray.Dataset`: the series of a protocol along `time`, or the answers along `quantity`.

        Parameters
        ----------
        protocol : str, optional
            Of an operation as described; needed where it has several.

        Returns
        -------
        xarray.Dataset
            In the units of `result.json`, which the attribute `units` states.

        Raises
        ------
        InputError
            No protocol has this name, or it is not given.
        MissingExtra
            xarray is not installed.
        """
        answers: Any = self.data.get("answers", {})
        if isinstance(answers, list):
            return _answers(answers)
        names = list(answers)
        if protocol is None and len(names) == 1:
            protocol = names[0]
        if protocol not in answers:
            raise InputError(
                "protocol", "not given" if protocol is None else repr(protocol), nearest(str(protocol), names)
            )
        found = answers[protocol]["series"]
        columns = {("time" if key == "t_s" else key): (values, *_described(key)) for key, values in found.items()}
        return series(columns, {"protocol": protocol})


def _answers(answers: list[dict[str, Any]]) -> Any:
    """Values, estimated errors and tolerances of the requested quantities."""
    along = ("quantity",)
    variables: dict[str, Variable] = {
        "value": (along, np.array([each["value"] for each in answers], float), "", "value, in its own unit"),
        "error_estimate": (
            along,
            np.array([each["error_estimate"] for each in answers], float),
            "1",
            "estimated relative error",
        ),
        "tolerance": (along, np.array([each["tolerance"] for each in answers], float), "1", "relative tolerance"),
    }
    places: dict[str, Variable] = {
        "quantity": (along, np.array([each["quantity"] for each in answers]), "", "what is asked"),
        "unit": (along, np.array([each["unit"] for each in answers]), "", "unit of the value"),
    }
    return dataset(variables, places, {})


def _described(key: str) -> tuple[str, str]:
    """Unit and words of a key of `result.json`, whose ending is the unit."""
    for end in SUFFIXES:
        if key.endswith(f"_{end}"):
            return end, key.removesuffix(f"_{end}").replace("_", " ")
    return "1", key.replace("_", " ")


def _format_answer(answer: Any) -> str:
    if isinstance(answer, Mapping):
        return f"{answer['peak_pressure_mmHg']:.4g} mmHg, {answer['peak_force_N']:.3g} N"
    return f"{answer:.4g}"
