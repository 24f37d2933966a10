"""The main numbers of a result, which a cohort compares from row to row."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ngbrain.report.pages.parameters import PARAMETERS
from ngbrain.report.words import display_unit

OPERATION = (
    ("peak_pressure_mmHg", "Peak pressure", "mmHg"),
    ("peak_tip_pressure_mmHg", "Peak pressure at the tip", "mmHg"),
    ("peak_force_N", "Peak force", "N"),
    ("dose_mmHg_min", "Dose", "mmHg min"),
    ("s_above_20_mmHg", "Time above 20 mmHg", "s"),
    ("s_above_30_mmHg", "Time above 30 mmHg", "s"),
    ("mps_p95", "Largest principal strain, 95th percentile", ""),
    ("oss_p95", "Octahedral shear strain, 95th percentile", ""),
    ("min_det_F", "Smallest volume ratio", ""),
)
"""Numbers of a protocol: key, name, unit."""
QUALITY = (
    ("n_tets", "Tetrahedra", "", False),
    ("min_dihedral_deg", "Smallest dihedral angle", "°", True),
    ("fraction_radius_ratio_below_0_1", "Share of tetrahedra with a radius ratio below 0.1", "", True),
)


@dataclass(frozen=True)
class Number:
    """A number of a row.

    Attributes
    ----------
    key : str
        Name of its column, with the unit.
    name : str
        Description.
    unit : str
        Of the value; empty if there is none.
    value : float
    region : str
        Its region, label or protocol; empty for the whole.
    extreme : bool
        Whether it is the smallest or largest of many, or counts these.
    """

    key: str
    name: str
    unit: str
    value: float
    region: str = ""
    extreme: bool = False


def main_numbers(result: Mapping[str, Any]) -> dict[str, Number]:
    """The main numbers of a result.json, by key; numbers that are not finite are left out.

    Examples
    --------
    >>> found = main_numbers({"verb": "predict", "answers": {"storage": {"median": 2900.0, "iqr": 150.0}}})
    >>> found["storage_kPa_median"].value
    2.9
    """
    verb = result["verb"]
    of = (
        _mesh
        if verb == "mesh"
        else _maps
        if verb in ("invert", "predict")
        else _quantities
        if isinstance(result["answers"], list)
        else _operation
    )
    return {each.key: each for each in of(result) if isinstance(each.value, int | float) and math.isfinite(each.value)}


def cautions(result: Mapping[str, Any]) -> list[str]:
    """Warnings of the verb on an answer that can be used."""
    off = result.get("checks", {}).get("volume_errors", {})
    # Warnings on maps concern what waves cannot determine, and apply to every row.
    warnings = [] if result["verb"] in ("invert", "predict") else result.get("warnings", [])
    return [
        *(str(text) for text in warnings),
        *(f"caution: {text}" for text in result.get("cautions", [])),
        *(f"the volume of {name} is off by {error:+.0%}" for name, error in off.items()),
    ]


def _mesh(result: Mapping[str, Any]) -> Iterator[Number]:
    for name, region in result["regions"].items():
        yield Number(f"volume_ml_{name}", "Volume", "ml", region["volume_ml"], name)
    for key, name, unit, extreme in QUALITY:
        yield Number(key, name, unit, result["quality"].get(key, math.nan), extreme=extreme)
    if "grey_white_contrast" in result:
        yield Number("grey_white_contrast", "Contrast of grey and white matter", "", result["grey_white_contrast"])
    if found := result.get("surfaces"):
        yield Number("cortex_mm_mean", "Thickness of the cortex", "mm", found["thickness_mm"]["mean"])
        for surface in ("white", "pial"):
            yield Number(f"{surface}_area_cm2", "Area of the cortex", "cm²", found[surface]["area_cm2"], surface)


def _maps(result: Mapping[str, Any]) -> Iterator[Number]:
    for name, answer in result["answers"].items():
        yield from _spread(name, answer)
        if "relative_l2_error" in answer:
            yield Number(f"{name}_error", f"{PARAMETERS[name].name}, off the truth", "", answer["relative_l2_error"])
    for name, labels in (result.get("by_label") or {}).items():
        if name in result["answers"]:
            for label, answer in labels.items():
                yield from _spread(name, answer, f"label {label}")
    if "misfit_over_expected" in result.get("checks", {}):
        yield Number(
            "misfit_over_expected", "Misfit over its expected value", "", result["checks"]["misfit_over_expected"]
        )
    if "estimated" in result.get("noise", {}):
        yield Number("noise_found", "Noise found", "", result["noise"]["estimated"])
    if "score" in result.get("checks", {}):
        yield Number(
            "trust_score",
            "Largest trust score relative to its bound (above 1: not to be trusted)",
            "",
            result["checks"]["score"],
        )


def _spread(name: str, answer: Mapping[str, float], region: str = "") -> Iterator[Number]:
    shown = PARAMETERS[name]
    for key, words in (("median", "median"), ("iqr", "interquartile range")):
        if answer.get(key) is not None:
            column = "_".join(filter(None, (name, shown.unit, key, region.replace(" ", "_"))))
            yield Number(column, f"{shown.name}, {words}", shown.unit, shown.factor * answer[key], region)


def _quantities(result: Mapping[str, Any]) -> Iterator[Number]:
    for each in result["answers"]:
        name, (unit, factor) = each["quantity"], display_unit(each["unit"])
        yield Number(f"{name} ({unit})" if unit else name, name[:1].upper() + name[1:], unit, each["value"] * factor)


def _operation(result: Mapping[str, Any]) -> Iterator[Number]:
    for protocol, answer in result["answers"].items():
        for key, name, unit in OPERATION:
            if answer.get(key) is not None:
                yield Number(f"{key}_{protocol}", name, unit, answer[key], protocol, key.startswith("min_"))
