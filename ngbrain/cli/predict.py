"""The verb `predict`: property maps from wave data by a trained operator."""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.cli import EXIT_SOLVER
from ngbrain.cli.words import conclude
from ngbrain.errors import file_context, require
from ngbrain.inverse.data.direct_inversion import uniform_shear
from ngbrain.inverse.data.time_convention import check_passive
from ngbrain.inverse.elastography.derived_maps import DERIVED, map_statistics, maps_from_shear, statistics_by_label
from ngbrain.io.versions import versions
from ngbrain.io.waves import WaveData, read_waves
from ngbrain.progress import LOG, Progress, terminal
from ngbrain.report.pages import parameters, prediction
from ngbrain.surrogate.prediction.predict import Prediction, predict
from ngbrain.surrogate.prediction.pretrained import Operator
from ngbrain.threads import threads
from ngbrain.workflows.bids import check_subject
from ngbrain.workflows.property_maps import write_maps

LOSSLESS = 0.01
"""Smallest loss modulus of an initial guess, relative to the storage modulus."""
TOLD = (0.5, 0.68, 0.9, 0.95)
"""Coverage levels for which a result reports the interval width in standard deviations."""


def run(arguments: argparse.Namespace) -> int:
    """Read, predict, write, report, print."""
    started = time.monotonic()
    runtime = runtime_version()
    for package in ("matplotlib", "jinja2"):
        require(package, "report")
    folder: Path = arguments.output
    with Progress(terminal(arguments.quiet)) as line, threads(arguments.threads), file_context(arguments.data):
        line.callback("reading")
        data = read_waves(arguments.data)
        data = data.conjugate() if arguments.conjugate else data
        if arguments.bids:
            check_subject(arguments.bids, data)
        check_passive(data)
        if data.affine is not None:
            require("nibabel", "mri")
        line.callback("predicting")
        operator = load_operator(data, arguments.weights)
        found = predict(data, operator)
    maps, deviations, notes = scale_to_level(found)
    follows = derived_maps(found.data, maps)
    arrays = {
        "points": found.data.points,
        **maps,
        **{f"{name}_deviation": values for name, values in deviations.items()},
        **follows,
        "measured": np.where(found.data.mask[:, None], found.data.displacement, np.nan),
    }
    card = operator.card.content
    labels = found.data.labels
    told = {
        "verb": "predict",
        "source": arguments.data.name,
        "versions": versions() | {"onnxruntime": runtime},
        "seed": card["settings"][-1]["seed"] if "settings" in card else 0,
        "threads": arguments.threads,
        "time_s": time.monotonic() - started,
        "usable": found.usable,
        "reasons": found.reasons,
        "answers": map_statistics(found.data, maps),
        "by_label": {}
        if labels is None
        else {name: statistics_by_label(v, labels) for name, v in {**maps, **follows}.items()},
        "solves": asdict(found.solves),
        "checks": {"score": found.score, **found.scores},
        "trust": {
            "rejected": found.rejected,
            "threshold": found.threshold,
            "scores": found.scores,
            "coverage": {f"{share:g}": found.coverage_factors(share) for share in TOLD},
        },
        "model": {
            "operator": found.modality,
            "squares": found.squares,
            **{key: card[key] for key in ("command", "sha256", "weights") if key in card},
        },
        "warnings": notes,
    }
    images = [name for name in arrays if name in (*maps, *DERIVED) or name.endswith("_deviation")]
    result = write_maps(folder, found.data, arrays, images, told, arguments.bids)
    report = prediction.build(folder / "report.html", result, found.data, arrays)
    conclude(arguments.quiet, [*summary(result), f"report: {report}"], [f"note: {note}" for note in notes])
    if not found.usable:
        LOG.warning("do not use these maps: %s", "; ".join(found.reasons))
        return EXIT_SOLVER
    return 0


def runtime_version() -> str:
    """Version of onnxruntime; `MissingExtra` without it."""
    return str(require("onnxruntime", "surrogate").__version__)


def load_operator(data: WaveData, weights: Path | None = None) -> Operator:
    """The operator for the kind of data.

    Parameters
    ----------
    data : WaveData
    weights : Path, optional
        Folder of the weights; by default those of the package.

    Returns
    -------
    Operator
    """
    name = "waves" if (data.frequency > 0).any() else "compression"
    return Operator.load(weights, name) if weights else Operator.load_default(name)


def scale_to_level(found: Prediction) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], list[str]]:
    """Maps, deviations and notes; those of static compression are relative and scaled to the initial level of `invert`."""
    if found.modality == "waves":
        return found.maps, found.deviations, found.warnings
    level = float(np.real(found.data.youngs_of(uniform_shear(found.data))))
    maps, deviations = ({name: level * v for name, v in each.items()} for each in (found.maps, found.deviations))
    note = f"the mean is set to {1e-3 * level:.4g} kPa, the initial level of `invert`; errors are computed without that factor"
    return maps, deviations, [*found.warnings, note]


@dataclass(frozen=True, eq=False)
class Start:
    """Initial guess of an inversion, and notes on it.

    Parameters
    ----------
    maps : dict of array
    notes : list of str
    """

    maps: dict[str, np.ndarray]
    notes: list[str]


def surrogate_start(data: WaveData) -> Start:
    """Initial guess by the trained operator; a loss modulus below `LOSSLESS` is raised to it, as the inversion uses logarithms."""
    found = predict(data)
    maps = dict(scale_to_level(found)[0])
    notes = [
        "started from the maps of the trained operator" + "".join(f", though {reason}" for reason in found.reasons)
    ]
    if "loss" in maps:
        least = LOSSLESS * maps["storage"]
        raised = int((maps["loss"] < least).sum())
        maps["loss"] = np.where(np.isnan(least), np.nan, np.maximum(maps["loss"], least))
        if raised:
            notes.append(
                f"the loss modulus is below {100 * LOSSLESS:g} % of the storage modulus at {raised} points and is raised to it"
            )
    return Start(maps, notes)


def derived_maps(data: WaveData, maps: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Maps derived from the complex shear modulus of waves; none for static compression.

    Parameters
    ----------
    data : WaveData
    maps : dict of array

    Returns
    -------
    dict of array
    """
    if not data.frequency.any():
        return {}
    shear = maps["storage"] + 1j * maps["loss"] if "storage" in maps else np.real(data.shear_of(maps["youngs"]))
    modulus = maps_from_shear(shear)
    return {name: modulus[name] for name in DERIVED}


def summary(result: dict[str, Any]) -> list[str]:
    """Lines of the summary: reliability, parameters."""
    lines = [line for reason in result["reasons"] for line in (f"Do not use: {reason}", "")]
    lines.append(f"{'parameter':<34}{'median':>9}{'IQR':>9}{'error':>12}")
    for row in parameters.parameters(result):
        median, iqr, error = (text for text, _ in row.cells)
        lines.append(f"{f'{row.name} {row.unit}':<34}{median:>9}{iqr:>9}{error:>12}")
    lines += ["", f"{'trust score':<47}{'relative to bound':>17}"]
    lines += [f"{row.name:<50}{row.cells[0][0]:>14}" for row in prediction.trust(result)]
    lines += ["", *(f"{name}: {text}" for name, text in prediction.facts(result))]
    return [*lines, f"Time: {result['time_s']:.2f} s"]
