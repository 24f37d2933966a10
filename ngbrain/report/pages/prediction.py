"""The page of a neural operator's prediction from wave data: trust, maps with the truth where it is known, tables."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.forward.common.solve_counts import Solves
from ngbrain.io.waves import WaveData
from ngbrain.report.pages import elastography, parameters
from ngbrain.report.pages.elastography import MODULUS, WAVE
from ngbrain.report.pages.page import write_page
from ngbrain.report.pages.parameters import PARAMETERS
from ngbrain.report.pages.tables import TableRow
from ngbrain.report.pictures.plane_table import draw_table, window
from ngbrain.report.pictures.planes import planes
from ngbrain.report.render.surface import Floats
from ngbrain.report.words import number


def build(
    path: str | os.PathLike[str], result: Mapping[str, Any], data: WaveData, arrays: Mapping[str, Floats]
) -> Path:
    """Write the page of a prediction.

    Parameters
    ----------
    path : str or path-like
        Output file.
    result : mapping of str to Any
        Result of the command `predict`.
    data : WaveData
        The wave data.
    arrays : mapping of str to ndarray
        Content of maps.npz, as for `elastography.build`.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    MissingExtra
        matplotlib or jinja2 is not installed.
    """
    flat = planes(data)
    names = list(result["answers"])
    pictures = {"maps": elastography.maps(result, data, arrays, flat)}
    pictures["deviations"] = draw_table(
        flat,
        [f"{PARAMETERS[name].symbol}, standard deviation (%)" for name in names],
        [""] * len(flat),
        lambda _: [(window(MODULUS, values), values) for values in (_share(arrays, name) for name in names)],
    )
    if "magnitude" in arrays:
        pictures["derived"] = elastography.derived_maps(arrays, flat)
    seen = [(load, i) for load in range(min(data.loads, elastography.MOST_LOADS)) for i in range(data.dim)]
    seen = [(load, i) for load, i in seen if not np.isnan(arrays["measured"][load][:, i]).all()]

    def looks(row: int) -> list[tuple[dict[str, Any], Floats]]:
        load, i = seen[row]
        u = 1e6 * arrays["measured"][load][:, i]
        top = float(np.nanmax(np.abs(u)))
        look = {"cmap": WAVE, "vmin": -top, "vmax": top}
        return [(look, u.real), (look, u.imag)]

    labels = [f"{elastography.load_name(data, load)}, $u_{'xyz'[i]}$ (µm)" for load, i in seen]
    pictures["waves"] = draw_table([flat[0]] * len(seen), ("real part", "imaginary part"), labels, looks)
    return write_page(
        Path(path),
        "prediction.html",
        pictures,
        panel=elastography.panel(result, data, arrays),
        result=result,
        parameters=parameters.parameters(result),
        label_heads=parameters.label_heads(result),
        labels=parameters.labels(result),
        trust=trust(result),
        facts=[*elastography.data_facts(data), *facts(result)],
        known=any("relative_l2_error" in answer for answer in result["answers"].values()),
    )


WORDS = {
    "frequency": "Frequency, in a square of the training's size",
    "softness": "Poisson's ratio",
    "modulus": "Storage modulus",
    "wavelength": "Wave length over the edge",
    "contrast": "Contrast of Young's modulus",
    "noise": "Noise of the displacement",
    "jump": "Jump of the displacement, which is continuous",
    "features": "Distance of the input from the training data",
    "deviation": "Predicted standard deviation",
    "residual": "Residual of the equations of motion",
    "boundary": "Boundary conditions of the square",
}
"""Names of the scores that decide on trust."""


def trust(result: Mapping[str, Any]) -> list[TableRow]:
    """A row for each score that decides on trust, relative to its bound, the largest first."""
    scores = result["trust"]["scores"]
    limit = result["trust"]["threshold"]
    names = sorted(scores, key=scores.get, reverse=True)
    return [
        TableRow(WORDS[name], "over" if scores[name] > limit else "", [(number(scores[name] / limit), "")])
        for name in names
    ]


def facts(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The model that was used and its cost: pairs of name and text."""
    model = result["model"]
    pairs = [("Operator", f"of {model['operator']}; {model['squares']} squares of the grid")]
    pairs += [("Made by", model["command"])] if model.get("command") else []
    pairs += [
        (
            f"{float(share):.0%} of errors are within",
            ", ".join(f"{n:.2f} deviations of {name}" for name, n in held.items()),
        )
        for share, held in result["trust"]["coverage"].items()
    ]
    if any(result["solves"].values()):  # of the residual of compression
        pairs.append(("Solves", str(Solves(**result["solves"]))))
    return pairs


def _share(arrays: Mapping[str, Floats], name: str) -> Floats:
    """Standard deviation in per cent of the median magnitude of the map."""
    return 100 * arrays[f"{name}_deviation"] / float(np.nanmedian(np.abs(arrays[name])))
