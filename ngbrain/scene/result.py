"""The result of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ngbrain.look import curves
from ngbrain.result_file import FileResult

COUNTED = {"unknowns": "n_unknowns", "time_steps": "n_steps", "Newton_iterations": "newton"}
"""Statistics of an operation, by key in `result.json`."""


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


def _format_answer(answer: Any) -> str:
    if isinstance(answer, Mapping):
        return f"{answer['peak_pressure_mmHg']:.4g} mmHg, {answer['peak_force_N']:.3g} N"
    return f"{answer:.4g}"
