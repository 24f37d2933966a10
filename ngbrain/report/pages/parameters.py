"""Names, units and tables of elastography parameters, for the page and the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ngbrain.forward.common.solve_counts import Solves
from ngbrain.report.pages.tables import TableRow
from ngbrain.report.words import number


@dataclass(frozen=True)
class ParameterLabel:
    """Name, symbol and display unit of a parameter.

    Parameters
    ----------
    name : str
        Name.
    symbol : str
        Symbol.
    unit : str
        Display unit.
    factor : float
        Factor from SI to the display unit.
    """

    name: str
    symbol: str
    unit: str = ""
    factor: float = 1.0

    @property
    def label(self) -> str:
        """Name, symbol and unit."""
        return f"{self.name} {self.head}"

    @property
    def head(self) -> str:
        """Symbol and unit, for a table head."""
        return self.symbol + (f" ({self.unit})" if self.unit else "")


PARAMETERS = {
    "youngs": ParameterLabel("Young's modulus", "E", "kPa", 1e-3),
    "storage": ParameterLabel("Storage modulus", "G′", "kPa", 1e-3),
    "loss": ParameterLabel("Loss modulus", "G″", "kPa", 1e-3),
    "mu": ParameterLabel("Shear modulus across fibres", "μ", "kPa", 1e-3),
    "zeta": ParameterLabel("Tensile anisotropy", "ζ"),
    "phi": ParameterLabel("Shear anisotropy", "φ"),
    "shear_along": ParameterLabel("Shear along fibres", "μ(1+φ)", "kPa", 1e-3),
    "shear_stretch": ParameterLabel("Shear by stretch along fibres", "μ(1+ζ)", "kPa", 1e-3),
    "magnitude": ParameterLabel("Magnitude", "|G*|", "kPa", 1e-3),
    "phase": ParameterLabel("Phase angle", "arg G*", "rad"),
    "damping_ratio": ParameterLabel("Damping ratio", "ξ"),
    "stiffness": ParameterLabel("Shear stiffness", "ρc²", "kPa", 1e-3),
    "oss": ParameterLabel("Octahedral shear strain", "OSS", "10⁻³", 1e3),
    "oss_snr": ParameterLabel("Signal-to-noise ratio of OSS", "OSS-SNR"),
}


def symbol(name: str, fields: Mapping[str, Mapping[str, Any]] | None = None) -> str:
    """Symbol of a parameter or of a field: that of its quantity, with the label it is restricted to.

    Parameters
    ----------
    name : str
        Name of the parameter or field.
    fields : mapping, optional
        Name of a field → its quantity and label.

    Returns
    -------
    str
        The symbol.

    Examples
    --------
    >>> symbol("storage"), symbol("storage 3", {"storage 3": {"quantity": "storage", "label": 3}})
    ('G′', 'G′ of 3')
    """
    field = (fields or {}).get(name, {"quantity": name, "label": None})
    own = PARAMETERS[field["quantity"]].symbol
    return own if field["label"] is None else f"{own} of {field['label']}"


STARTS = {
    "waves": "measured waves (convex)",
    "uniform": "uniform fields",
    "given": "measured waves and a given map",
    "both": "measured waves, then descent",
    "coarse waves": "measured waves, coarse",
    "coarse uniform": "uniform fields, coarse",
    "coarse both": "then descent, coarse",
    "fine": "then descent, fine elements",
    "gaussian": "Gaussian fields, one step",
    "zones": "zones, independently",
    "slices": "slices, one by one",
    "pass 1": "zones among their neighbours",
}
"""Descriptions of the initial guesses in the table."""


def parameters(result: Mapping[str, Any]) -> list[TableRow]:
    """A row for each parameter: median, interquartile range and, where the truth is known, relative error."""
    rows = []
    for name, answer in result["answers"].items():
        shown = PARAMETERS[name]
        values = [number(shown.factor * answer[key]) if key in answer else "–" for key in ("median", "iqr")]
        error = answer.get("relative_l2_error")
        rows.append(TableRow(f"{shown.name} {shown.symbol}", shown.unit, [(v, "") for v in (*values, percent(error))]))
    return rows


def intervals(result: Mapping[str, Any]) -> list[str]:
    """Mean and ends of the 95 % interval for each parameter; empty without error bars."""
    bars = result.get("error_bars", {})
    return [_ends(name, bars[name]["mean"]) if name in bars else "–" for name in result["answers"] if bars]


def labels(result: Mapping[str, Any]) -> list[TableRow]:
    """A row for each label: median and interquartile range of every map in `label_heads`."""
    found = _of_labels(result)
    names = sorted({label for each in found.values() for label in each}, key=int)
    return [
        TableRow(label, "", [_spread(name, each.get(label) or {}) for name, each in found.items()]) for label in names
    ]


def label_heads(result: Mapping[str, Any]) -> list[str]:
    """Symbols and units of the maps with numbers for each label."""
    return [PARAMETERS[name].head for name in _of_labels(result)]


def _of_labels(result: Mapping[str, Any]) -> dict[str, Mapping[str, Mapping[str, float]]]:
    """Map → label → median and IQR, without maps that are zero everywhere (as the loss modulus of elastic tissue)."""
    found = result.get("by_label") or {}
    return {name: each for name, each in found.items() if any(any(spread.values()) for spread in each.values())}


def starts(result: Mapping[str, Any]) -> list[TableRow]:
    """A row for each initial guess: error of every parameter, misfit over expected misfit, J, iterations, convergence, CPU s."""
    rows = []
    for name, start in result["starts"].items():
        errors = [percent(start["answers"][key].get("relative_l2_error")) for key in result["answers"]]
        ratio = number(start["misfit"] / start["expected_misfit"])
        settled = "yes" if start["converged"] else "no"
        texts = [
            *errors,
            ratio,
            number(start["objective"], 5),
            str(start["iterations"]),
            settled,
            number(start["cpu_s"]),
        ]
        kept = "kept" if name == result["selected_start"] else ""
        rows.append(TableRow(STARTS.get(name, name), kept, [(text, "") for text in texts]))
    return rows


def _interval(name: str, band: Mapping[str, float]) -> str:
    """A value and the ends of its interval in the display unit."""
    return f"{_ends(name, band)} {PARAMETERS[name].unit}".rstrip()


def _ends(name: str, band: Mapping[str, float]) -> str:
    value, low, high = (number(PARAMETERS[name].factor * band[key], 4) for key in ("value", "low", "high"))
    return f"{value} ({low} to {high})"


def facts(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Assumptions and results of the inversion: pairs of name and text."""
    model, noise, checks, solves = (result[key] for key in ("model", "noise", "checks", "solves"))
    own = "the mesh of the synthetic data (inverse crime)" if model["inverse_crime"] else "independent of the data"
    named = model.get("fields")
    fields = ", ".join(
        f"{symbol(name, named)} {number(length, 2)} mm ({number(model['effective_dof'][name])} numbers)"
        for name, length in model["resolution_mm"].items()
    )
    weights = ", ".join(f"{symbol(name, named)} {number(weight)}" for name, weight in model["weights"].items())
    by = model.get("weight", "evidence")
    points = f", {' to '.join(map(percent, noise['range']))} by point" if "range" in noise else ""
    pairs = [
        ("Elements", f"{model['form']}, {model['n_elements']}, {own}; {model['n_unknowns']} unknowns for each wave"),
        ("Fields", f"{model['n_parameters']} unknowns, {model['regulariser']}; weights by {by}: {weights}"),
        (
            "Noise, including model error",
            f"{percent(noise['assumed'])} assumed{points}, {percent(noise['estimated'])} estimated",
        ),
        ("Misfit over its expected value", _misfit(result)),
        ("Resolution of the data, about", fields),
    ]
    if free := model.get("free_boundary"):
        sides = zip("xyz", free["from_mm"], free["to_mm"], strict=False)
        where = ", ".join(f"{x} {number(a)}" + (f" to {number(b)}" if b - a > 1e-6 else "") for x, a, b in sides)
        pairs.insert(1, ("Traction-free part of the boundary", f"{percent(free['share'])} of it, at {where} mm"))
    for name, bars in result.get("error_bars", {}).items():
        pairs.append((f"Mean of {symbol(name)}, 95 % credible interval", _interval(name, bars["mean"])))
        for label, band in bars["by_label"].items():
            pairs.append((f"Mean of {symbol(name)} in label {label}", _interval(name, band)))
    if "strain_snr" in checks:
        pairs.append(("Octahedral strain signal-to-noise ratio, median", number(checks["strain_snr"])))
    if "resonance_distance" in checks:
        pairs.append(("Distance of the nearest resonance from the frequency", percent(checks["resonance_distance"])))
    if "bulk_change_over_noise" in checks:
        moved = number(checks["bulk_change_over_noise"])
        pairs.append(("Change of the waves by a bulk modulus 10 % larger", f"{moved} times their noise"))
    if "share_through_slices" in checks:
        pairs.append(
            ("Share of the through-slice second derivative in the Laplacian", percent(checks["share_through_slices"]))
        )
    if model.get("zones", 1) > 1:
        apart = ", ".join(
            f"{symbol(name)} {percent(checks[f'disagreement_{name}'])}, initially {percent(checks[f'disagreement_{name}_first'])}"
            for name in result["answers"]
        )
        low, high = model["points_of_a_zone"]
        pairs.append(("Zones", f"{model['zones']}, of {low} to {high} points; in overlaps they differ by {apart}"))
    if "misfit_as_one_body" in checks:
        pairs.append(
            ("Misfit of the merged map in one body over its expected value", number(checks["misfit_as_one_body"]))
        )
    if "mismatch_at_truth" in model:
        pairs.append(
            ("Difference of the data from waves of the truth, including noise", percent(model["mismatch_at_truth"]))
        )
    return [*pairs, ("Solves", str(Solves(**solves)))]


def _misfit(result: Mapping[str, Any]) -> str:
    """Misfit over its expected value, and whether fields and weights converged."""
    chosen = result["starts"][result["selected_start"]]
    rounds, end = chosen["iterations"], "converged" if chosen["converged"] else "not converged: stopped"
    return (
        f"{number(result['checks']['misfit_over_expected'])}, {end} after {rounds} iteration{'s' if rounds > 1 else ''}"
    )


def percent(value: float | None) -> str:
    """A relative number in per cent; a dash for None."""
    return "–" if value is None else f"{number(100 * value)} %"


def _spread(name: str, spread: Mapping[str, float]) -> tuple[str, str]:
    factor = PARAMETERS[name].factor
    return number(factor * spread["median"] if spread else None), number(factor * spread["iqr"] if spread else None)
